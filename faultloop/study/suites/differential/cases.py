"""The cases of the suite, part by part, as data; docs/relay.md (PDIF) says what each shows."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from faultloop.study.suites.distance.network import BASE_KV, LINE
from faultloop.study.suites.schemes.network import (
    BEYOND_KM,
    FAULT_S,
    LENGTH_KM,
    TYPES,
    Z1,
    Case,
    Expected,
    Tables,
    fault,
    settings,
    single_line,
    three_ended,
)

PICKUP_A = 200.0
"""0.2 of 1000 A."""
CAN = {"fd": True}
QUIET = Expected(False, never="PDIF1 Str")
NONE = Expected(False)
TRIP = Expected(True, "PDIF1", 30.0)
BOTH = {"RA": TRIP, "RB": TRIP}
NOBODY = {"RA": QUIET, "RB": QUIET}
SATURATING = {
    "name": "C", "ratio": [1200.0, 5.0], "model": "saturating", "class": "TPX",
    "rw_ohm": 0.5, "burden_ohm": [2.0, 0.5],
}  # fmt: skip


def differential(length_km: float = LENGTH_KM, zones: bool = False, **keys: Any) -> Tables:
    """Settings with a line differential, without zones unless asked for."""
    own = {
        "pickup_a": PICKUP_A,
        "b1_us": LINE["b1_us_per_km"] * length_km,
        "b0_us": LINE["b0_us_per_km"] * length_km,
    }
    more: Mapping[str, Any] = {} if zones else {"pdis": None, "ptrc": None}
    return settings(pdif=own | keys, **more)


def on_line(**keys: Any) -> Tables:
    """The one line, its channel without a delay but the bus's unless said otherwise."""
    channel = {"delay_ms": 0.0} | keys.pop("channel", {})
    return single_line(channel=channel, can=CAN, **keys)


def angles(quick: bool) -> list[float]:
    """Points on wave."""
    return [0.0, 90.0] if quick else [float(a) for a in np.arange(0.0, 180.0, 22.5)]


def internal(quick: bool) -> Iterator[Case]:
    """A fault on the line, behind sources of any strength."""
    types = ("AG", "BC", "ABC") if quick else ("AG", "BC", "CAG", "ABC")
    for sources in ((14.0, 20.0),) if quick else ((14.0, 20.0), (4.0, 1200.0), (1200.0, 4.0)):
        for at in (0.02, 0.5, 0.98):
            for type_ in types:
                for angle in angles(quick):
                    where = f"{type_} at {100 * at:g} %, {angle:g} degrees"
                    yield Case(
                        f"{where}, sources {sources[0]:g} and {sources[1]:g} ohm",
                        on_line(sources=sources, duration_s=0.15, fault=[fault("AB", at, type_, angle)]),
                        differential(),
                        BOTH,
                    )


def external(quick: bool) -> Iterator[Case]:
    """A fault outside, both sides, by both characteristics: no start."""
    for characteristic in ("alpha", "percentage"):
        for place in ({"bus": "A"}, {"line": "BC", "at_pu": 0.02}):
            for type_ in ("AG", "BC") if quick else TYPES:
                for angle in angles(True) if quick else angles(False)[::2]:
                    own = {"type": type_, "angle_deg": angle, "after_s": 0.06} | place
                    where = "at A" if "bus" in place else "behind B"
                    yield Case(
                        f"{characteristic}, {type_} {where}, {angle:g} degrees",
                        on_line(duration_s=0.2, fault=[own]),
                        differential(characteristic=characteristic),
                        NOBODY,
                    )


def saturation(quick: bool) -> Iterator[Case]:
    """A current transformer at B saturates for a fault behind it; then a fault on the line beside it."""
    voltages = (60.0, 150.0) if quick else (40.0, 60.0, 100.0, 150.0, 250.0)
    for characteristic in ("alpha", "percentage"):
        for volts in voltages:
            for type_ in ("ABC",) if quick else ("ABC", "BC", "AG"):
                for angle in (0.0,) if quick else (0.0, 90.0):

                    def made(
                        *more: Tables, volts: float = volts, type_: str = type_, angle: float = angle
                    ) -> Tables:
                        own = on_line(
                            sources=(8.0, 20.0),
                            duration_s=0.4 if more else 0.3,
                            fault=[fault("BC", 0.01, type_, start_s=0.06 + angle / 18000), *more],
                            ct=[SATURATING | {"vs_v": volts}],
                        )
                        own["relay"][1]["ct"] = "C"
                        return own

                    name = f"{characteristic}, {type_} behind B, {angle:g} degrees, knee at {volts:g} V"
                    set_ = differential(characteristic=characteristic)
                    yield Case(name, made(), set_, {"RA": NONE, "RB": NONE})
                    then = Expected(True, "PDIF1", 160.0, 100.0)
                    second = fault("AB", 0.5, "AG" if type_ == "BC" else "BCG", start_s=0.16, name="F2")
                    if type_ != "ABC":
                        yield Case(f"{name}, then inside", made(second), set_, {"RA": then, "RB": then})


