"""What a scenario's relays are set to do that nobody may have meant: told, and run all the same."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any

import numpy as np

from faultloop.config.cvt_circuit import chosen_circuit, differ
from faultloop.config.place import RelayPlace
from faultloop.loop.scenario import Scenario
from faultloop.plant import Plant
from faultloop.plant.series_capacitor import SeriesCapacitor
from faultloop.plant.vt import Vt
from faultloop.relay import RelaySettings
from faultloop.relay.coordination import SELECTIVE_MS, Doubt, along, load_doubts

LEAST_LOAD_A = 1.0
"""Less current is no load: a line that is open, or charges a little."""
DETECTOR_MS = 15.0
"""Until the detector of breaker failure knows that a current is gone."""
STUCK_MS = 1000.0
"""A breaker that takes so long is one that fails."""
ALIKE = 3.0
"""Impedances or voltages that differ by more are in other units, or of another line: a primary value where a
secondary one is meant, ohms of a kilometre, volts for kilovolts."""
SAME_CIRCUIT = 1 / 3
"""Of the voltage: a circuit that passes so much more or less at some frequency is another one.  The named
ones are 0.4 and more apart; a burden off by -50 and +25 %, 0.3 with A2, keeps zone 1 right
(``bench/cvt.py --burden``)."""
LONG_KM = 200.0
"""From here on a bolted fault at the far bus of a line whose charging is not told may measure inside zone 1
(bench/security.py, kind long, seed 97002: 12 of 151,778)."""
SAME_LINE = 0.15
"""Of an impedance's size: zones leave that much for errors of a line's data and of transformers, not more."""
TURN = np.exp(2j * np.pi / 3 * np.arange(3)) / 3


def settings_doubts(settings: RelaySettings, relay: str = "") -> list[str]:
    """One line each: file, key, what it does and what would be right."""
    return _told(settings, relay, settings.doubts)


def scenario_doubts(scenario: Scenario, settings: Mapping[str, RelaySettings], plant: Plant) -> list[str]:
    """The same of every relay of a scenario, with the load that ``plant`` begins with.

    What relays that share a file have in common is told once, what they have not with the relay's name."""
    found: dict[str, list[str]] = {}
    samples = plant.history(round(scenario.system.sampling_hz / scenario.system.frequency_hz))
    for number, place in enumerate(scenario.relay):
        own = settings[place.name]
        v1, i1 = _positive_sequence(samples[:, number])
        doubts = list(own.doubts)
        if abs(i1) >= LEAST_LOAD_A:
            doubts += load_doubts(own, complex(v1 / i1))
        doubts += [*_standing(own, abs(v1), abs(i1)), *_place_doubts(scenario, place, own)]
        for text in _told(own, place.name, doubts):
            found.setdefault(text, []).append(place.name)
    shared = Counter(own.path for own in settings.values())
    told = []
    for text, relays in found.items():
        path = settings[relays[0]].path
        names = ", ".join(f"relay '{name}'" for name in relays)
        named = path is None or len(relays) == shared[path] or names in text
        told.append(text if named else f"{text} ({names})")
    return told


def _positive_sequence(samples: np.ndarray) -> tuple[complex, complex]:
    """Voltage and current, RMS, of one cycle (n, 6)."""
    v1, i1 = ((_turn(len(samples)) @ samples).reshape(2, 3) * TURN).sum(axis=1)
    return complex(v1), complex(i1)


@cache
def _turn(cycle: int) -> np.ndarray:
    """Weights of one cycle's samples for the phasor, RMS."""
    return np.exp(-2j * np.pi * np.arange(cycle) / cycle) * np.sqrt(2) / cycle


