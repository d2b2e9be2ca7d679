"""The cases of the suite, part by part, as data; docs/relay.md (PSCH) says what each shows."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from faultloop.study.suites.schemes.network import (
    CHANNEL_MS,
    FAULT_S,
    LEG_KM,
    LENGTH_KM,
    TYPES,
    Z0,
    Z1,
    ZONES,
    Case,
    Expected,
    Tables,
    fault,
    parallel_lines,
    settings,
    single_line,
    three_ended,
)

SCHEMES = ("pott", "putt", "dcb", "dutt")
NONE = Expected(False)
ZONE2_MS = 350.0
REVERSAL_CHANNELS_MS = (0.24, 5.0, 20.0)
REVERSAL_LOADS_DEG = (8.0, 0.0, -8.0)
RANDOM = {False: 1000, True: 24}
"""Reverse faults beside a healthy line."""


def scheme(kind: str, **keys: object) -> Tables:
    """Settings with a scheme; the blocking one waits for the channel, too."""
    own: dict[str, object] = {
        "type": kind,
        **({"coordination_ms": CHANNEL_MS + 5.0} if kind == "dcb" else {}),
    }
    return settings(psch=own | keys)


def internal(quick: bool) -> Iterator[Case]:
    """A fault on the line: both ends trip, and not by zone 2's timer."""
    types = ("AG", "BC", "ABC") if quick else TYPES
    for kind in SCHEMES:
        for at in (0.02, 0.5, 0.98):
            for type_ in types:
                both = Expected(True, within_ms=30.0 if at == 0.5 else 40.0)
                yield Case(
                    f"{kind}, {type_} at {100 * at:g} %",
                    single_line(fault=[fault("AB", at, type_)]),
                    scheme(kind),
                    {"RA": both, "RB": both},
                )


SPEED_SIRS = (0.1, 1.0, 5.0, 10.0, 30.0)
SPEED_MS = {sir: 20.0 if sir <= 5 else 30.0 for sir in SPEED_SIRS}
"""From the fault to the reception at the breaker, worst, by the source's impedance over the line's."""


def speed(quick: bool) -> Iterator[Case]:
    """POTT over a channel of 0.24 ms with a pilot zone of 150 %, for faults anywhere on the line."""
    for sir in SPEED_SIRS[1::3] if quick else SPEED_SIRS:
        both = Expected(True, within_ms=SPEED_MS[sir])
        for at in (0.02, 0.5, 0.98) if quick else (0.02, 0.1, 0.3, 0.5, 0.7, 0.9, 0.98):
            for type_ in ("AG", "ABC") if quick else ("AG", "BC", "BCG", "ABC"):
                for angle in (0.0,) if quick else (0.0, 45.0, 90.0, 135.0):
                    yield Case(
                        f"SIR {sir:g}, {type_} at {100 * at:g} %, {angle:g} degrees",
                        single_line((sir * abs(Z1), 20.0), {"delay_ms": 0.24}, 0.15,
                                    fault=[fault("AB", at, type_, angle)]),
                        scheme("pott"),
                        {"RA": both, "RB": both},
                    )  # fmt: skip


def external(quick: bool) -> Iterator[Case]:
    """A fault behind B, in zone 2 of A; then the same without the signal."""
    types = ("AG", "BC") if quick else TYPES
    for type_ in types:
        beyond = [fault("BC", 0.1, type_)]
        for kind in SCHEMES:
            yield Case(
                f"{kind}, {type_} behind B",
                single_line(fault=beyond),
                scheme(kind),
                {"RA": NONE, "RB": NONE},
            )
        lost = single_line(channel={"out_at_s": 0.0}, fault=beyond)
        yield Case(f"pott, {type_} behind B, signal lost", lost, scheme("pott"), {"RA": NONE, "RB": NONE})
        over = {"RA": Expected(True, "PSCH1", 40.0), "RB": NONE}
        yield Case(f"dcb, {type_} behind B, signal lost: overtrips", lost, scheme("dcb"), over)


