"""A relay's part of a review: its trips on their way, elements, phasors, the faulted loop, peaks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import astuple
from itertools import pairwise
from typing import overload

import numpy as np

from faultloop.io.mcap_reader import Entry, Log
from faultloop.io.messages import CHANNELS, LOOPS, POLES
from faultloop.loop.outcome import TripReport
from faultloop.loop.recorded import recorded_settings
from faultloop.review.facts import (
    ElementFacts,
    Event,
    FaultedLoop,
    FaultFacts,
    Frequency,
    Impedance,
    Inception,
    Network,
    Peak,
    Phasor,
    PhasorFacts,
    RelayFacts,
    TripFacts,
)
from faultloop.review.rows import RelayRows, faulted_loop, last_before, relay_rows, steadiest
from faultloop.review.survey import Survey

BEFORE_NS, AFTER_NS = 2_000_000_000, 10_000_000_000
"""Around the inception, what is looked at sample by sample."""
Place = tuple[str | None, str | None]
"""A relay's line and breaker."""


@overload
def after_ms(t_ns: int, zero: int) -> float: ...
@overload
def after_ms(t_ns: int | None, zero: int) -> float | None: ...
def after_ms(t_ns: int | None, zero: int) -> float | None:
    return None if t_ns is None else (t_ns - zero) / 1e6


def number(value: float) -> float | None:
    """A float, or None for what JSON cannot say."""
    return float(value) if math.isfinite(value) else None


def closed_poles(entry: Entry) -> str:
    """Closed poles of a BreakerStatus: ``ABC``, ``BC``, empty."""
    return "".join(pole for pole in POLES if entry.fields[f"pole_{pole.lower()}"])


def line_impedance(log: Log, relay: str) -> complex | None:
    """Positive-sequence impedance of the whole line by the relay's settings [ohm, primary]."""
    settings = recorded_settings(log, relay)
    z1, header = settings["line"].get("z1_ohm"), settings["relay"]
    if z1 is None:
        return None
    ratio = 1.0
    if header.get("ohms") == "secondary":
        ratio = header.get("vt_ratio", 1.0) / header.get("ct_ratio", 1.0)
    return complex(*z1) * ratio


def ratios(log: Log, relay: str) -> tuple[float, float] | None:
    """Of the relay's current and voltage transformers by its settings; None where they name none."""
    header = recorded_settings(log, relay)["relay"]
    ct, vt = header.get("ct_ratio", 1.0), header.get("vt_ratio", 1.0)
    return None if ct == vt == 1.0 else (float(ct), float(vt))


def trip_facts(trip: TripReport, zero: int, faults: Sequence[FaultFacts]) -> TripFacts:
    """The fault that a trip answers is the last that was applied before it."""
    before = [fault for fault in faults if fault.on_ns <= trip.t_ns]
    fault = max(before, key=lambda fault: fault.on_ns, default=None)
    return TripFacts(
        fault=None if fault is None else fault.called,
        fault_on_ms=None if fault is None else fault.on_ms,
        after_fault_ms=None if fault is None else after_ms(trip.received_ns, fault.on_ns),
        function=trip.function,
        zone=trip.zone,
        loop=trip.loop,
        poles=trip.pole_names,
        sample_count=trip.sample_count,
        decided_ns=trip.t_ns,
        decided_ms=after_ms(trip.t_ns, zero),
        breaker=trip.breaker,
        received_ns=trip.received_ns,
        received_ms=after_ms(trip.received_ns, zero),
        received_by=trip.received_by,
        opened_ns=trip.opened_ns,
        opened_ms=after_ms(trip.opened_ns, zero),
        poles_opened_ns=trip.poles_opened_ns,
    )


