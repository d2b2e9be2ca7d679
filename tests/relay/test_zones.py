"""One fault, one answer: loop, direction and zone against a network solved in phase coordinates."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest

from faultloop.relay import Relay, RelaySettings
from faultloop.relay.quantities import LOOPS
from tests.relay.network import TYPES, Network, play, settings_dict

STRONG = Network()
WEAK = Network(zs1=20 + 300j, zs0=30 + 400j)
IMPORT = Network(angle_deg=20.0)
ANSWER = {t: t for t in TYPES} | {"ABG": "AB", "BCG": "BC", "CAG": "CA", "ABCG": "ABC"}
ZONES = [
    {"zone": 1, "reach_pu": 0.8},
    {"zone": 2, "reach_pu": 1.2, "delay_ms": 100.0},
    {"zone": 3, "reach_pu": 1.5, "direction": "reverse", "delay_ms": 200.0},
    {"zone": 4, "reach_pu": 0.8, "characteristic": "quad", "resistive_reach_ohm": 40.0},
    {"zone": 5, "reach_pu": 0.9, "polarization": "cross"},
    {"zone": 6, "reach_pu": 0.9, "polarization": "self"},
    {"zone": 7, "reach_pu": 1.5, "direction": "none", "delay_ms": 300.0},
]


def relay(network: Network, zones: list[dict] | None = None, method: str = "fourier", **tables: Any) -> Relay:
    data = settings_dict(network, ZONES if zones is None else zones, estimator={"method": method}, **tables)
    return Relay(RelaySettings.from_dict(data))


def run(r: Relay, samples: np.ndarray) -> np.ndarray:
    """Pickup bits of all samples."""
    words, done = [], 0
    while done < len(samples):
        done += r.advance(samples[done:])
        words.append(r.pickup.copy())
    return np.concatenate(words)


def names(r: Relay, words: np.ndarray) -> set[str]:
    """Every bit that was set at any time."""
    seen = int(np.bitwise_or.reduce(words))
    return {name for place, name in enumerate(r.bits) if seen >> place & 1}


def loops_seen(r: Relay, words: np.ndarray) -> set[str]:
    return {name[5:] for name in names(r, words) if name.startswith("PHS1.")}


def zones_seen(r: Relay, words: np.ndarray) -> set[int]:
    return {int(name[4:]) for name in names(r, words) if name.startswith("PDIS")}


@pytest.mark.parametrize("kind", TYPES)
def test_the_faulted_loop_measures_the_line_to_the_fault(kind: str) -> None:
    for at in (0.1, 0.3, 0.5, 0.7, 0.9):
        r = relay(STRONG)
        run(r, STRONG.fault(kind, at, start_s=0.08, duration_s=0.35))
        loop = "AB" if ANSWER[kind] == "ABC" else ANSWER[kind]
        place = 2 * LOOPS.index(loop)
        measured = complex(*r.loops[-1, place : place + 2])
        assert abs(measured - at * STRONG.z1) < 0.01 * abs(at * STRONG.z1)


@pytest.mark.parametrize("network", [STRONG, WEAK, IMPORT], ids=["strong", "weak", "import"])
@pytest.mark.parametrize("method", ["fourier", pytest.param("adaptive-kalman", marks=pytest.mark.slow)])
def test_every_fault_has_one_answer(network: Network, method: str) -> None:
    """All types, close in to remote, at a few inception angles: the loop, the direction and nothing else."""
    for kind, at, start in itertools.product(TYPES, (0.0, 0.5, 0.95), (0.1, 0.1035)):
        r = relay(network, method=method)
        words = run(r, network.fault(kind, at, start_s=start, duration_s=start + 0.1))
        seen, answer = names(r, words), ANSWER[kind]
        assert "RDIR1.DirFwd" in seen, (kind, at)
        if answer == "ABC":
            assert {"AB", "BC", "CA"} <= loops_seen(r, words[-200:]), (kind, at)
            assert not {"AG", "BG", "CG"} & loops_seen(r, words), (kind, at)
        else:
            assert loops_seen(r, words) == {answer}, (kind, at)
        assert 3 not in zones_seen(r, words), (kind, at)
        assert 2 in zones_seen(r, words), (kind, at)
        assert (1 in zones_seen(r, words)) is (at < 0.8), (kind, at)


@pytest.mark.parametrize("network", [STRONG, WEAK, IMPORT], ids=["strong", "weak", "import"])
def test_a_fault_behind_is_behind(network: Network) -> None:
    """At the bus, the voltage gone: reverse for every type, and no forward zone starts at any time."""
    for kind, start in itertools.product(TYPES, (0.1, 0.1035)):
        r = relay(network)
        words = run(r, network.fault(kind, -1.0, start_s=start, duration_s=start + 0.15))
        assert zones_seen(r, words) <= {3, 7}, kind
        assert 3 in zones_seen(r, words), kind
        assert names(r, words[-1:]) >= {"RDIR1.DirRev"}, kind


@pytest.mark.parametrize("kind", ["AG", "BC", "CAG", "ABC"])
def test_zones_start_up_to_their_reach(kind: str) -> None:
    """Within 3 % of the reach, with a decaying offset; zone 1 never beyond it, not even for a moment."""
    reaches = {1: 0.8, 2: 1.2, 4: 0.8, 5: 0.9, 6: 0.9, 7: 1.5}
    for at in (0.1, 0.4, 0.77, 0.83, 0.87, 0.93):
        r = relay(STRONG)
        expected = {z for z, reach in reaches.items() if at < reach}
        assert zones_seen(r, run(r, STRONG.fault(kind, at, duration_s=0.3))) == expected, at


def test_timers_count_samples() -> None:
    """Operate minus start is the delay, to the sample; ground and phase may differ."""
    zone = {"zone": 2, "reach_pu": 1.2, "delay_ms": 50.0, "delay_ground_ms": 70.0}
    for kind, delay in (("AG", 70.0), ("BC", 50.0)):
        events = play(relay(STRONG, [zone]), STRONG.fault(kind, 0.5, duration_s=0.3))
        at = {e.text.split()[1]: e.sample_count for e in events if e.text.startswith("PDIS1")}
        assert at["Op"] - at["Str"] == round(delay * 4.8)


def test_memory_widens_the_mho_towards_the_source_behind() -> None:
    """A resistive fault outside the self-polarized circle is inside the memory-polarized one.

    With V1 memory the circle passes through -Zs instead of the origin (Wedepohl 1965).
    """
    network = Network(zs1=5 + 60j, zs0=8 + 80j, angle_deg=0.0)
    zones = [{"zone": 1, "reach_pu": 0.8}, {"zone": 2, "reach_pu": 0.8, "polarization": "self"}]
    for resistance, expected in ((2.0, {1, 2}), (14.0, {1}), (60.0, set())):
        r = relay(network, zones)
        assert (
            zones_seen(r, run(r, network.fault("BC", 0.1, duration_s=0.2, resistance=resistance))) == expected
        )


@pytest.mark.parametrize("angle_deg", [-25.0, 0.0, 25.0])
@pytest.mark.parametrize("kind", ["AG", "BC", "ABC"])
def test_a_quad_covers_its_resistance_and_no_more_line(kind: str, angle_deg: float) -> None:
    """Load either way neither hides a resistive fault nor draws one from beyond into the zone."""
    network = Network(angle_deg=angle_deg, zr1=30 + 900j, zr0=90 + 900j)  # little infeed from the far end
    zones = [{"zone": 1, "reach_pu": 0.8, "characteristic": "quad", "resistive_reach_ohm": 30.0}]
    for at, resistance, inside in ((0.3, 24.0, True), (0.3, 40.0, False), (0.9, 15.0, False)):
        r = relay(network, zones)
        x = network.fault(kind, at, duration_s=0.25, resistance=resistance)
        assert zones_seen(r, run(r, x)) == ({1} if inside else set()), (at, resistance)


def test_memory_holds_direction_for_a_close_three_phase_fault_off_nominal_frequency() -> None:
    """No voltage at all for 250 ms at 49 Hz, longer than the memory: the direction stays."""
    network = Network(frequency_hz=49.0)
    for at, direction in ((0.0, "RDIR1.DirFwd"), (-1.0, "RDIR1.DirRev")):
        r = relay(network)
        words = run(r, network.fault("ABC", at, duration_s=0.35))
        late = words[-1100:]  # from 21 ms after the inception
        assert all(names(r, late[k : k + 1]) >= {direction} for k in range(0, len(late), 50))


def test_load_and_switching_on_start_nothing() -> None:
    for angle in (-40.0, 40.0):
        network = Network(angle_deg=angle)
        steady = network.solve()
        dead = np.zeros(6)
        stages = [(0.0, dead), (0.05, steady), (0.2, steady * [1, 1, 1, 1.3, 1.3, 1.3])]
        for method in ("fourier", "adaptive-kalman"):
            r = relay(network, method=method)
            assert not zones_seen(r, run(r, network.samples(stages, 0.35)))


def test_a_lost_voltage_without_a_current_starts_nothing() -> None:
    """A fuse of the voltage transformer: one phase's voltage, or all, and the load current as it was."""
    before = STRONG.solve()
    for lost in ([0], [0, 1, 2]):
        after = before.copy()
        after[lost] = 0
        r = relay(STRONG)
        assert not zones_seen(r, run(r, STRONG.samples([(0.0, before), (0.1, after)], 0.3)))


def test_location_is_where_the_fault_is() -> None:
    """Takagi, with load and 10 ohm; without infeed error within 1 %, and said in an event."""
    for kind, at in (("AG", 0.3), ("BC", 0.6), ("ABC", 0.7)):
        r = relay(STRONG)
        resistance = 5.0 if kind != "AG" else 10.0
        stages = [
            (0.0, STRONG.solve()),
            (0.1, STRONG.solve(kind, at, resistance=resistance)),
            (0.25, np.concatenate([STRONG.solve()[:3], np.zeros(3)])),
        ]
        events = play(r, STRONG.samples(stages, 0.4))
        assert r.fault_location == pytest.approx(at, abs=0.01)
        assert any(e.text.startswith("RFLO1 fault at") for e in events)