def channel(quick: bool) -> Iterator[Case]:
    """The channel is gone, a frame is lost, a frame is another's."""
    near = [fault("AB", 0.9, "AG")]
    beat = {"heartbeat_s": 0.05}
    late = Expected(True, "PDIS2", 375.0, ZONE2_MS, event="PSCH1 LosOfGrd")
    fast = Expected(True, "PDIS1", 20.0)
    for name, keys in (
        ("out", {"out_at_s": 0.0}),
        ("misrouted", {"misrouted": "RB"}),
    ):
        gone = single_line(channel=keys, duration_s=0.6, fault=near, can=beat)
        expected = {"RA": late, "RB": fast} if name == "out" else {"RB": fast}
        yield Case(f"pott, channel {name}: falls back, and tells", gone, scheme("pott"), expected)
    whole = single_line(fault=near)
    yield Case("pott, no frame lost", whole, scheme("pott"), {"RA": Expected(True, "PSCH1", 30.0)})
    loss = {"name": "B1", "kind": "loss", "node": "RB", "message": "pilot", "pattern": "1" + "0" * 99}
    hit = single_line(fault=near, bus_fault=[loss | {"start_s": FAULT_S}])
    yield Case("pott, first frame lost: one repetition later", hit, scheme("pott"),
               {"RA": Expected(True, "PSCH1", 32.0)})  # fmt: skip


def beginning(quick: bool) -> Iterator[Case]:
    """A fault of line 1 close to the strong source at B: nobody of line 2 trips."""
    draw = np.random.default_rng(2026)
    for number in range(RANDOM[quick]):
        type_ = TYPES[draw.integers(len(TYPES))]
        at, angle = draw.uniform(0.9, 0.999), draw.uniform(0, 360)
        strong, weak = float(np.exp(draw.uniform(np.log(4.0), np.log(20.0)))), draw.uniform(20.0, 80.0)
        delay = draw.uniform(0.0, 10.0)
        place = f"{type_} at {100 * at:.1f} %, {angle:.0f} degrees"
        yield Case(
            f"{number}: {place}, sources {weak:.0f} and {strong:.1f} ohm, channel {delay:.1f} ms",
            parallel_lines((weak, strong), delay_ms=delay, duration_s=0.2,
                           fault=[fault("L1", at, type_, angle)]),
            scheme("pott"),
            {"R2A": NONE, "R2B": NONE},
        )  # fmt: skip


def reversals(quick: bool) -> Iterator[tuple[float, float, Tables]]:
    """Channel [ms], load [degrees] and scenario of each reversal: line 1's breaker at B opens after 40 ms, at
    A after 60.

    The direction follows when something else has stood for a cycle, and the power of the change goes that way
    (RDIR): some 25 to 30 ms after B's breaker.  So the reversal must last for as long, which it does by the
    channel that delays A's trip; and the load that line 2 takes over must not outweigh that power, as it does
    at R2B for a load from A to B.  Without load, or with one from B to A, both ends turn.
    """
    types = ("AG", "BC") if quick else ("AG", "BC", "BCG", "ABC")
    for delay in REVERSAL_CHANNELS_MS:
        for load in REVERSAL_LOADS_DEG:
            for at in (0.90,) if quick else (0.90, 0.97):
                for type_ in types:
                    for angle in (0.0,) if quick else (0.0, 45.0, 90.0, 135.0):
                        faults = [fault("L1", at, type_, angle)]
                        own = parallel_lines((14.0, 14.0), (60.0, 40.0), delay, load_deg=load, fault=faults)
                        yield delay, load, own