def relay_facts(
    log: Log, whole: Survey, network: Network, place: Place, trips: list[TripFacts]
) -> RelayFacts:
    """Elements, phasors before and in the fault, the faulted loop, peaks, frequency; ``place``: its line and
    its breaker."""
    zero = network.inception.t_ns
    cleared_ns = _cleared_ns(network, trips)
    centre = zero if zero is not None else whole.last_ns or 0
    rows = relay_rows(log, whole.name, centre - BEFORE_NS, centre + AFTER_NS)
    before, during = _instants(rows, whole, network, cleared_ns)
    reference = 0.0
    for index in (during, before):
        if index is not None and abs(rows.phasors[index, 0]) > 0:
            reference = float(np.angle(rows.phasors[index, 0]))
    return RelayFacts(
        line=place[0],
        breaker=place[1],
        samples=len(whole),
        sampling_hz=number(whole.sampling_hz),
        first_ns=whole.first_ns,
        last_ns=whole.last_ns,
        trips=trips,
        cleared_ns=cleared_ns,
        elements=_elements(whole, network.inception.zero_ns),
        prefault=_phasors(rows, before, network.inception.zero_ns, reference),
        fault=_phasors(rows, during, network.inception.zero_ns, reference),
        loop=_loop(rows, during, network, trips, line_impedance(log, whole.name)),
        load_ohm=_load(rows, before),
        peak_current={name: _peak(whole, k, zero) for k, name in enumerate(CHANNELS[3:], 3)},
        frequency_hz=Frequency(
            prefault=None if before is None else number(rows.frequency[before]),
            fault=None if during is None else number(rows.frequency[during]),
        ),
        location=next((e.text for e in reversed(network.events) if _is_location(e, rows.name)), None),
    )


def _is_location(event: Event, relay: str) -> bool:
    return event.source == relay and event.text.startswith("RFLO")


def _cleared_ns(network: Network, trips: Sequence[TripFacts]) -> int | None:
    """When the relay's fault state ended: its own breaker's first pole opened, or the last fault went.

    Of a relay that opened nothing: the first pole that opened anywhere.  None: it never ended.
    """
    zero = network.inception.t_ns
    if zero is None:
        return None
    times = [t for trip in trips for t in trip.poles_opened_ns.values()]
    if not times:
        times = [op.t_ns for b in network.breakers.values() for op in b.operations if op.opened]
    offs = [fault.off_ns for fault in network.faults if fault.off_ns is not None]
    if offs and len(offs) == len(network.faults):
        times.append(max(offs))
    return min((t for t in times if t > zero), default=None)


def _changes(network: Network) -> list[int]:
    """Every time at which the network changed: a fault on or off, a pole open or closed."""
    times = [t for fault in network.faults for t in (fault.on_ns, fault.off_ns) if t is not None]
    for breaker in network.breakers.values():
        times += [op.t_ns for op in breaker.operations if op.opened or op.closed]
    return times


def _instants(
    rows: RelayRows, whole: Survey, network: Network, cleared_ns: int | None
) -> tuple[int | None, int | None]:
    """Rows just before the fault and where the fault state was steadiest; None where there is none.

    The second lies in the last stretch of one and a half cycles or more in which nothing in the network
    changed (in the longest, if all are shorter), before the fault was cleared, and at least one cycle into
    it: the estimators' window.  A record without breakers says only by the elements' reset when the fault was
    over.
    """
    zero, cycle_ns, told = network.inception.t_ns, network.cycle_ns, network.inception.source == "plant"
    if zero is None or not len(rows):
        return last_before(rows, np.inf), None
    margin = 0 if told else cycle_ns / 2
    reset = None if told else _last_reset(whole, zero - margin)
    end_ns = int(rows.t_ns[-1]) + 1
    stop = max(min(cleared_ns or reset or end_ns, end_ns), zero)
    edges = sorted({zero, stop, *(t for t in _changes(network) if zero < t < stop)})
    stretches = list(pairwise(edges))
    long = [stretch for stretch in stretches if stretch[1] - stretch[0] >= 1.5 * cycle_ns]
    start, end = long[-1] if long else max(stretches, key=lambda s: s[1] - s[0], default=(zero, stop))
    during = steadiest(rows, start + cycle_ns, end, cycle_ns)
    if during is None:  # over before a cycle had passed: the last there is
        during = last_before(rows, end)
        during = during if during is not None and rows.t_ns[during] >= start else None
    return last_before(rows, zero - margin), during


def _last_reset(whole: Survey, since: float) -> int | None:
    """When the last element that started from ``since`` on had reset; None where one never did."""
    ends = [
        off
        for name, spans in whole.spans.items()
        for on, off in spans
        if name.endswith(".Str") and (off is None or off > since)
    ]
    return None if not ends or None in ends else max(end for end in ends if end is not None)