def _standing(settings: RelaySettings, volts: float, amperes: float) -> Iterator[Doubt]:
    """Stages that start at once, by the positive sequence that a run begins with."""
    size = {"phase": 1.0, "phase-phase": math.sqrt(3), "positive-sequence": 1.0}
    for key in ("pioc", "ptoc"):
        for number, table in enumerate(getattr(settings, key), settings.first_place):
            if (table.quantity, table.direction, table.when) != ("phase", "none", "always"):
                continue
            if settings.amperes(table.pickup_a, 0.0) < amperes:
                least = amperes / settings.ct_ratio
                what = f"{table.pickup_a:g} is below the load that the run begins with, {least:.4g} A"
                yield Doubt(f"{key}[{number}].pickup_a", f"{what}: it starts at once; above that it is clear")
    if settings.psof.trip and settings.amperes(settings.psof.current_a, math.inf) < amperes:
        least = amperes / settings.ct_ratio
        what = f"{settings.psof.current_a:g} is below the load that the run begins with, {least:.4g} A"
        yield Doubt("psof.current_a", f"{what}: energising trips without a fault; above load and inrush")
    for key, sign in (("ptuv", 1), ("ptov", -1)):
        for number, table in enumerate(getattr(settings, key), settings.first_place):
            there = volts * size.get(table.quantity, math.inf) / settings.volts(1.0, 1.0)
            if math.isfinite(there) and there > 0 and sign * (table.start_v - there) > 0:
                side = ("above", "below") if sign > 0 else ("below", "above")
                what = f"{table.start_v:g} is {side[0]} what the run begins with, {there:.4g} V"
                yield Doubt(
                    f"{key}[{number}].start_v", f"{what}: it starts at once; {side[1]} that it is clear"
                )


def _place_doubts(scenario: Scenario, place: RelayPlace, settings: RelaySettings) -> Iterator[Doubt]:
    """Settings that do not go with where the relay is."""
    named = f"relay '{place.name}'"
    for key, wanted, has in (
        ("rrec", "breaker", place.breaker),
        ("rbrf", "breaker", place.breaker),
        ("rsyn", "synchro_vt", place.synchro_vt),
        ("line.z0m_ohm", "parallel", place.parallel),
    ):
        table: Any = settings
        for part in key.split("."):
            table = getattr(table, part)
        if table is not None and not has:
            yield Doubt(key, f"needs {wanted} of {named} in the scenario; without it nothing comes of it")
    if place.parallel is not None and settings.line.z0m_ohm is None:
        what = f"missing: without it {named} does nothing with the parallel line's current (parallel)"
        yield Doubt("line.z0m_ohm", what)
    if place.back_trip and settings.rbrf is None:
        yield Doubt("rbrf", f"missing: without it {named} never tells the breakers of back_trip to open")
    yield from _voltage_transformer(scenario, place, settings)
    yield from _breaker_times(scenario, place, settings)
    yield from _units(scenario, place, settings)
    yield from _charging(scenario, place, settings)


def _voltage_transformer(scenario: Scenario, place: RelayPlace, settings: RelaySettings) -> Iterator[Doubt]:
    """What the settings say of it, and the scenario otherwise."""
    own, there = settings.vt, next((vt for vt in scenario.all(Vt) if vt.name == place.vt), None)
    has = "the scenario's one" if there is None else f"the scenario's [[vt]] '{there.name}'"
    outcome = "zones without delay may reach beyond their end"
    circuit = None if there is None or there.model == "ideal" else there.circuit
    if own.kind == "ideal" and circuit is not None:
        right = 'kind = "cvt" with its circuit, or leave kind out'
        yield Doubt("vt.kind", f'"ideal", where {has} is capacitive: {outcome}; {right}')
    elif own.circuit is not None and circuit is None:
        what = "is ideal: its voltage is changed as if it were not, and"
        yield Doubt("vt.kind", f'"cvt", where {has} {what} {outcome}; kind = "ideal"')
    elif own.circuit is not None and circuit is not None and there is not None:
        hz = settings.relay.frequency_hz
        one, other = (
            chosen_circuit(own.circuit, own.burden_va, hz),
            chosen_circuit(circuit, there.burden_va, hz),
        )
        if (apart := differ(one, other, hz)) > SAME_CIRCUIT:
            what = f"passes a voltage that differs by up to {100 * apart:.0f} % from that of {has}: {outcome}"
            yield Doubt("vt.circuit", f"{what}; give the same circuit and burden_va")


def _breaker_times(scenario: Scenario, place: RelayPlace, settings: RelaySettings) -> Iterator[Doubt]:
    """Waits that end before the breaker has done what they wait for."""
    breaker = next((b for b in scenario.breaker if b.name == place.breaker), None)
    if breaker is None or breaker.operate_ms >= STUCK_MS:
        return
    cycle = 1e3 / scenario.system.frequency_hz
    opening = breaker.operate_ms + cycle  # to the last current zero
    waits = []
    if settings.rbrf is not None:
        waits.append(("rbrf.backup_ms", settings.rbrf.backup_ms, opening + DETECTOR_MS, "back-trips"))
        if settings.ptrc.mode == "single-pole":
            done = opening + DETECTOR_MS
            waits.append(("rbrf.retrip_ms", settings.rbrf.retrip_ms, done, "opens three poles"))
    if settings.rrec is not None:
        waits.append(("rrec.open_wait_ms", settings.rrec.open_wait_ms, opening, "ends in lockout"))
        waits.append(
            ("rrec.close_pulse_ms", settings.rrec.close_pulse_ms, breaker.close_ms, "ends in lockout")
        )
    for key, given, least, outcome in waits:
        if given <= least:
            what = f"{given:g} is over before breaker '{breaker.name}' is done, and {outcome} each time"
            yield Doubt(key, f"{what}; above {least:g}")