def reversal(quick: bool) -> Iterator[Case]:
    """With the guard nobody of the healthy line trips (without it: `report`); nor with a zone as pilot."""
    for number, (delay, load, tables) in enumerate(reversals(quick)):
        f = tables["fault"][0]
        name = (
            f"{number}: {f['type']} at {100 * f['at_pu']:g} %, {f['angle_deg']:g} degrees, {delay:g} ms, load"
        )
        name += f" {load:g} degrees"
        nobody = {"R2A": NONE, "R2B": NONE}
        yield Case(name, tables, guarded(60.0), nobody)
        yield Case(f"{name}, as shipped", tables, scheme("pott"), nobody)
    spreads = parallel_lines(
        (14.0, 14.0), (60.0, 40.0), fault=[
            fault("L1", 0.97, "AG", start_s=0.06), fault("L2", 0.97, "AG", start_s=0.13, name="F2"),
        ],
    )  # fmt: skip
    spread = Expected(True, within_ms=170.0, after_ms=70.0)
    yield Case("reversal, then a fault on line 2", spreads, guarded(60.0), {"R2A": spread, "R2B": spread})


def guarded(hold_ms: float) -> Tables:
    """A directional pilot without time to coincide, so that the guard alone decides."""
    return scheme("pott", pilot="direction", coincidence_ms=0.0, reverse_hold_ms=hold_ms)


def weak_end(quick: bool) -> Iterator[Case]:
    """B has no source, or an open breaker; what is behind it is no echo's matter."""
    lonely = (14.0, None)
    far = [fault("AB", 0.9, "AG")]
    strong = Expected(True, "PSCH1", 50.0)
    echo = scheme("pott", weak_infeed="echo")
    yield Case("no source at B: echo", single_line(lonely, fault=far), echo,
               {"RA": strong, "RB": Expected(False, event="PSCH1 Echo")})  # fmt: skip
    trips = {"RA": strong, "RB": Expected(True, "PSCH1", 60.0)}
    both = scheme("pott", weak_infeed="echo-and-trip")
    yield Case("no source at B: echo and trip", single_line(lonely, fault=far), both, trips)
    without = single_line(lonely, fault=far, duration_s=0.5)
    yield Case("no source at B, no echo: zone 2", without, scheme("pott"),
               {"RA": Expected(True, "PDIS2", 380.0, ZONE2_MS), "RB": NONE})  # fmt: skip
    opened = single_line(fault=far)
    opened["breaker"][1]["closed"] = False
    yield Case("breaker at B open: echo at once", opened, echo,
               {"RA": Expected(True, "PSCH1", 35.0), "RB": Expected(False, event="PSCH1 Echo")})  # fmt: skip
    behind = single_line(lonely, fault=[fault("BC", 0.1, "AG")])
    yield Case("fault behind the weak end: no echo", behind, both, {"RA": NONE, "RB": NONE})
    stuck = [
        {"kind": "loss", "node": "RB", "message": "pilot"},
        {"kind": "forging", "node": "RB", "message": "pilot", "content": "crafted", "rate_hz": 50.0},
    ]
    told = Expected(False, event="PSCH1 ProRx for 200 ms")
    noise = single_line(duration_s=0.5, bus_fault=stuck)
    yield Case("signal of B stuck, nothing happens", noise, both, {"RA": told, "RB": NONE})
    late = [fault("BC", 0.1, "AG", start_s=0.3)]
    beyond = single_line(duration_s=0.5, bus_fault=stuck, fault=late)
    yield Case("signal of B stuck, fault behind B: trips, which is why it is told", beyond, echo,
               {"RA": Expected(True, "PSCH1", 40.0)})  # fmt: skip
    quiet = single_line(lonely)
    yield Case("nothing happens", quiet, both, {"RA": NONE, "RB": NONE})


def poles(quick: bool) -> Iterator[Case]:
    """Single-pole tripping: faults that grow, and one on each of two lines."""
    single = {"mode": "single-pole", "zones": [1, 2]}
    bits = scheme("pott") | {"ptrc": single}
    one = scheme("pott", pole_bits=False) | {"ptrc": single}
    a = Expected(True, poles="A", within_ms=40.0)
    for at in (0.1, 0.9):
        yield Case(
            f"AG at {100 * at:g} %", single_line(fault=[fault("AB", at, "AG")]), bits, {"RA": a, "RB": a}
        )
    grows = [fault("AB", 0.9, "AG", start_s=0.06), fault("AB", 0.9, "BG", start_s=0.12, name="F2")]
    yield Case("AG grows to ABG", single_line(fault=grows), bits, {"RA": a, "RB": a})
    cross = parallel_lines((14.0, 14.0), fault=[
        fault("L1", 0.95, "AG", start_s=0.06), fault("L2", 0.95, "BG", start_s=0.06, name="F2"),
    ])  # fmt: skip
    b = a._replace(poles="B")
    right = {"R1A": a, "R1B": a, "R2A": b, "R2B": b}
    yield Case("AG on line 1, BG on line 2, near B", cross, bits, right)
    three = Expected(True, poles="ABC", within_ms=60.0)
    yield Case("the same with one bit: far ends three-pole", cross, one,
               {"R1A": three, "R2A": three})  # fmt: skip