def open_circuit(quick: bool) -> Iterator[Case]:
    """A current transformer's circuit at B opens under load, below and above the pickup, one phase or all."""
    transformer = {"name": "C", "ratio": [1000.0, 1.0], "open_at_s": 0.1}
    told = Expected(False, event="PDIF1 OpnCT")
    whole = 14.0 + 20.0 + abs(Z1) * (LENGTH_KM + BEYOND_KM) / LENGTH_KM
    for amperes in (150.0, 800.0):
        half = math.asin(amperes * whole * math.sqrt(3) / (2e3 * BASE_KV))
        for phases in ("A",) if quick else ("A", "BC", "ABC"):
            kinds: tuple[tuple[dict[str, Any], Expected], ...] = (
                ({}, told),
                ({"open_ct": "trip"}, Expected(amperes > PICKUP_A)),
                ({"characteristic": "percentage"}, told),
            )
            for more, expected in kinds:
                tables = on_line(
                    duration_s=0.3, ct=[transformer | {"open_phases": phases, "open_for_s": 0.1}]
                )
                tables["source"][0]["angle_deg"] = 2 * math.degrees(half)
                tables["relay"][1]["ct"] = "C"
                said = ", ".join(f"{key} = {value}" for key, value in more.items()) or "as shipped"
                name = f"{phases} open and whole again, load of {amperes:g} A, {said}"
                yield Case(
                    name, tables, differential(sequence=False, **more), {"RA": expected, "RB": expected}
                )
    opened = on_line(duration_s=0.3, ct=[transformer], fault=[fault("AB", 0.5, "BC", start_s=0.2)])
    opened["relay"][1]["ct"] = "C"
    opened["ct"][0]["open_phases"] = "A"
    yield Case("A open, then BC inside", opened, differential(), BOTH)


def resistance(quick: bool) -> Iterator[Case]:
    """A-G through a resistance in the middle, under load: which element sees it."""
    seen = Expected(True, "PDIF1", 60.0)
    for ohm, by_phases in ((50.0, True), (300.0, True), (500.0, False), (1000.0, False)):
        faults = [fault("AB", 0.5, "AG", 30.0, resistance_ohm=ohm)]
        tables = on_line(fault=faults, duration_s=0.3)
        name = f"A-G through {ohm:g} ohm"
        yield Case(
            f"{name}, all elements",
            tables,
            differential(negative_a=PICKUP_A / 6, zero_a=PICKUP_A / 6),
            {"RA": seen, "RB": seen},
        )
        alone = seen if by_phases else NONE
        yield Case(f"{name}, phases alone", tables, differential(sequence=False), {"RA": alone, "RB": alone})


def charging(quick: bool) -> Iterator[Case]:
    """300 km take 108 A; a pickup of 60 A stands it with compensation only.  The line is energized, too."""
    for compensated in (True, False):
        own = differential(300.0, pickup_a=60.0, sequence=False)
        if not compensated:
            own["pdif"] |= {"b1_us": 0.0, "b0_us": 0.0}
        own["line"] = {key: [3 * part for part in pair] for key, pair in own["line"].items()}
        expected = NOBODY if compensated else {"RA": Expected(True), "RB": Expected(True)}
        name = "compensated" if compensated else "not compensated: trips"
        if not compensated:
            nothing = on_line(length_km=300.0, duration_s=0.2)
            nothing["breaker"][1]["closed"] = False
            yield Case(f"300 km, {name}", nothing, own, expected)
            continue
        for sources in ((14.0, 20.0), (14.0, None)):
            open_ = "" if sources[1] else ", far end without a source"
            tables = on_line(length_km=300.0, sources=sources, duration_s=0.2)
            yield Case(f"300 km, {name}{open_}", tables, own, expected)


