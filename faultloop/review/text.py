"""A review as text and as tables: for one screen, and for the page."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

from rich.console import Console
from rich.table import Table
from rich.text import Text

from faultloop.io.messages import CHANNELS
from faultloop.review.facts import BusFacts, ElementFacts, FaultFacts, Phasor, Summary

Rows = list[tuple[str, ...]]
NONE = "-"

TRIP_COLUMNS = (
    "relay",
    "function",
    "loop",
    "poles",
    ">decided",
    ">received",
    "by",
    ">poles open",
    "fault",
    ">after it",
    "location",
)
ELEMENT_COLUMNS = ("relay", "element", ">start", ">operate", ">reset", ">times")
PHASOR_COLUMNS = ("relay", "when", ">at ms", *(f">{name}" for name in CHANNELS), ">Hz")
LOOP_COLUMNS = (
    "relay",
    "loop",
    ">R",
    ">X",
    ">|Z|",
    ">angle",
    ">X/X1 line",
    ">load |Z|",
    ">peak A",
    ">B",
    ">C",
)
BESIDE_COLUMNS = (">at", "record", ">until", "this relay")
BESIDE_TRIPS = "Trips of the record's own relay beside this one [ms]"
OPERATED = ("Op", "Tr", "OpIn", "OpEx")
"""Data of what operated, of breaker failure, too."""
MOST_BESIDE = 40
"""Of a record's digital channels, of which some have hundreds: trips by name, then what changed first."""
TRIP_NAME = re.compile(r"\btr(i?p)?\b|trip|ausl|disp|d[ée]clen|откл|сраб|跳", re.IGNORECASE)
"""How a record's channel of a trip is called, in the languages that records came in."""
BREAKER_COLUMNS = ("breaker", ">at", "command", "opened", "closed", "poles now closed")


def print_review(summary: Summary, console: Console, *, secondary: bool = False) -> None:
    """Prints what ``summarize`` made of a log; ``secondary``: what its values are, for the tables' titles."""
    for line in headline(summary):
        console.print(line, markup=False)
    for title, columns, rows in tables(summary):
        console.print()
        console.print(_table(title.replace("primary", "secondary") if secondary else title, columns, rows))
    if not any(own.trips for own in summary.relays.values()):
        console.print("\nNo trip.")
    console.print(f"\n{can_text(summary.can)}", markup=False)
    for warning in summary.warnings:
        console.print("warning: ", style="yellow", end="")
        console.print(warning, markup=False)


def headline(summary: Summary, *, named: bool = True) -> list[str]:
    """Log, faults and where time zero comes from, one line each; ``named``: with the scenario's name."""
    log, zero = summary.log, summary.inception
    name = f"{log.scenario}: " if log.scenario and named else ""
    size = f"{log.size_bytes / 1e6:.1f} MB"
    relays = f"relays {', '.join(log.relays)}" if log.relays else "no relay"
    lines = [f"{name}{log.duration_s:.4g} s from {log.start[:23]}Z, {relays}, {size}"]
    lines += [fault_text(fault) for fault in summary.faults]
    if zero.t_ns is None:
        return [*lines, f"Time zero: {zero.text}."]
    return [*lines, f"Time zero, {zero.t_ns / 1e6:.3f} ms into the log: {zero.text}."]


def fault_text(fault: FaultFacts) -> str:
    """``Fault F1 AG on AB at 40 %, 1 ohm: 0.000 ms to 200.000 ms``."""
    parts = [f"Fault {fault.called} {fault.type}"]
    if fault.line is not None:
        at = f"{100 * fault.at_pu:g} %" if fault.at_pu is not None else f"{fault.at_km or 0:g} km"
        parts.append(f"on {fault.line} at {at}")
    elif fault.bus is not None:
        parts.append(f"at bus {fault.bus}")
    ohms = [(fault.resistance_ohm, ""), (fault.ground_ohm, " to ground")]
    told = [f"{value:g} ohm{to}" for value, to in ohms if value]
    until = "the end" if fault.off_ms is None else f"{fault.off_ms:.3f} ms"
    return f"{', '.join([' '.join(parts), *told])}: {fault.on_ms:.3f} ms to {until}"