def three_ends(quick: bool) -> Iterator[Case]:
    """A tee: POTT wants the signal of both others, DUTT that of any."""
    z1, z0 = (2 * LEG_KM / LENGTH_KM * z for z in (Z1, Z0))
    own: Tables = {"line": {"z1_ohm": [z1.real, z1.imag], "z0_ohm": [z0.real, z0.imag]}}
    # from end to end 80 km; what comes in at the tee makes a fault beyond it look up to 2.6 times as far
    own["pdis"] = [ZONES[0], ZONES[1] | {"reach_pu": 3.0}, ZONES[2]]
    pott, dutt = (scheme(kind) | own for kind in ("pott", "dutt"))
    trip, buses = Expected(True, within_ms=50.0), "ABC"
    for bus in buses:
        for type_ in ("AG", "BC") if quick else ("AG", "BC", "CAG", "ABC"):
            inside = three_ended([fault(f"{bus}T", 0.5, type_)])
            outside = three_ended([{"bus": bus, "type": type_, "angle_deg": 0.0, "after_s": FAULT_S}])
            for kind, settings_ in (("pott", pott), ("dutt", dutt)):
                name = f"{kind}, {type_}"
                yield Case(f"{name} on leg {bus}", inside, settings_, {f"R{b}": trip for b in buses})
                yield Case(f"{name} at bus {bus}", outside, settings_, {f"R{b}": NONE for b in buses})
    out = three_ended([fault("AT", 0.1, "AG")], {("RA", "RC"): {"out_at_s": 0.0}}, duration_s=0.5)
    yield Case(
        "pott, AG near A, A and C without their channel: C by zone 2", out, pott,
        {"RA": Expected(True, "PDIS1", 20.0), "RB": trip, "RC": Expected(True, "PDIS2", 380.0, ZONE2_MS)},
    )  # fmt: skip


def on_the_bus() -> Iterator[Case]:
    """Each scheme in a second with a fault on the line; nothing is expected but what the bus then carries."""
    faults = [fault("AB", 0.9, "AG", start_s=0.5)]
    for kind in SCHEMES:
        yield Case(f"{kind}, with transferred trips", single_line(duration_s=1.0, fault=faults),
                   scheme(kind, transfer=True), {})  # fmt: skip
    fd = {"fd": True}
    own = settings(pdif={"pickup_a": 200.0})
    yield Case("line differential, two ends", single_line(duration_s=1.0, fault=faults, can=fd), own, {})
    told = single_line(duration_s=1.0, fault=faults, can=fd, time_sync={})
    yield Case("line differential, two ends, a time that the bus tells", told, own, {})
    inside = [fault("AT", 0.5, "AG", start_s=0.5)]
    yield Case("line differential, three ends", three_ended(inside, duration_s=1.0, can=fd), own, {})


PARTS: dict[str, tuple[str, Callable[[bool], Iterator[Case]]]] = {
    "internal": ("Faults on the line", internal),
    "speed": ("How fast POTT is", speed),
    "external": ("Faults behind the far end", external),
    "channel": ("Channels that fail", channel),
    "beginning": ("The beginning of a fault on the parallel line", beginning),
    "reversal": ("Current reversal", reversal),
    "weak-end": ("An end that sees nothing", weak_end),
    "poles": ("Which poles", poles),
    "three-ends": ("Three ends", three_ends),
}