def one_end(quick: bool) -> Iterator[Case]:
    """B has no source, or an open breaker: it trips with A."""
    faults = [fault("AB", 0.5, "AG")]
    yield Case("no source at B", on_line(sources=(14.0, None), fault=faults), differential(), BOTH)
    opened = on_line(fault=faults)
    opened["breaker"][1]["closed"] = False
    yield Case("breaker at B open", opened, differential(), {"RA": TRIP})
    grown = [
        fault("BC", 0.1, "AG", start_s=0.06),
        fault("AB", 0.5, "BG", start_s=0.12, name="F2"),
    ]
    late = Expected(True, "PDIF1", 120.0, 60.0)
    yield Case(
        "A-G behind B, then B-G inside", on_line(fault=grown), differential(), {"RA": late, "RB": late}
    )


def frequency(quick: bool) -> Iterator[Case]:
    """Off the nominal frequency, with load: no start; a fault then trips."""
    for hz in (47.0, 52.0) if quick else (47.0, 48.0, 49.0, 51.0, 52.0):
        quiet = on_line(source_hz=hz, duration_s=0.4)
        yield Case(f"{hz:g} Hz, load", quiet, differential(), NOBODY)
        own = on_line(source_hz=hz, duration_s=0.2, fault=[fault("AB", 0.5, "AG", start_s=0.06)])
        yield Case(f"{hz:g} Hz, A-G inside", own, differential(), BOTH)


def asymmetry(quick: bool) -> Iterator[Case]:
    """Aligned by the round trip while the two ways differ: an external fault of some kA."""
    for ms in (0.0, 2.0, 5.0) if quick else np.arange(0.0, 5.25, 0.5):
        channel = {"delay_ms": 5.0, "asymmetry_ms": float(ms)}
        beyond = on_line(channel=channel, duration_s=0.5, fault=[fault("BC", 0.1, "BC", start_s=0.35)])
        own = differential(alignment="channel", sequence=False)
        yield Case(f"{ms:g} ms, BC behind B, alpha", beyond, own, {"RA": NONE, "RB": NONE})
        inside = on_line(channel=channel, duration_s=0.5, fault=[fault("AB", 0.5, "BC", start_s=0.35)])
        if ms <= 2.0:
            trip = TRIP._replace(within_ms=40.0)
            yield Case(f"{ms:g} ms, BC inside, alpha", inside, own, {"RA": trip, "RB": trip})
    yield from percentage_limits()


LIMITS_MS = {1000.0: (2.75, 3.5), 2000.0: (2.25, 2.75)}
"""Ways that differ by so much: the percentage holds, and trips; 3.22 and 2.56 ms in closed form.  The bus
adds 0.2 ms: the second of two frames waits for the first."""


def percentage_limits() -> Iterator[Case]:
    """1 and 2 times 1000 A of load through the line: where the percentage trips."""
    whole = 14.0 + 20.0 + abs(Z1) * (LENGTH_KM + BEYOND_KM) / LENGTH_KM
    for amperes, limits in LIMITS_MS.items():
        half = math.asin(amperes * whole * math.sqrt(3) / (2e3 * BASE_KV))
        for ms, trips in zip(limits, (False, True), strict=True):
            tables = on_line(channel={"delay_ms": 5.0, "asymmetry_ms": ms}, duration_s=0.3)
            tables["source"][0]["angle_deg"] = 2 * math.degrees(half)
            expected = Expected(trips, "PDIF1" if trips else None)
            for rule in ("percentage", "alpha"):
                own = differential(alignment="channel", sequence=False, characteristic=rule)
                each = expected if rule == "percentage" else NONE
                yield Case(f"{ms:g} ms, load of {amperes:g} A, {rule}", tables, own, {"RA": each, "RB": each})


