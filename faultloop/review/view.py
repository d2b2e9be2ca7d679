"""What the picture and the page both show of a relay: time window, timeline, thinned waves."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from faultloop.io.mcap_reader import Log
from faultloop.io.messages import LOOPS
from faultloop.relay.functions import FUNCTIONS
from faultloop.review.facts import BreakerFacts, FaultedLoop, RelayFacts, Summary
from faultloop.review.rows import RelayRows, Span, relay_rows
from faultloop.review.summary import RECORD
from faultloop.review.survey import survey

Zones = Mapping[str, tuple[NDArray[np.float64], NDArray[np.float64]]]
Kind = Literal["fault", "forward", "reverse", "start", "operate", "blocked", "record", "A", "B", "C"]

# Phases and loops, apart from each other for the colour-blind too (Okabe and Ito 2008).
PHASE_COLOURS = {"A": "#D55E00", "B": "#009E73", "C": "#0072B2"}
LOOP_COLOURS = {
    "AG": "#D55E00", "BG": "#009E73", "CG": "#0072B2", "AB": "#B8860B", "BC": "#56B4E9", "CA": "#CC79A7",
}  # fmt: skip
KIND_COLOURS: dict[Kind, str] = {
    "fault": "#222222", "forward": "#7F9D8B", "reverse": "#D9B8C4", "start": "#9DB4D0", "operate": "#26436B",
    "record": "#8C7A4F", "blocked": "#D8D2C4",
    "A": PHASE_COLOURS["A"], "B": PHASE_COLOURS["B"], "C": PHASE_COLOURS["C"],
}  # fmt: skip
KIND_NAMES: dict[Kind, str] = {
    "fault": "fault applied", "forward": "forward", "reverse": "reverse", "start": "start",
    "operate": "operate", "record": "of the record", "blocked": "not ready",
    "A": "pole A open", "B": "pole B open", "C": "pole C open",
}  # fmt: skip


DIGITAL_ROWS = 16
"""Of a record's digital channels, of which some have hundreds."""


LONGEST_MS = 60_000.0  # of a picture; what comes later is in the tables


@dataclass(frozen=True)
class Bar:
    """A stretch of a timeline row [ms from inception], in one of its ``lanes``, counted from the top."""

    start_ms: float
    stop_ms: float
    kind: Kind
    name: str
    lane: int = 0
    lanes: int = 1


@dataclass(frozen=True)
class TimelineRow:
    label: str
    bars: list[Bar]


@dataclass(frozen=True)
class RelayView:
    """One relay with times in ms from inception, as ``summary`` has it."""

    rows: RelayRows
    facts: RelayFacts
    ms: NDArray[np.float64]
    timeline: list[TimelineRow]


def fault_view(log: Log, relay: str, summary: Summary) -> RelayView:
    """The fault's window of a relay's record, and the timeline of the whole."""
    zero, cycle_ns = summary.inception.zero_ns, 1e9 / summary.log.nominal_hz
    start, stop = (zero + round(1e6 * ms) for ms in window_ms(summary))
    rows = relay_rows(log, relay, start - round(2 * cycle_ns), stop + round(2 * cycle_ns))
    return relay_view(rows, summary, survey(log, relay).spans)


def relay_view(rows: RelayRows, summary: Summary, spans: dict[str, list[Span]] | None = None) -> RelayView:
    """``spans``: of the whole record, where ``rows`` are a part of it.  Lines break where samples miss."""
    spans, rows = spans or rows.spans, rows.broken_at_gaps()
    zero = summary.inception.zero_ns
    end_ms = (summary.log.duration_s * 1e9 - zero) / 1e6
    return RelayView(
        rows,
        summary.relays[rows.name],
        (rows.t_ns - zero) / 1e6,
        _timeline(rows.name, spans, summary, end_ms),
    )