def _elements(whole: Survey, zero: int) -> list[ElementFacts]:
    """Every bit that ever was on, by the time it first was."""
    out = []
    for name, spans in whole.spans.items():
        # What was on in the fault: a filter that settles at the start of the log is not what is asked for.
        place = next((k for k, (_, off) in enumerate(spans) if off is None or off > zero), 0)
        first, last = spans[place], spans[-1]
        out.append(
            ElementFacts(
                name=name,
                first_ns=first[0],
                first_ms=after_ms(first[0], zero),
                last_off_ns=last[1],
                last_off_ms=after_ms(last[1], zero),
                times=len(spans),
                earlier_ms=[after_ms(on, zero) for on, _ in spans[:place]],
            )
        )
    return sorted(out, key=lambda element: (element.first_ns, element.name))


def _phasors(rows: RelayRows, index: int | None, zero: int, reference: float) -> PhasorFacts | None:
    """RMS magnitudes and angles at a row; angles against VA before the fault."""
    if index is None:
        return None
    turn = np.exp(-1j * reference)
    found = [Phasor(abs(z), math.degrees(np.angle(z * turn))) for z in rows.phasors[index].tolist()]
    t_ns = int(rows.t_ns[index])
    return PhasorFacts(t_ns, after_ms(t_ns, zero), *found)


def _ohm(z: complex) -> Impedance:
    return Impedance(z.real, z.imag, abs(z), math.degrees(math.atan2(z.imag, z.real)))


def _loop(
    rows: RelayRows, index: int | None, network: Network, trips: Sequence[TripFacts], z1: complex | None
) -> FaultedLoop | None:
    if index is None:
        return None
    fault_type = network.faults[0].type if network.faults else None
    found = faulted_loop(rows, index, [trip.loop for trip in trips], fault_type)
    if found is None:
        return None
    z = complex(rows.loops[index, LOOPS.index(found[0])])
    if not (math.isfinite(z.real) and math.isfinite(z.imag)):
        return None
    percent = 100 * z.imag / z1.imag if z1 is not None and z1.imag else None
    return FaultedLoop(*found, *astuple(_ohm(z)), percent_of_line=percent)


def _load(rows: RelayRows, index: int | None) -> Impedance | None:
    """Positive-sequence impedance before the fault."""
    if index is None:
        return None
    turn = np.exp(2j * np.pi / 3 * np.arange(3))
    v1, i1 = complex(rows.phasors[index, :3] @ turn), complex(rows.phasors[index, 3:] @ turn)
    return _ohm(v1 / i1) if abs(i1) > 1e-9 else None


def _peak(whole: Survey, channel: int, zero: int | None) -> Peak | None:
    """Greatest instantaneous value and greatest RMS phasor of a channel."""
    if not np.isfinite(whole.peaks[channel]):
        return None
    t_ns = int(whole.peak_ns[channel])
    return Peak(
        float(whole.peaks[channel]), t_ns, after_ms(t_ns, zero or 0), number(float(whole.rms[channel]))
    )


def relay_warnings(whole: Survey, own: RelayFacts, inception: Inception) -> list[str]:
    name = whole.name
    if not len(whole):
        return [f"{name}: no samples"]
    out = []
    bad = whole.not_numbers.tolist()
    for count in sorted({count for count in bad if count}):
        channels = ", ".join(
            name for name, own_count in zip(CHANNELS, bad, strict=True) if own_count == count
        )
        told = (
            "no sample is a number"
            if count == len(whole)
            else f"{count} of {len(whole)} samples are not numbers"
        )
        out.append(f"{name}: {channels}: {told}")
    if np.isnan(whole.rms).all():
        out.append(f"{name}: no phasor is a number")
    if whole.gaps:
        out.append(f"{name}: {whole.gaps} gap{'s' if whole.gaps > 1 else ''} in the samples")
    for trip in own.trips if own.breaker is not None else ():
        if trip.received_ns is None:
            out.append(f"{name}: its breaker {own.breaker} did not receive the trip of {trip.function}")
        elif trip.opened_ns is None:
            out.append(f"{name}: breaker {own.breaker} did not open poles {trip.poles} in this log")
    if own.prefault is None and inception.t_ns is not None:
        out.append(f"{name}: nothing before the fault; no pre-fault phasors")
    return out