def channel(quick: bool) -> Iterator[Case]:
    """Delays, jitter, losses, another path, none at all, another's sets; times that are lost."""
    inside = [fault("AB", 0.5, "AG", start_s=0.35)]
    by_channel = differential(alignment="channel")
    later = {name: TRIP._replace(within_ms=60.0) for name in ("RA", "RB")}
    for name, keys, own in (
        ("20 ms", {"delay_ms": 20.0}, differential()),
        ("jitter 0.5 ms", {"delay_ms": 5.0, "jitter_ms": 0.5}, by_channel),
        ("loss 1 %", {"delay_ms": 5.0, "loss": 0.01}, by_channel),
        ("loss 10 %", {"delay_ms": 5.0, "loss": 0.1}, by_channel),
        ("path 5 to 12 ms", {"delay_ms": 5.0, "switch_at_s": [0.15], "switch_delay_ms": [12.0]}, by_channel),
        (
            "path 5 to 12 ms, ways that differ by 2 ms",
            {"delay_ms": 5.0, "switch_at_s": [0.15], "switch_delay_ms": [12.0], "switch_asymmetry_ms": [2.0]},
            by_channel,
        ),
        ("jitter 5 ms", {"delay_ms": 5.0, "jitter_ms": 5.0}, by_channel),
    ):
        yield Case(f"{name}, load", on_line(channel=keys, duration_s=0.5), own, NOBODY)
        yield Case(f"{name}, A-G inside", on_line(channel=keys, duration_s=0.5, fault=inside), own, later)
    high = [fault("AB", 0.5, "AG", start_s=0.25, resistance_ohm=300.0)]
    sensitive = {name: Expected(True, "PDIF1", 100.0) for name in ("RA", "RB")}
    for loss in (0.0, 0.05, 0.2):
        tables = on_line(channel={"delay_ms": 5.0, "loss": loss}, duration_s=0.4, fault=high)
        yield Case(f"loss {100 * loss:g} %, A-G through 300 ohm", tables, differential(), sensitive)
    near = {name: Expected(True, "PDIS1", 20.0, event="PDIF1 ChBlk: no currents") for name in ("RA", "RB")}
    gone = on_line(channel={"out_at_s": 0.1}, duration_s=0.5, fault=inside)
    yield Case("out, A-G inside: zones, and an alarm", gone, differential(zones=True), near)
    late = Expected(False, event="of 40 that are bridged")
    yield Case("60 ms, load: too late, and told", on_line(channel={"delay_ms": 60.0}, duration_s=0.4),
               differential(), {"RA": late, "RB": late})  # fmt: skip
    switch = {"delay_ms": 5.0, "switch_at_s": [0.15], "switch_delay_ms": [12.0], "switch_asymmetry_ms": [4.0]}
    found = Expected(False, event="PDIF1 ChAsym: the ways")
    yield Case("path 5 to 12 ms, ways that differ by 4 ms, load: told, harder rules",
               on_line(channel=switch, duration_s=0.5), by_channel, {"RA": found, "RB": found})  # fmt: skip
    ways = on_line(channel={"delay_ms": 6.0, "asymmetry_ms": 4.0}, duration_s=0.3)
    yield Case("ways that differ by 4 ms, by the time of all, load: told", ways, differential(),
               {"RA": found, "RB": found})  # fmt: skip
    wrong = on_line(channel={"misrouted": "RB", "misrouted_at_s": 0.1}, duration_s=0.5, fault=inside)
    yield Case("this end's own sets come back", wrong, differential(zones=True), {"RB": near["RB"]})
    for lost in (0.1, 0.2):
        clock = [{"node": "RB", "drift_ppm": 100.0, "offset_us": 0.0, "lost_at_s": lost}]
        told = Expected(False, event="PDIF1 ChBlk: no currents")
        tables = on_line(clock=clock, duration_s=0.5)
        yield Case(f"time lost at {lost:g} s, load", tables, differential(), {"RA": told, "RB": told})
    held = Expected(False, event="the round trip stands in for it")
    lost_ways = {"delay_ms": 6.0, "asymmetry_ms": 3.0}
    clock = [{"node": "RB", "drift_ppm": 500.0, "lost_at_s": 0.15}]
    own = differential(time_lost="hold")
    tables = on_line(channel=lost_ways, clock=clock, duration_s=0.6)
    yield Case("time lost, held by the round trip, load", tables, own, {"RA": held, "RB": held})
    tables = on_line(channel=lost_ways, clock=clock, duration_s=0.6, fault=inside)
    yield Case("the same, A-G inside", tables, own, later)
    wrong_clock = [{"node": "RB", "offset_us": 8000.0}]
    refused = Expected(False, event="PDIF1 ChBlk: no currents")
    yield Case("a clock that is wrong by 8 ms and not known to be, BC behind B",
               on_line(clock=wrong_clock, duration_s=0.3, fault=[fault("BC", 0.1, "BC", start_s=0.2)]),
               differential(), {"RA": refused, "RB": refused})  # fmt: skip
    apart = [{"node": "RB", "drift_ppm": 50.0, "offset_us": 123456.0, "lost_at_s": 0.0}]
    yield Case("clocks 123 ms apart, 50 ppm, by the round trip, load", on_line(clock=apart, duration_s=0.5),
               by_channel, NOBODY)  # fmt: skip
    yield Case("the same, A-G inside", on_line(clock=apart, duration_s=0.5, fault=inside), by_channel, later)


