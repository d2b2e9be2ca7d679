"""A relay's part of a review: its trips on their way, elements, phasors, the faulted loop, peaks."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np

from faultloop.io.mcap_reader import Entry
from faultloop.io.messages import CHANNELS, LOOPS, POLES
from faultloop.loop.outcome import TripReport
from faultloop.review.rows import RelayRows, faulted_loop, last_before, steadiest

Summary = dict[str, Any]


def after_ms(t_ns: int | None, zero: int) -> float | None:
    return None if t_ns is None else (t_ns - zero) / 1e6


def number(value: float) -> float | None:
    """A float, or None for what JSON cannot say."""
    return float(value) if math.isfinite(value) else None


def closed_poles(entry: Entry) -> str:
    """Closed poles of a BreakerStatus: ``ABC``, ``BC``, empty."""
    return "".join(pole for pole in POLES if entry.fields[f"pole_{pole.lower()}"])


def relay_facts(rows: RelayRows) -> dict[str, Any]:
    return {
        "samples": len(rows),
        "sampling_hz": number(rows.sampling_hz),
        "first_ns": int(rows.t_ns[0]) if len(rows) else None,
        "last_ns": int(rows.t_ns[-1]) if len(rows) else None,
    }


def trip_report(trip: TripReport, zero: int) -> dict[str, Any]:
    """A trip on its way: decided, received by the breaker, poles open."""
    return {
        "function": trip.function,
        "zone": trip.zone,
        "loop": trip.loop,
        "poles": trip.pole_names,
        "sample_count": trip.sample_count,
        "decided_ns": trip.t_ns,
        "decided_ms": after_ms(trip.t_ns, zero),
        "breaker": trip.breaker,
        "received_ns": trip.received_ns,
        "received_ms": after_ms(trip.received_ns, zero),
        "received_by": trip.received_by,
        "opened_ns": trip.opened_ns,
        "opened_ms": after_ms(trip.opened_ns, zero),
        "poles_opened_ns": trip.poles_opened_ns,
    }


def measured(
    rows: RelayRows, summary: Summary, own: dict[str, Any], context: tuple[float, complex | None]
) -> dict[str, Any]:
    """Elements, phasors before and in the fault, the faulted loop, peaks, frequency."""
    cycle_ns, z1 = context
    zero = summary["inception"]["t_ns"]
    own["cleared_ns"] = _cleared_ns(summary, own)
    before, during = _instants(rows, summary, own, cycle_ns)
    reference = None
    for index in (before, during):
        if index is not None and reference is None and abs(rows.phasors[index, 0]) > 0:
            reference = float(np.angle(rows.phasors[index, 0]))
    return {
        "elements": _elements(rows, zero or 0),
        "prefault": _phasors(rows, before, zero, reference),
        "fault": _phasors(rows, during, zero, reference),
        "loop": _loop(rows, during, summary, own["trips"], z1),
        "load_ohm": _load(rows, before),
        "peak_current": {name: _peak(rows, k, zero) for k, name in enumerate(CHANNELS[3:], 3)},
        "frequency_hz": {
            "prefault": None if before is None else number(rows.frequency[before]),
            "fault": None if during is None else number(rows.frequency[during]),
        },
        "location": next(
            (e["text"] for e in reversed(summary["events"]) if _is_location(e, rows.name)), None
        ),
    }


def _is_location(event: dict[str, Any], relay: str) -> bool:
    return event["source"] == relay and event["text"].startswith("RFLO")


def _cleared_ns(summary: Summary, own: dict[str, Any]) -> int | None:
    """When the relay's fault state ended: its own breaker's first pole opened, or the last fault went.

    Of a relay that opened nothing: the first pole that opened anywhere.  None: it never ended.
    """
    zero = summary["inception"]["t_ns"]
    if zero is None:
        return None
    times = [t for trip in own["trips"] for t in trip["poles_opened_ns"].values()]
    if not times:
        times = [op["t_ns"] for b in summary["breakers"].values() for op in b["operations"] if op["opened"]]
    offs = [fault["off_ns"] for fault in summary["faults"]]
    if offs and None not in offs:
        times.append(max(offs))
    return min((t for t in times if t > zero), default=None)


def _changes(summary: Summary) -> list[int]:
    """Every time at which the network changed: a fault on or off, a pole open or closed."""
    times = [t for fault in summary["faults"] for t in (fault["on_ns"], fault["off_ns"]) if t is not None]
    for breaker in summary["breakers"].values():
        times += [op["t_ns"] for op in breaker["operations"] if op["opened"] or op["closed"]]
    return times


def _instants(
    rows: RelayRows, summary: Summary, own: dict[str, Any], cycle_ns: float
) -> tuple[int | None, int | None]:
    """Rows just before the fault and where the fault state was steadiest; None where there is none.

    The second lies in the last stretch of one and a half cycles or more in which nothing in the network
    changed (in the longest, if all are shorter), before the fault was cleared, and at least one cycle into
    it: the estimators' window.  A record without breakers says only by the elements' reset when the fault was
    over.
    """
    zero = summary["inception"]["t_ns"]
    if zero is None or not len(rows):
        return last_before(rows, np.inf), None
    margin = 0 if summary["inception"]["source"] == "plant" else cycle_ns / 2
    reset = _last_reset(rows, zero - margin) if summary["inception"]["source"] != "plant" else None
    stop = own["cleared_ns"] or reset or int(rows.t_ns[-1]) + 1
    edges = sorted({zero, stop, *(t for t in _changes(summary) if zero < t < stop)})
    stretches = list(pairwise(edges))
    long = [stretch for stretch in stretches if stretch[1] - stretch[0] >= 1.5 * cycle_ns]
    start, end = long[-1] if long else max(stretches, key=lambda s: s[1] - s[0], default=(zero, stop))
    during = steadiest(rows, start + cycle_ns, end, cycle_ns)
    if during is None:  # over before a cycle had passed: the last there is
        during = last_before(rows, end)
        during = during if during is not None and rows.t_ns[during] >= start else None
    return last_before(rows, zero - margin), during


def _last_reset(rows: RelayRows, since: float) -> int | None:
    """When the last element that started from ``since`` on had reset; None where one never did."""
    ends = [
        off
        for name, spans in rows.spans.items()
        for on, off in spans
        if name.endswith(".Str") and (off is None or off > since)
    ]
    return None if not ends or None in ends else max(end for end in ends if end is not None)


def _elements(rows: RelayRows, zero: int) -> list[dict[str, Any]]:
    """Every bit that ever was on, by the time it first was."""
    out = []
    for name, spans in rows.spans.items():
        # The first time in the fault: a filter that settles at the start of the log is not what is asked for.
        first, last = next((s for s in spans if s[0] >= zero), spans[0]), spans[-1]
        out.append(
            {
                "name": name,
                "first_ns": first[0],
                "first_ms": after_ms(first[0], zero),
                "last_off_ns": last[1],
                "last_off_ms": after_ms(last[1], zero),
                "times": len(spans),
            }
        )
    return sorted(out, key=lambda element: (element["first_ns"], element["name"]))


def _phasors(
    rows: RelayRows, index: int | None, zero: int | None, reference: float | None
) -> dict[str, Any] | None:
    """RMS magnitudes and angles at a row; angles against VA before the fault."""
    if index is None:
        return None
    found = {}
    for channel, phasor in zip(CHANNELS, rows.phasors[index].tolist(), strict=True):
        turned = phasor * np.exp(-1j * (reference or 0.0))
        found[channel] = {"magnitude": abs(phasor), "angle_deg": math.degrees(np.angle(turned))}
    t_ns = int(rows.t_ns[index])
    return {"t_ns": t_ns, "ms": after_ms(t_ns, zero or 0), **found}


def _ohm(z: complex) -> dict[str, Any]:
    return {
        "r_ohm": z.real,
        "x_ohm": z.imag,
        "magnitude_ohm": abs(z),
        "angle_deg": math.degrees(math.atan2(z.imag, z.real)),
    }


def _loop(
    rows: RelayRows,
    index: int | None,
    summary: Summary,
    trips: list[dict[str, Any]],
    z1: complex | None,
) -> dict[str, Any] | None:
    """The faulted loop's impedance; ``percent_of_line`` by its reactance, as relays without more do it."""
    if index is None:
        return None
    types = [fault["type"] for fault in summary["faults"]]
    found = faulted_loop(rows, index, [trip["loop"] for trip in trips], types[0] if types else None)
    if found is None:
        return None
    z = complex(rows.loops[index, LOOPS.index(found[0])])
    if not (math.isfinite(z.real) and math.isfinite(z.imag)):
        return None
    percent = 100 * z.imag / z1.imag if z1 is not None and z1.imag else None
    return {"loop": found[0], "known_from": found[1], **_ohm(z), "percent_of_line": percent}


