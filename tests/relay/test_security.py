"""Zone 1 for what is not on the line, while everything rings; and the two measures that it rests upon."""

from __future__ import annotations

from types import ModuleType
from typing import Any

import numpy as np
import pytest

from faultloop.loop.scenario import Scenario
from faultloop.plant import Plant
from faultloop.relay import Relay, RelaySettings
from faultloop.relay.loop_fit import centred, fit, gather
from faultloop.relay.recent import LENGTH, RECENT
from tests.load import load

SAMPLING_HZ = 4800
WARM = 1920
TYPES = ("AG", "BC", "CAG", "ABC", "CA")
LINE = {"model": "bergeron", "r1_ohm_per_km": 0.06, "x1_ohm_per_km": 0.4, "b1_us_per_km": 4.4,
        "r0_ohm_per_km": 0.24, "x0_ohm_per_km": 1.2, "b0_us_per_km": 2.6}  # fmt: skip


def network(length: float, fault: dict[str, object]) -> tuple[np.ndarray, int]:
    """Samples (n, 6) at A of X - A - B - C, the line of interest A - B, weak sources at both ends; the number
    of the first one of the fault."""
    plant = Plant(
        Scenario.from_dict(
            {
                "scenario": {"name": "security", "duration_s": 0.25},
                "system": {"frequency_hz": 50, "base_kv": 220},
                "source": [
                    {"name": "SX", "bus": "X", "z1_ohm": [16.5, 188.5], "z0_ohm": [16.5, 188.5]},
                    {"name": "SC", "bus": "C", "z1_ohm": [11.5, 131.0], "z0_ohm": [11.5, 131.0]},
                ],
                "line": [
                    {"name": "XA", "from": "X", "to": "A", "length_km": 30, **LINE},
                    {"name": "AB", "from": "A", "to": "B", "length_km": length, **LINE},
                    {"name": "BC", "from": "B", "to": "C", "length_km": 100, **LINE},
                ],
                "fault": [{"after_s": 0.05, **fault}],
                "relay": [{"name": "R", "line": "AB", "end": "from", "settings": "none"}],
            }
        )
    )
    blocks, begin = [plant.history(WARM)[:, 0]], 0
    while plant.sample_count < 1200:
        done = plant.advance(1200 - plant.sample_count)
        blocks.append(plant.samples[:done, 0].copy())
        for change in plant.changes:
            begin = begin or WARM - (-change.t_ns * SAMPLING_HZ // 10**9)
    return np.concatenate(blocks), begin


def relay_of(length: float) -> Relay:
    return Relay(
        RelaySettings.from_dict(
            {
                "relay": {"frequency_hz": 50, "nominal_kv": 220},
                "vt": {"kind": "ideal"},
                "line": {"z1_ohm": [0.06 * length, 0.4 * length], "z0_ohm": [0.24 * length, 1.2 * length]},
                "pdis": [
                    {"zone": 1, "reach_pu": 0.85},
                    {"zone": 2, "reach_pu": 0.85, "characteristic": "quad", "resistive_reach_ohm": 20.0},
                    {"zone": 3, "reach_pu": 0.5, "direction": "reverse", "delay_ms": 1000.0},
                    {"zone": 4, "reach_pu": 1.5, "delay_ms": 1000.0},
                ],
                "ptrc": {"zones": [4]},
            }
        )
    )


def starts(relay: Relay, samples: np.ndarray, begin: int) -> tuple[int, list[float]]:
    """Zones that have ever started (mask), and the first start of each of the four after the fault [ms], NaN
    if none."""
    done, words = 0, np.empty(len(samples), np.uint64)
    while done < len(samples):
        m = relay.advance(samples[done:])
        words[done : done + m] = relay.pickup
        done += m
    assert not (words[:begin] & np.uint64(0b1111)).any(), "a start before the fault"
    first = [np.flatnonzero(words & np.uint64(1 << zone)) for zone in range(4)]
    return int(np.bitwise_or.reduce(words)) & 0b1111, [
        1e3 * (f[0] - begin) / SAMPLING_HZ if len(f) else np.nan for f in first
    ]


@pytest.mark.parametrize("length", [100.0, 300.0])
@pytest.mark.parametrize("kind", TYPES)
def test_a_fault_behind_a_line_that_rings(length: float, kind: str) -> None:
    """../shared/cases/relay-reverse-long-line: 6 of 30 of these tripped zone 1 (100 km)."""
    for angle in range(0, 180, 30):
        x = network(length, {"line": "XA", "at_pu": 0.5, "type": kind, "angle_deg": float(angle)})
        zones, times = starts(relay_of(length), *x)
        assert not zones & 0b1011, f"{angle} degrees: zones {zones:04b} at {times}"


@pytest.mark.parametrize("kind", TYPES)
def test_a_fault_on_the_line_beyond(kind: str) -> None:
    for angle in range(0, 180, 30):
        x = network(250.0, {"line": "BC", "at_pu": 0.3, "type": kind, "angle_deg": float(angle)})
        zones, times = starts(relay_of(250.0), *x)
        assert not zones & 0b0111, f"{angle} degrees: zones {zones:04b} at {times}"


@pytest.mark.parametrize("kind", TYPES)
def test_a_fault_on_the_line_is_not_held_up(kind: str) -> None:
    for angle in range(0, 180, 60):
        x = network(100.0, {"line": "AB", "at_pu": 0.5, "type": kind, "angle_deg": float(angle)})
        zones, times = starts(relay_of(100.0), *x)
        assert zones & 0b0011, f"{angle} degrees"
        assert np.nanmin(times[:2]) <= 20.0, f"{angle} degrees: {times}"


@pytest.mark.parametrize("shape", [{}, {"characteristic": "quad", "resistive_reach_ohm": 20.0}])
@pytest.mark.parametrize("kind", TYPES)
def test_a_zone_to_both_sides_is_as_fast_behind(kind: str, shape: dict[str, Any]) -> None:
    """A depth behind the relay is one there: it counts against those with a direction alone."""
    head = {"frequency_hz": 50, "nominal_kv": 220}
    zone = {"zone": 1, "reach_pu": 0.5, "direction": "none"} | shape
    for angle in range(0, 180, 60):
        x, begin = network(100.0, {"line": "XA", "at_pu": 0.4, "type": kind, "angle_deg": float(angle)})
        relay = relay_with(head, [6.0, 40.0], [24.0, 120.0], [zone])
        assert picked_up(relay, x[: begin + 96]), f"{angle} degrees: not within a cycle"


# ---------------------------------------------------------------- drawn networks


def _cases() -> ModuleType:
    return load("bench/security_cases.py")


def relay_with(
    head: dict[str, Any], z1: list[float], z0: list[float], zones: list[dict[str, Any]], **line: float
) -> Relay:
    """With an ideal transformer."""
    line_of = {"z1_ohm": z1, "z0_ohm": z0} | line
    settings = {"relay": head, "vt": {"kind": "ideal"}, "line": line_of, "pdis": zones}
    return Relay(RelaySettings.from_dict(settings))


def picked_up(relay: Relay, samples: np.ndarray) -> bool:
    """Whether the first zone ever starts."""
    done = 0
    while done < len(samples):
        done += relay.advance(samples[done:])
        if (relay.pickup & np.uint64(1)).any():
            return True
    return False


def test_drawn_networks() -> None:
    """Seeded; the campaign itself is bench/security.py."""
    cases = _cases()
    judged = 0
    for number in range(60):
        case = cases.draw(2001, number, ("mixed", "long")[number % 2])
        samples, _ = cases.record(case, 1500.0)
        z1, z0 = ([case["line"][f"{part}{n}_ohm_per_km"] * case["length"] for part in "rx"] for n in (1, 0))
        for end in (0, 1):
            seen = cases.view(case, end)
            if seen.where == "inside" or not seen.bolted:
                continue
            judged += 1
            head = {"frequency_hz": case["f0"], "nominal_kv": case["kv"]}
            relay = relay_with(head, z1, z0, [{"zone": 1, "reach_pu": 0.8}])
            assert not picked_up(relay, samples[end]), (number, seen)
    assert judged > 40


def drawn_fault(
    seed: int, number: int, fault: int, end: int, order: int = 2, *, kind: str = "mixed",
    after_ms: float = 50.0, charged: bool = False, quad: bool = False,
) -> tuple[Relay, np.ndarray, tuple[str, bool]]:  # fmt: skip
    """A case of bench/security.py as one of its relays sees it, to 50 ms after the fault; where the fault is,
    and whether bolted.  ``charged``: the relay is told of the line's capacitance; ``quad``: in place of a
    mho."""
    cases = _cases()
    case = cases.another(cases.draw(seed, number, kind), fault)
    samples, start = cases.record(case, 1500.0, order)
    line, length = case["line"], case["length"]
    z1, z0 = ([line[f"{part}{n}_ohm_per_km"] * length for part in "rx"] for n in (1, 0))
    head = {"frequency_hz": case["f0"], "nominal_kv": case["kv"]}
    seen = cases.view(case, end)
    charging = {f"b{n}_us": line[f"b{n}_us_per_km"] * length for n in (1, 0) if charged}
    shape = {"characteristic": "quad", "resistive_reach_ohm": 40.0} if quad else {}
    relay = relay_with(head, z1, z0, [{"zone": 1, "reach_pu": 0.8} | shape], **charging)
    return relay, samples[end][: start + round(4.8 * after_ms)], (seen.where, seen.bolted)


@pytest.mark.parametrize(("number", "fault", "end"), [(4, 25, 1), (152, 19, 1), (630, 33, 0)])
def test_a_resistive_fault_beyond_that_the_phasors_pass_zone_1_on_their_way_to(
    number: int, fault: int, end: int
) -> None:
    """Behind 38 to 55 times the line, through 3 to 6 % of it: the fit has a resistance then that the
    characteristic does not let in (before: zone 1 after 16 to 21 ms)."""
    relay, samples, seen = drawn_fault(71001, number, fault, end)
    assert seen == ("beyond", False)
    assert not picked_up(relay, samples)


def test_a_line_beside_the_faulted_one_that_rings_more_than_it_changes() -> None:
    """256 km, ABC: the energy has lost its sign when phasors that ring say the other direction (before: zone
    1 after 26 ms)."""
    relay, samples, seen = drawn_fault(80001, 1944, 22, 1, order=4)
    assert seen == ("parallel", True)
    assert not picked_up(relay, samples)


@pytest.mark.parametrize(("number", "fault", "end"), [(5555, 34, 1), (10988, 19, 0)])
def test_a_line_beside_the_faulted_one_whose_current_rings_through_zero(
    number: int, fault: int, end: int
) -> None:
    """227 and 217 km, faults between two phases near the other line's middle: m of the mho swings from far
    ahead to far behind (before: zone 1 after 48 and 42 ms)."""
    relay, samples, seen = drawn_fault(91001, number, fault, end, order=4)
    assert seen == ("parallel", True)
    assert not picked_up(relay, samples)


@pytest.mark.parametrize(("number", "fault", "end"), [(225, 0, 0), (1815, 19, 1)])
def test_a_depth_behind_the_relay_makes_up_for_nothing_of_what_the_fit_leaves(
    number: int, fault: int, end: int
) -> None:
    """Beyond a line of 397 km, and on the one beside it of 209 km: m of the fit is -0.3, as deep as the fault
    may look behind for what is left, 0.3 (before: zone 1 after 12.6 and 10.2 ms)."""
    relay, samples, seen = drawn_fault(97002, number, fault, end, order=4, kind="long")
    assert seen == (("beyond", "parallel")[number == 1815], True)
    assert not picked_up(relay, samples)


def test_a_depth_that_jumps_behind_the_relay_in_the_first_cycle() -> None:
    """Beyond a line of 306 km: m of the fit comes from 1.6 to -0.2 within 4 ms, with 0.1 left and a
    resistance that lets it (before: zone 1 after 11.5 ms)."""
    relay, samples, seen = drawn_fault(97003, 3856, 23, 0, order=4, kind="long", charged=True)
    assert seen == ("beyond", True)
    assert not picked_up(relay, samples)


@pytest.mark.parametrize(
    ("number", "fault", "end"), [(155, 18, 1), (893, 28, 1), (1708, 16, 0), (1901, 33, 1), (2104, 7, 0)]
)
def test_a_ground_fault_at_the_far_bus_that_the_line_s_charging_brings_near(
    number: int, fault: int, end: int
) -> None:
    """Lines of 240 to 395 km at 60 Hz, two beside each other: by R and X they are at 0.36 to 0.78 of the line
    and stay there (bench/long_line_reach.py's closed form); by the line's equations where they are."""
    drawn = {"order": 4, "kind": "long", "after_ms": 180.0}
    relay, samples, _ = drawn_fault(97002, number, fault, end, **drawn, charged=True)
    assert not picked_up(relay, samples)
    relay, samples, _ = drawn_fault(97002, number, fault, end, **drawn)
    assert picked_up(relay, samples), "no longer by R and X: docs/relay.md says so"


# ---------------------------------------------------------------- the fit of the loop

CONSTANTS = np.zeros(1, np.dtype([("turn_per_value", "f8")]))
CONSTANTS["turn_per_value"] = 2 * np.pi / 96


def recent(v: np.ndarray, i: np.ndarray) -> np.ndarray:
    """Phase A's last values."""
    r = np.zeros(1, RECENT)
    r["value"][0, :, 0], r["value"][0, :, 3] = v[-LENGTH:], i[-LENGTH:]
    r["head"] = LENGTH - 1
    return r


def waves(frequencies: tuple[float, ...], depth: float, arc: float) -> tuple[np.ndarray, np.ndarray]:
    """v and i of a loop of ``depth`` of 4 + 30j ohm at 50 Hz, with an offset in i, and ``arc`` ohm."""
    t = np.arange(LENGTH) / SAMPLING_HZ
    r, inductance = 4.0 * depth, 30.0 * depth / (2 * np.pi * 50)
    i, v = 700.0 * np.exp(-t / 0.03), (r - inductance / 0.03) * 700.0 * np.exp(-t / 0.03)
    for k, f in enumerate(frequencies):
        w, size = 2 * np.pi * f, 1000.0 / (k + 1)
        i = i + size * np.sin(w * t + k)
        v = v + size * (r * np.sin(w * t + k) + w * inductance * np.cos(w * t + k))
    return v + arc * i, i


@pytest.mark.parametrize("window", [((4, 4, 4), 28), ((18, 18, 18), 92), ((48, 1, 1), 96)])
@pytest.mark.parametrize("arc", [0.0, 5.0])
def test_the_fit_is_exact_for_every_waveform(window: tuple[tuple[int, int, int], int], arc: float) -> None:
    v, i = waves((50.0, 137.0, 251.0), 0.6, arc)
    sums = gather(CONSTANTS[0], recent(v, i)[0], (4 + 30j, 0j), 0, *window)
    m, left, r = fit(sums, 1)
    assert r == pytest.approx(arc, abs=0.05)
    assert m == pytest.approx(0.6, abs=0.01)
    assert left < 0.03


def test_the_fit_says_where_the_waveforms_differ() -> None:
    """A ringing whose voltage is not that of the line: m is wrong, and what is left says so."""
    v, i = waves((50.0,), 1.5, 0.0)
    ringing = 600.0 * np.sin(2 * np.pi * 170 * np.arange(LENGTH) / SAMPLING_HZ)
    sums = gather(CONSTANTS[0], recent(v, i + ringing)[0], (4 + 30j, 0j), 0, (4, 4, 4), 28)
    m, left, _ = fit(sums, 1)
    assert m + 2 * left > 1.0
    assert left > 0.2


def test_three_means_of_a_length_leave_the_least_of_a_travelling_wave() -> None:
    """The worst of 1 to 1.5 kHz, as the open end of 50 to 75 km rings, thirty times the drop of the line."""
    v, i = waves((50.0,), 0.6, 0.0)
    found = {}
    for means in ((12, 12, 12), (23, 12, 1), (34, 1, 1)):
        window = 96 - sum(means) + 2
        left = []
        for f in np.arange(1000.0, 1500.0, 20.0):
            wave = 30 * 0.6 * 30e3 * np.sin(2 * np.pi * f * np.arange(LENGTH) / SAMPLING_HZ)
            sums = gather(CONSTANTS[0], recent(v + wave, i)[0], (4 + 30j, 0j), 0, means, window)
            left.append(fit(sums, 1)[1])
        found[means] = max(left)
    assert found[12, 12, 12] < 0.05
    assert found[23, 12, 1] > 2 * found[12, 12, 12]
    assert found[34, 1, 1] > 10 * found[12, 12, 12]


def test_no_current_is_no_depth() -> None:
    sums = gather(CONSTANTS[0], recent(np.ones(LENGTH), np.zeros(LENGTH))[0], (4 + 30j, 0j), 0, (4, 4, 4), 28)
    assert fit(sums, 1) == (np.inf, np.inf, 0.0)


def test_a_voltage_that_is_shifted_falls_out_without_means() -> None:
    """What a transformer adds and goes on adding: the fit takes it for depth and doubt; without means it is
    gone, and the other figures stay."""
    v, i = waves((50.0, 137.0), 0.6, 0.0)
    window = 96
    shifted = gather(CONSTANTS[0], recent(v + 20e3, i)[0], (4 + 30j, 0j), 0, (48, 1, 1), window)
    assert fit(shifted, 1)[1] > 0.3
    m, left, _ = fit(centred(shifted, window), 1)
    assert m == pytest.approx(0.6, abs=0.02)
    assert left < 0.05
    plain = gather(CONSTANTS[0], recent(v, i)[0], (4 + 30j, 0j), 0, (48, 1, 1), window)
    assert centred(shifted, window) == pytest.approx(centred(plain, window), rel=1e-6, abs=1.0)


@pytest.mark.parametrize(
    ("number", "fault", "end", "most"),
    [
        (836, 9, 0, 20),
        (4844, 23, 0, 20),
        (13124, 18, 0, 20),
        (18251, 17, 1, 20),
        (24561, 22, 0, 30),  # 298 km
        (18080, 37, 0, 50),
        (23406, 24, 1, 50),
    ],
)
def test_a_line_that_rings_while_the_fit_has_long_found_the_fault(
    number: int, fault: int, end: int, most: float
) -> None:
    """Phasors that cross the reach again and again (before: zone 1 after 21 to 34 ms); phasors that a filter
    holds as it begins anew, taken for a change behind the relay that stands still (before: none)."""
    relay, samples, seen = drawn_fault(91001, number, fault, end, order=4)
    assert seen == ("inside", True)
    begin = len(samples) - 240
    assert picked_up(relay, samples[: begin + round(most * 1e-3 * SAMPLING_HZ) + 1])


RINGS = {
    "long-164-quad": (97002, 164, 22, 1, "long"),
    "long-636-quad": (97010, 636, 3, 1, "long"),
    "long-24": (97030, 24, 6, 1, "long"),
    "long-673": (97030, 673, 8, 1, "long"),
    "long-1028": (97030, 1028, 30, 1, "long"),
    "long-1758": (97030, 1758, 36, 0, "long"),
    "long-473": (97030, 473, 39, 0, "long"),
    "mixed-147": (97030, 147, 28, 1, "mixed"),
}
"""Cases of bench/security.py: seed, network, fault, end and kind."""


@pytest.mark.parametrize("name", RINGS)
def test_a_line_that_rings_for_a_cycle_and_more(name: str) -> None:
    """Faults within 60 % of 113 to 388 km: zone 1 starts within 20 ms (before the fit had the charging 21 to
    44)."""
    seed, number, fault, end, kind = RINGS[name]
    drawn = {"order": 4, "kind": kind, "charged": True, "quad": name.endswith("quad")}
    relay, samples, seen = drawn_fault(seed, number, fault, end, **drawn)
    assert seen == ("inside", True)
    begin = len(samples) - 240
    assert picked_up(relay, samples[: begin + round(20e-3 * SAMPLING_HZ) + 1])