def window_ms(summary: Summary) -> tuple[float, float]:
    """The part of the log that a picture of the fault shows, the same for all relays.

    From two cycles before the inception to two after the last pole had opened, or a breaker failed; without a
    trip to the fault's end or the last reset.  Where there is no fault: half a second of the log, with its
    greatest current.
    """
    zero = summary.inception.t_ns
    cycle = 1e3 / summary.log.nominal_hz
    stop = (summary.log.duration_s * 1e9 - summary.inception.zero_ns) / 1e6
    relays = list(summary.relays.values())
    if zero is None:
        peaks = [(p.instantaneous, p.ms) for own in relays for p in own.peak_current.values() if p]
        start = max(min(max(peaks, default=(0.0, 0.0))[1] - 100.0, stop - 500.0), 0.0)
        return start, max(min(stop, start + 500.0), start + cycle)
    known = [t for own in relays for trip in own.trips for t in (trip.decided_ms, trip.opened_ms)]
    known += [e.first_ms for own in relays for e in own.elements if e.name.endswith(".OpEx")]
    if not any(t is not None for t in known):
        known = [fault.off_ms for fault in summary.faults]
        known += [e.last_off_ms for own in relays for e in own.elements if e.name.endswith(".Str")]
    last = max((t for t in known if t is not None), default=10 * cycle)
    return max(-2 * cycle, -zero / 1e6), min(max(last, 2 * cycle) + 2 * cycle, max(stop, cycle), LONGEST_MS)


