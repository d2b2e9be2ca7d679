"""TVTR: fuses that fail, faults that do not look like it, and what a failure blocks and releases."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from faultloop.errors import InputError
from faultloop.relay import Relay, RelaySettings
from faultloop.relay.functions.tvtr import TVTR
from tests.relay.functions.kernel import GIVEN, Kernel
from tests.relay.network import TYPES, Network, play, settings_dict

NETWORK = Network()
QUARTER, CYCLE = 24, 96
PHASES = ["A", "B", "C", "AB", "BC", "AC", "ABC"]
ZONES = [
    {"zone": 1, "reach_pu": 0.8},
    {"zone": 2, "reach_pu": 1.2, "delay_ms": 300.0},
    {"zone": 3, "reach_pu": 0.6, "direction": "none", "delay_ms": 600.0},
]
EMERGENCY = [{"pickup_a": 1500.0, "delay_ms": 100.0, "when": "fuse-failure"}]


def without(x: np.ndarray, phases: str, left: float = 0.0) -> np.ndarray:
    """The same with so much left of the voltages of some phases."""
    x = np.array(x)
    x[..., ["ABC".index(p) for p in phases]] *= left
    return x


def kernel(**table: Any) -> Kernel:
    return Kernel(TVTR, table)


def failing(phases: str, left: float = 0.0) -> Kernel:
    """A failure out of load, as the memory sees it: the currents are what they were."""
    k = kernel()
    healthy = NETWORK.solve()
    k.disturb(healthy, without(healthy, phases, left))
    k.q["fed"] = 0
    return k


@pytest.mark.parametrize("phases", PHASES)
def test_it_is_found_after_a_quarter_of_a_cycle_and_blocks_every_zone(phases: str) -> None:
    k = failing(phases)
    k.step(count=QUARTER - 1)
    assert (k.q["fuse_failure"], k.q["blocked_zones"]) == (0, 0)
    k.step()
    assert (k.q["fuse_failure"], k.q["blocked_zones"], k.q["pickup"]) == (1, -1, 1)
    assert k.q["started"] == 0
    assert k.w["lost"] == sum(1 << "ABC".index(p) for p in phases)


def test_a_load_that_goes_while_the_failure_is_young_ends_it_not() -> None:
    """Its estimates are unbalanced for some milliseconds; those of a fault are, too, but greater than
    before."""
    for part, stays in ((0.6, 1), (1.0, 1), (1.2, 0)):
        k = failing("AB")
        k.step(count=QUARTER)
        assert k.q["fuse_failure"] == 1
        now = k.q["x"].copy()
        now[3:] *= part * np.array([1.0, 0.6, 1.0])
        k.q["x"], k.q["d"] = now, now - k.q["memory"]["reference"]
        k.step(now, count=2, fed=1)
        assert k.q["fuse_failure"] == stays, part


@pytest.mark.parametrize("phases", ["A", "BC"])
def test_half_a_voltage_through_loads_between_the_phases_is_found(phases: str) -> None:
    k = failing(phases, 0.5)
    k.step(count=QUARTER)
    assert k.q["fuse_failure"] == 1


def test_without_memory_one_phase_is_found() -> None:
    k = kernel()
    k.step(without(NETWORK.solve(), "B"), count=QUARTER)
    assert (k.q["fuse_failure"], k.w["lost"]) == (1, 0b010)


@pytest.mark.parametrize("kind", TYPES)
def test_faults_are_none(kind: str) -> None:
    for at in (0.0, 0.5, 1.0, -0.01):
        k = kernel()
        k.disturb(NETWORK.solve(), NETWORK.solve(kind, at))
        k.step(count=3 * CYCLE)
        assert k.q["fuse_failure"] == 0, at


def test_an_earth_fault_of_an_isolated_network_is_none() -> None:
    """Its voltage triangle moves as a whole: V0 of a phase voltage, no V2, hardly a current."""
    healthy = NETWORK.solve()
    shifted = healthy.copy()
    shifted[:3] -= healthy[0]
    k = kernel()
    k.disturb(healthy, shifted)
    k.q["fed"] = 0
    k.step(count=3 * CYCLE)
    assert k.q["fuse_failure"] == 0


def test_a_current_that_comes_within_a_cycle_is_a_fault_after_all() -> None:
    for part, stays in ((0.2, 1), (1.3, 1), (1.6, 0)):  # the first two are changes of load
        k = failing("ABC")
        k.step(count=QUARTER)
        k.q["fed"], k.q["x"][3:] = 1, part * k.q["memory"]["reference"][3:]
        k.step(count=CYCLE // 2)
        assert k.q["fuse_failure"] == stays


def test_a_later_one_is_a_fault_behind_a_blown_fuse_and_stays_blocked() -> None:
    k = failing("A")
    k.step(count=QUARTER + 2 * CYCLE)
    k.step(without(NETWORK.solve("BC", 0.5), "A"), count=10 * CYCLE)
    assert k.q["fuse_failure"] == 1


def test_a_sag_without_a_lost_phase_makes_way_for_an_unbalanced_current() -> None:
    for seconds, stays in ((1.0, 0), (6.0, 1)):
        k = failing("A", 0.72)
        k.c["unbalance"] = 0.2
        k.step(count=int(seconds * 4800))
        assert (k.q["fuse_failure"], k.w["lost"]) == (1, 0)
        x = k.q["x"].copy()
        x[3] *= 2
        k.step(x, count=2)
        assert k.q["fuse_failure"] == stays


def test_it_ends_when_all_voltages_have_been_back_and_normal_for_a_while() -> None:
    k = failing("BC")
    k.step(count=CYCLE)
    k.step(NETWORK.solve(), count=CYCLE)  # still a disturbance
    assert k.q["fuse_failure"] == 1
    k.q["disturbed"] = 0
    k.step(count=480)
    assert k.q["fuse_failure"] == 1
    k.step(count=2)
    assert k.q["fuse_failure"] == 0


@pytest.mark.parametrize("what", ["dead", "open"])
def test_nothing_is_judged_on_a_dead_line_with_an_open_pole_and_for_200_ms_after(what: str) -> None:
    k = kernel()
    if what == "dead":
        k.step(np.zeros(6), count=CYCLE)
    else:
        k.q["closed"] = 6
        k.step(NETWORK.solve(), count=CYCLE)
        k.q["closed"] = 7
    k.step(without(NETWORK.solve(), "A"), count=959)
    assert (k.q["fuse_failure"], k.w["count"]) == (0, 0)
    k.step(count=1 + QUARTER)
    assert k.q["fuse_failure"] == 1


def relay(**tables: Any) -> Relay:
    more = {"tvtr": {}, "ptoc": EMERGENCY, "estimator": {"method": "kalman-bank"}} | tables
    return Relay(RelaySettings.from_dict(settings_dict(NETWORK, ZONES, **more)))


def stages(phases: str, rest: list[tuple[float, np.ndarray]], angle: float, seconds: float) -> np.ndarray:
    """Load; fuses fail at 0.3 s, whatever comes then."""
    network = Network(angle_deg=angle)
    lost = [(at, without(x, phases)) for at, x in rest]
    given = [(0.0, network.solve()), (0.3, without(network.solve(), phases)), *lost]
    return network.samples(given, seconds)


@pytest.mark.parametrize("phases", PHASES)
@pytest.mark.parametrize("angle", [-25.0, 10.0])
def test_no_trip_by_it_and_none_when_the_load_changes_or_the_voltage_returns(
    phases: str, angle: float
) -> None:
    """Half the load 40 ms later; the voltages come back at 0.9 s."""
    x = stages(phases, [(0.34, Network(angle_deg=angle / 2).solve())], angle, 1.5)
    healthy = Network(angle_deg=angle / 2).samples([(0.0, Network(angle_deg=angle / 2).solve())], 1.5)
    x[round(0.9 * 4800) :] = healthy[round(0.9 * 4800) :]
    r = relay()
    texts = [event.text for event in play(r, x)]
    assert r.outputs.trip_poles == 0
    assert not any("Tr poles" in text for text in texts), texts
    assert any(f"voltage of phase {phases} without" in text for text in texts), texts
    assert "TVTR1 FuFail reset" in texts


@pytest.mark.parametrize("phases", ["A", "BC", "ABC"])
@pytest.mark.parametrize("kind", ["AG", "BC", "ABC"])
def test_a_fault_after_it_trips_by_the_emergency_stage_alone(phases: str, kind: str) -> None:
    x = stages(phases, [(0.6, NETWORK.solve(kind, 0.3))], -15.0, 0.9)
    trips = [event for event in play(relay(), x) if event.trip]
    assert trips and trips[0].trip.function == "PTOC1"
    assert 0.1 <= trips[0].sample_count / 4800 - 0.6 < 0.14


@pytest.mark.parametrize("kind", TYPES)
def test_a_fault_with_healthy_voltages_trips_as_without_it(kind: str) -> None:
    x = NETWORK.fault(kind, 0.3, 0.3, 0.45)
    with_it = [(e.sample_count, e.trip) for e in play(relay(), x) if e.trip]
    alone = [(e.sample_count, e.trip) for e in play(relay(tvtr=None, ptoc=[]), x) if e.trip]
    assert with_it and with_it[0] == alone[0]


def test_an_emergency_stage_without_the_function_is_refused() -> None:
    with pytest.raises(InputError) as error:
        RelaySettings.from_dict(GIVEN | {"ptoc": EMERGENCY})
    assert error.value.key == "ptoc[1].when"
    assert "[tvtr]" in error.value.what


@pytest.mark.parametrize("table", [{"unbalance_pu": 0.0}, {"current_pu": 1.5}, {"latch": 5.0}])
def test_what_is_wrong_is_named(table: dict[str, float]) -> None:
    with pytest.raises(InputError) as error:
        RelaySettings.from_dict(GIVEN | {"tvtr": table})
    assert (error.value.key or "").startswith("tvtr.")