def can_text(can: BusFacts) -> str:
    """``12 CAN frames: 2 trip, 10 measurements``."""
    if not can.frames:
        return "No CAN frame."
    kinds = ", ".join(f"{count} {kind.lower().replace('_', ' ')}" for kind, count in can.kinds.items())
    return f"{can.frames} CAN frames: {kinds}"


def tables(summary: Summary) -> Iterable[tuple[str, Sequence[str], Rows]]:
    """Title, columns (``>``: right-aligned) and rows of each table that has something to say."""
    several = len(summary.faults) > 1
    trips = trip_rows(summary) if several else [(*row[:8], row[10]) for row in trip_rows(summary)]
    columns = TRIP_COLUMNS if several else (*TRIP_COLUMNS[:8], TRIP_COLUMNS[10])
    found = (
        ("Trips: decided by the relay, received by the breaker [ms]", columns, trips),
        (BESIDE_TRIPS, BESIDE_COLUMNS, trips_beside(summary)),
        ("Phasors: RMS primary, angle against VA before the fault", PHASOR_COLUMNS, phasor_rows(summary)),
        ("Faulted loop and load [ohm, primary], peak currents", LOOP_COLUMNS, loop_rows(summary)),
        ("Elements [ms]", ELEMENT_COLUMNS, element_rows(summary)),
        ("The record's own relay beside this one [ms]", BESIDE_COLUMNS, beside_rows(summary)),
        ("Breakers [ms]", BREAKER_COLUMNS, breaker_rows(summary)),
    )
    return [table for table in found if table[2]]


def trip_rows(summary: Summary) -> Rows:
    return [
        (
            name,
            trip.function,
            trip.loop or NONE,
            trip.poles or NONE,
            _fixed(trip.decided_ms, 2),
            _fixed(trip.received_ms, 2),
            " ".join(part for part in (trip.breaker, trip.received_by) if part) or NONE,
            _fixed(trip.opened_ms, 2),
            trip.fault or NONE,
            _fixed(trip.after_fault_ms, 2),
            _location(own.location),
        )
        for name, own in summary.relays.items()
        for trip in own.trips
    ]


def _location(text: str | None) -> str:
    return NONE if text is None else text.partition(" at ")[2] or text


def phasor_rows(summary: Summary) -> Rows:
    rows: Rows = []
    first = "before" if summary.inception.t_ns is not None else "last"
    for name, own in summary.relays.items():
        instants = (
            (first, own.prefault, own.frequency_hz.prefault),
            ("fault", own.fault, own.frequency_hz.fault),
        )
        for when, at, hz in instants:
            if at is not None:
                values = [phasor_text(channel, at[channel]) for channel in CHANNELS]
                rows.append((name, when, _fixed(at.ms, 1), *values, _fixed(hz, 3)))
    return rows


def phasor_text(channel: str, phasor: Phasor) -> str:
    """``126.8 kV -120.0°``; currents below 1 kA in ampere."""
    size, unit = phasor.magnitude, "V" if channel[0] == "v" else "A"
    angle = f"{round(phasor.angle_deg, 1) + 0.0:6.1f}°"  # + 0.0: no -0.0
    if size >= 1000:
        return f"{size / 1000:.2f} k{unit} {angle}"
    return f"{size:.1f} {unit} {angle}"


def loop_rows(summary: Summary) -> Rows:
    rows: Rows = []
    for name, own in summary.relays.items():
        loop, load = own.loop, own.load_ohm
        peaks = [peak.instantaneous if peak else None for peak in own.peak_current.values()]
        if not loop and not load and not any(peaks):
            continue
        found: tuple[str, ...] = (NONE,) * 6
        if loop:
            percent = NONE if loop.percent_of_line is None else f"{loop.percent_of_line:.1f} %"
            ohms = [_fixed(value, 2) for value in (loop.r_ohm, loop.x_ohm, loop.magnitude_ohm)]
            found = (loop.loop, *ohms, _fixed(loop.angle_deg, 1), percent)
        load_ohm = load.magnitude_ohm if load else None
        rows.append((name, *found, _fixed(load_ohm, 1), *(_fixed(peak, 0) for peak in peaks)))
    return rows