def time(quick: bool) -> Iterator[Case]:
    """Clocks that TIME_SYNC frames set: 100 ms apart and with 100 ppm each by themselves."""
    own = differential()
    clocks = [
        {"node": "RA", "offset_us": -20_000.0, "drift_ppm": -100.0},
        {"node": "RB", "offset_us": 80_000.0, "drift_ppm": 100.0},
    ]
    blocked = Expected(False, event="PDIF1 ChBlk: no currents")
    told = {"RA": blocked, "RB": blocked}
    inside = [fault("AB", 0.5, "AG", start_s=0.35)]
    for name, table, faults, expected in (
        ("load", {}, [], NOBODY),
        ("A-G inside", {}, inside, BOTH),
        ("stamps to 100 us, load", {"jitter_us": 100.0}, [], NOBODY),
        ("stamps to 100 us, A-G inside", {"jitter_us": 100.0}, inside, BOTH),
        ("steps by 0.3 ms, load", {"step_at_s": 0.25, "step_us": 300.0}, [], NOBODY),
        ("steps by 50 ms, load", {"step_at_s": 0.25, "step_us": 50_000.0}, [], told),
        ("not told any more, load", {"out_at_s": 0.15, "timeout_s": 0.15}, [], told),
    ):
        tables = on_line(clock=clocks, time_sync={"period_s": 0.05} | table, fault=faults, duration_s=0.5)
        yield Case(name, tables, own, expected)


def three_ends(quick: bool) -> Iterator[Case]:
    """A line with a tee, 40 km to each end."""
    own = differential(120.0)
    own["pdif"] |= {"b1_us": 0.0, "b0_us": 0.0}
    all_trip = {f"R{bus}": TRIP for bus in "ABC"}
    nobody = {f"R{bus}": QUIET for bus in "ABC"}
    for bus in "ABC":
        for type_ in ("AG", "BC") if quick else ("AG", "BC", "CAG", "ABC"):
            inside = three_ended([fault(f"{bus}T", 0.5, type_)], can=CAN)
            yield Case(f"{type_} inside, leg {bus}", inside, own, all_trip)
            outside = {"bus": bus, "type": type_, "angle_deg": 0.0, "after_s": FAULT_S}
            yield Case(f"{type_} outside at {bus}", three_ended([outside], can=CAN), own, nobody)
    apart = [{"node": "RB", "offset_us": 80_000.0, "drift_ppm": 50.0, "lost_at_s": 0.0},
             {"node": "RC", "offset_us": -30_000.0, "drift_ppm": -20.0, "lost_at_s": 0.0}]  # fmt: skip
    by_channel = {**own, "pdif": own["pdif"] | {"alignment": "channel"}}
    for where, place, expected in (
        ("inside, leg C", {"line": "CT", "at_pu": 0.5}, all_trip),
        ("outside at C", {"bus": "C"}, nobody),
    ):
        late = place | {"type": "BC", "start_s": 0.35}
        tables = three_ended([late], duration_s=0.5, can=CAN, clock=apart)
        yield Case(f"clocks apart, by the round trips, BC {where}", tables, by_channel, expected)


PARTS: dict[str, tuple[str, Callable[[bool], Iterator[Case]]]] = {
    "internal": ("Faults on the line", internal),
    "external": ("Faults outside", external),
    "saturation": ("A current transformer that saturates", saturation),
    "open-ct": ("A current transformer whose circuit opens", open_circuit),
    "resistance": ("Resistance, under load", resistance),
    "charging": ("What the line charges", charging),
    "one-end": ("One end alone, and faults that grow", one_end),
    "frequency": ("Off the nominal frequency", frequency),
    "asymmetry": ("Ways that differ", asymmetry),
    "channel": ("Channels and clocks that fail", channel),
    "time": ("A time that the bus tells", time),
    "three-ends": ("Three ends", three_ends),
}