def thinned(y: NDArray[np.float64], points: int) -> NDArray[np.int64]:
    """Indices of at most about ``points`` of y (n,): least and greatest of each bucket, and the first of each
    stretch that is no number, or a line would be drawn across it."""
    buckets = points // 2
    if len(y) <= points or buckets < 1:
        return np.arange(len(y))
    size = -(-len(y) // buckets)
    padded = np.full(-(-len(y) // size) * size, np.nan)
    padded[: len(y)] = y
    cells = padded.reshape(-1, size)
    first = np.arange(len(cells)) * size
    low = first + np.where(np.isnan(cells), np.inf, cells).argmin(axis=1)
    high = first + np.where(np.isnan(cells), -np.inf, cells).argmax(axis=1)
    breaks = np.flatnonzero(np.diff(np.isnan(y).astype(np.int8)) > 0) + 1
    return np.unique(np.concatenate([[0], low, high, breaks[:points], [len(y) - 1]]))


def markers(summary: Summary, relay: str) -> list[tuple[float, str]]:
    """Instants that a person looks for, [ms] and name: fault, trip (as received), poles open."""
    found = [] if summary.inception.t_ns is None else [(0.0, "fault")]
    zero = summary.inception.zero_ns
    later = sorted({fault.on_ns for fault in summary.faults if fault.on_ns > zero})
    found += [((t_ns - zero) / 1e6, "fault") for t_ns in later]
    trips = summary.relays[relay].trips
    answered: set[str | None] = set()
    for trip in trips:  # the first that answers each fault
        if trip.fault not in answered:
            received = trip.received_ms
            found.append((trip.decided_ms, "decided") if received is None else (received, "trip"))
            answered.add(trip.fault)
    last = [trip.opened_ms for trip in trips if trip.opened_ms is not None]
    if last:
        found.append((max(last), "poles open"))
    found.sort(key=lambda marker: marker[0])
    return found


def locus_ms(summary: Summary, view: RelayView) -> tuple[float, float]:
    """The part of the loops' way that the R-X plane shows: from just before the inception to the own first
    pole's opening; in a record without breakers to the steady instant."""
    zero, cleared = summary.inception.t_ns, view.facts.cleared_ns
    if zero is None:
        return window_ms(summary)
    fault, loop = view.facts.fault, view.facts.loop
    stop = fault.ms if fault else window_ms(summary)[1]
    if cleared is not None:
        stop = (cleared - zero) / 1e6
    elif loop is not None:  # no breaker says when its current went
        inside = np.flatnonzero((view.ms >= 0.0) & (view.ms <= stop))
        current = np.abs(loop_currents(view.rows.phasors[inside, 3:])[:, LOOPS.index(loop.loop)])
        flows = inside[current > 0.1 * current.max(initial=0.0)]
        stop = float(view.ms[flows[-1]]) if len(flows) else stop
    return -1.0, stop


def loop_currents(i: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Of phasors (n, 3) of the phase currents: each phase's, and each two phases' difference, (n, 6)."""
    return np.concatenate([i, i - np.roll(i, -1, axis=1)], axis=1)


def lane_meaning(label: str) -> str:
    """What a lane of a function stands for, as the model of its settings has it; empty for another lane."""
    node = label.partition(".")[0].rstrip("0123456789").lower()
    model = next((function.settings for function in FUNCTIONS if function.key == node), None)
    if model is None or not label[:1].isupper():
        return ""
    return inspect.cleandoc(model.__doc__ or "").split("\n\n")[0].partition(": ")[2].rstrip(".")


def zone_shapes(zones: Zones, loop: FaultedLoop | None) -> dict[str, NDArray[np.float64]]:
    """Each zone's polygon, if it has one: of the phase loops for a phase fault, else of the ground loops."""
    phase = loop is not None and not loop.loop.endswith("G")
    shapes = {zone: polygons[phase] for zone, polygons in zones.items()}
    return {zone: polygon for zone, polygon in shapes.items() if len(polygon) > 2}


def extent_ohm(
    shapes: dict[str, NDArray[np.float64]], z1: complex | None, view: RelayView
) -> NDArray[np.float64]:
    """Corners (2, 2) of what must be seen: zones, line, the fault's impedance, the origin."""
    points = [np.zeros((1, 2)), *shapes.values()]
    points += [np.array([[z1.real, z1.imag]])] if z1 is not None else []
    loop, load = view.facts.loop, view.facts.load_ohm
    if loop:
        points.append(np.array([[loop.r_ohm, loop.x_ohm]]))
    elif len(points) == 1 and load:
        points.append(1.3 * np.array([[load.r_ohm, load.x_ohm]]))
    every = np.concatenate(points)
    return np.array([every.min(axis=0), every.max(axis=0)])


def _timeline(
    relay: str, spans_of: dict[str, list[Span]], summary: Summary, end_ms: float
) -> list[TimelineRow]:
    """Fault, direction, zones and other elements by name, trip logic, breaker."""
    zero = summary.inception.zero_ns
    found: dict[str, list[Bar]] = {}
    for name, spans in spans_of.items():
        node, _, data = name.rpartition(".")
        kind = "operate" if data in OPERATIONS else KIND_OF_DATA.get(data, "start")
        label = node if data in KIND_OF_DATA else name
        found.setdefault(label, []).extend(
            Bar((on - zero) / 1e6, end_ms if off is None else (off - zero) / 1e6, kind, name)
            for on, off in spans
        )
    timeline = []
    if summary.faults:
        numbers = sorted({f.fault for f in summary.faults})  # each fault has its lane
        bars = [
            Bar(
                f.on_ms,
                end_ms if f.off_ms is None else f.off_ms,
                "fault",
                f.type,
                numbers.index(f.fault),
                len(numbers),
            )
            for f in summary.faults
        ]
        timeline.append(TimelineRow("fault", bars))
    for label in sorted(found, key=_place):
        bars = sorted(found[label], key=lambda bar: bar.kind == "operate")  # operate over start
        timeline.append(TimelineRow(label, bars))
    timeline += _digital(summary, end_ms)
    breaker = summary.relays[relay].breaker or RECORD
    if breaker in summary.breakers:
        bars = _open_poles(summary.breakers[breaker], end_ms)
        timeline.append(TimelineRow(breaker, bars))
    return timeline


def _digital(summary: Summary, end_ms: float) -> list[TimelineRow]:
    """A replayed record's own digital channels, those that changed first."""
    rows = []
    for channel in summary.digital[:DIGITAL_ROWS]:
        bars = [Bar(on, end_ms if off is None else off, "record", channel.name) for on, off in channel.on_ms]
        rows.append(TimelineRow(channel.name, bars))
    return rows


KIND_OF_DATA: dict[str, Kind] = {
    "Str": "start", "Op": "operate", "Tr": "operate", "DirFwd": "forward", "DirRev": "reverse",
    "PhyHealth": "blocked",
}  # fmt: skip
OPERATIONS = ("OpIn", "OpEx", "NgOp", "ResOp", "WeiOp")
"""Data of a lane of their own."""


def _place(label: str) -> tuple[int, int, str]:
    """Direction and phase selection first, then the zones by number, then the rest, the trip logic last."""
    order = ("RDIR", "PHS", "PDIS", "", "PTRC")
    group = next((k for k, head in enumerate(order) if head and label.startswith(head)), 3)
    digits = "".join(c for c in label.partition(".")[0] if c.isdigit())
    return group, int(digits or 0), label


def _open_poles(breaker: BreakerFacts, end_ms: float) -> list[Bar]:
    """From a breaker's operations, when each pole was open."""
    bars = []
    poles: tuple[Kind, ...] = ("A", "B", "C")
    for lane, pole in enumerate(poles):
        closed = breaker.initially_closed is None or pole in breaker.initially_closed
        since = None if closed else float("-inf")
        for operation in breaker.operations:
            is_open = pole not in operation.poles_closed
            if is_open and since is None:
                since = operation.ms
            elif not is_open and since is not None:
                bars.append(Bar(since, operation.ms, pole, f"pole {pole} open", lane, 3))
                since = None
        if since is not None:
            bars.append(Bar(since, end_ms, pole, f"pole {pole} open", lane, 3))
    return bars