def _units(scenario: Scenario, place: RelayPlace, settings: RelaySettings) -> Iterator[Doubt]:
    """Values that are not those of the scenario's line and voltage: by far, and impedances by `SAME_LINE`."""
    line = next(line for line in scenario.line if line.name == place.line)
    unit = settings.ohm_ratio
    for key, own, there in (
        ("line.z1_ohm", settings.z1_ohm / unit, line.z1_ohm / unit),
        ("line.z0_ohm", settings.z0_ohm / unit, line.z0_ohm / unit),
        ("line.b1_us", settings.line.b1_us, line.b1_us_per_km * line.length_km),
        ("line.b0_us", settings.line.b0_us, line.b0_us_per_km * line.length_km),
        ("relay.nominal_kv", settings.relay.nominal_kv, scenario.system.base_kv),
    ):
        if own is not None and there == 0:
            yield Doubt(key, f"{own:g}, where the scenario's line has none; leave it out")
        elif own is not None and not 1 / ALIKE <= abs(own) / abs(there) <= ALIKE:
            given = f"{own:.4g}, of {abs(own):.4g} in size," if isinstance(own, complex) else f"{own:g}"
            what = f"{given} is {abs(own) / abs(there):.3g} of what the scenario has, {abs(there):.4g}"
            yield Doubt(key, f"{what}; see the unit" + ("" if key.endswith("_us") else ", and relay.ohms"))
        elif isinstance(own, complex):
            banks = (bank.x_ohm for bank in scenario.all(SeriesCapacitor) if bank.line == line.name)
            apart = min(abs(own - there), abs(own - there + 1j * sum(banks) / unit)) / abs(there)
            if apart > SAME_LINE:
                far = _too_far(settings, line.z1_ohm) if key == "line.z1_ohm" else ""
                what = f"{_ohms(own)} is {100 * apart:.0f} % off what the scenario has, {_ohms(there)}{far}"
                yield Doubt(key, f"{what}; give the line's own")


def _charging(scenario: Scenario, place: RelayPlace, settings: RelaySettings) -> Iterator[Doubt]:
    """A long line's charging that is not told to a relay whose zone ends on it."""
    line = next(line for line in scenario.line if line.name == place.line)
    if settings.line.b1_us is not None or line.length_km < LONG_KM or not line.b1_us_per_km > 0:
        return
    ends = (z for z in settings.tripping_zones if z.table.direction == "forward" and z.along <= 1)
    for zone in ends:
        if min(zone.delays) < SELECTIVE_MS:
            b1, b0 = line.b1_us_per_km * line.length_km, line.b0_us_per_km * line.length_km
            what = f"is not told, and zone {zone.table.zone} ends on a line of {line.length_km:g} km"
            outcome = "a fault at its far bus behind a weak source may measure inside"
            yield Doubt("line.b1_us", f"{what}: {outcome}; give b1_us = {b1:.4g}, b0_us = {b0:.4g}")
            return


def _ohms(z: complex) -> str:
    return f"[{z.real:.4g}, {z.imag:.4g}]"


def _too_far(settings: RelaySettings, line_ohm: complex) -> str:
    """The first zone without delay that ends beyond the line as it is, and not as the settings have it."""
    for zone in settings.tripping_zones:
        reach = along(settings, zone.table, line_ohm)
        if zone.table.direction != "reverse" and min(zone.delays) < SELECTIVE_MS and zone.along <= 1 < reach:
            return f": zone {zone.table.zone} reaches {reach:.3g} of that"
    return ""


def _told(settings: RelaySettings, relay: str, doubts: list[Doubt]) -> list[str]:
    where = settings.path or (f"settings of relay '{relay}'" if relay else "settings")
    return [f"{where}: {key}: {text}" for key, text in doubts]