def element_rows(summary: Summary) -> Rows:
    """One row per logical node where its data are start and operate, else per data name."""
    rows: Rows = []
    for name, own in summary.relays.items():
        grouped: dict[str, dict[str, ElementFacts]] = {}
        for element in own.elements:
            node, _, data = element.name.rpartition(".")
            column = {"Str": "start", "Op": "operate", "Tr": "operate"}.get(data)
            key, column = (node, column) if column else (element.name, "start")
            grouped.setdefault(key, {})[column] = element
        for node, found in grouped.items():
            first = found.get("start") or found["operate"]
            on = [_fixed(found[c].first_ms, 2) if c in found else NONE for c in ("start", "operate")]
            off = "stays" if first.last_off_ms is None else _fixed(first.last_off_ms, 2)
            rows.append((name, node, *on, off, _times(first)))
    return rows


def beside_rows(summary: Summary) -> Rows:
    """What a replayed record's own digital channels did first, and what our elements did first, by time.

    A channel that was on from the record's start is told when it first goes.
    """
    start_ms = -summary.inception.zero_ns / 1e6
    channels = []
    for one in summary.digital:
        on, off = one.on_ms[0]
        if on > start_ms:
            channels.append((on, one.name, "stays" if off is None else _fixed(off, 2)))
        elif off is not None:
            channels.append((off, f"{one.name} off", NONE))
    kept = sorted(channels, key=lambda channel: (not TRIP_NAME.search(channel[1]), channel[0]))[:MOST_BESIDE]
    theirs = [(at, (_fixed(at, 2), name, until, "")) for at, name, until in kept]
    if not theirs:
        return []
    kinds = ("Str", *OPERATED)
    ours = [
        (element.first_ms, (_fixed(element.first_ms, 2), "", "", element.name.replace(".", " ")))
        for own in summary.relays.values()
        for element in own.elements
        if element.name.rpartition(".")[2] in kinds
    ]
    rows = [row for _, row in sorted([*theirs, *ours], key=lambda found: found[0])]
    left = len(channels) - len(theirs)
    return [*rows, ("", f"and {left} more", "", "")] if left else rows


def trips_beside(summary: Summary) -> Rows:
    """Of those rows the trips, the record's by their names and ours; none where the record has none."""
    rows = beside_rows(summary)
    theirs = [row for row in rows if row[1] and TRIP_NAME.search(row[1]) and not row[1].endswith(" off")]
    ours = [row for row in rows if row[3].rpartition(" ")[2] in OPERATED]
    return sorted(theirs + ours, key=lambda row: float(row[0])) if theirs else []


def _times(element: ElementFacts) -> str:
    """How often it was on; and when it first was, if that was over before the fault."""
    earlier = element.earlier_ms
    return str(element.times) + (f" (first {earlier[0]:.2f})" if earlier else "")


def breaker_rows(summary: Summary) -> Rows:
    return [
        (
            name,
            _fixed(operation.ms, 2),
            operation.command or NONE,
            operation.opened or NONE,
            operation.closed or NONE,
            operation.poles_closed or "none",
        )
        for name, breaker in summary.breakers.items()
        for operation in breaker.operations
    ]


def _fixed(value: float | None, digits: int) -> str:
    return NONE if value is None else f"{value:.{digits}f}"


def _table(title: str, columns: Sequence[str], rows: Rows) -> Table:
    out = Table(title=Text(title), title_justify="left", title_style="bold", box=None, padding=(0, 2, 0, 0))
    for column in columns:
        out.add_column(column.removeprefix(">"), justify="right" if column.startswith(">") else "left")
    for row in rows:
        out.add_row(*map(Text, row))
    return out