def _load(rows: RelayRows, index: int | None) -> dict[str, Any] | None:
    """Positive-sequence impedance before the fault."""
    if index is None:
        return None
    turn = np.exp(2j * np.pi / 3 * np.arange(3))
    v1, i1 = complex(rows.phasors[index, :3] @ turn), complex(rows.phasors[index, 3:] @ turn)
    return _ohm(v1 / i1) if abs(i1) > 1e-9 else None


def _peak(rows: RelayRows, channel: int, zero: int | None) -> dict[str, Any] | None:
    """Greatest instantaneous value and greatest RMS phasor of a channel."""
    size = np.abs(rows.samples[:, channel])
    if not np.isfinite(size).any():
        return None
    at = int(np.nanargmax(size))
    rms = np.abs(rows.phasors[:, channel])
    return {
        "instantaneous": float(size[at]),
        "t_ns": int(rows.t_ns[at]),
        "ms": after_ms(int(rows.t_ns[at]), zero or 0),
        "rms": float(np.nanmax(rms)) if np.isfinite(rms).any() else None,
    }


def relay_warnings(rows: RelayRows, own: dict[str, Any], inception: dict[str, Any]) -> list[str]:
    name = rows.name
    if not len(rows):
        return [f"{name}: no samples"]
    out = []
    bad = (~np.isfinite(rows.samples)).sum(axis=0).tolist()
    for count in sorted({count for count in bad if count}):
        channels = ", ".join(
            name for name, own_count in zip(CHANNELS, bad, strict=True) if own_count == count
        )
        out.append(f"{name}: {channels}: {count} of {len(rows)} samples are not numbers")
    if not np.isfinite(rows.phasors).all(axis=1).any():
        out.append(f"{name}: no phasor is a number")
    gaps = int((np.diff(rows.t_ns) > 1.5 * rows.interval_ns).sum()) if len(rows) > 1 else 0
    if gaps:
        out.append(f"{name}: {gaps} gap{'s' if gaps > 1 else ''} in the samples")
    for trip in own["trips"]:
        if own["breaker"] is not None and trip["received_ns"] is None:
            out.append(f"{name}: its breaker {own['breaker']} did not receive the trip of {trip['function']}")
        elif own["breaker"] is not None and trip["opened_ns"] is None:
            out.append(f"{name}: breaker {own['breaker']} did not open poles {trip['poles']} in this log")
    if own["prefault"] is None and inception["t_ns"] is not None:
        out.append(f"{name}: nothing before the fault; no pre-fault phasors")
    return out
