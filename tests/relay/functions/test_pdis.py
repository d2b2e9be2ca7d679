"""PDIS by itself: the depth of a bolted fault is its distance over the reach; start, timer, blocking."""

from __future__ import annotations

from typing import Any

import pytest

from faultloop.relay.characteristics import quad_measures
from faultloop.relay.functions.pdis import PDIS
from faultloop.relay.quantities import FAULTS, LOOPS, THREE_PHASE
from faultloop.relay.zone_depth import depth
from tests.relay.functions.kernel import Kernel
from tests.relay.functions.test_phs import LOOP, NETWORKS
from tests.relay.network import Network

QUAD = {"characteristic": "quad", "resistive_reach_ohm": 40.0}
SHAPES: dict[str, dict[str, Any]] = {
    "memory": {},
    "cross": {"polarization": "cross"},
    "self": {"polarization": "self"},
    "offset": {"direction": "none"},
    "quad": QUAD,
}
STRONG = NETWORKS["strong"]


def zone(kind: str, at: float, network: Network = STRONG, **table: Any) -> tuple[Kernel, dict[str, int]]:
    """A zone in a fault, and what PHS and RDIR say of it."""
    k = Kernel(PDIS, {"zone": 1} | table)
    k.disturb(network.solve(), network.solve(kind, at), 48)
    fault = FAULTS.index(LOOP.get(kind, kind))
    k.q["polarizing"] = network.solve()[0]  # balanced before: V1 is phase A
    mask = 0b111000 if fault == THREE_PHASE else 1 << (fault - 1)
    return k, {"fault": fault, "released": mask, "direction": 1 if at >= 0 else -1}


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("kind", ["AG", "BG", "CG", "AB", "BC", "CA", "ABG", "ABC"])
def test_the_depth_of_a_bolted_fault_is_its_distance_over_the_reach(shape: str, kind: str) -> None:
    for network in NETWORKS.values():
        for at in (0.1, 0.5, 0.9):
            k, said = zone(kind, at, network, reach_pu=0.8, **SHAPES[shape])
            for loop in range(6):
                if said["released"] >> loop & 1:
                    m = depth(k.g, k.q, k.c, loop)
                    exact = at / 0.8
                    if shape in ("cross", "self"):  # a twentieth of the reach more, on either side
                        assert m == pytest.approx(exact, rel=0.02), LOOPS[loop]
                    else:
                        assert m == pytest.approx(exact, rel=2e-4), LOOPS[loop]


@pytest.mark.parametrize(("at", "samples"), [(0.3, 8), (0.5, 12), (0.68, 48), (0.76, 96)])
def test_the_closer_to_the_reach_the_longer_it_must_stay_inside(at: float, samples: int) -> None:
    """A cycle is 96 samples: a twelfth, an eighth, a half, a whole one."""
    k, said = zone("AG", at, reach_pu=0.8)
    k.step(count=samples - 1, **said)
    assert (k.q["pickup"], k.q["zone_started"], k.q["inside"]) == (0, 0, 1)
    k.step(**said)
    assert (k.q["pickup"], k.q["zone_started"]) == (1, 1)
    assert k.q["request"]["made"] == 1  # no delay


def test_a_zone_without_delay_waits_until_waves_have_gone_to_and_fro_three_times() -> None:
    """Until then a line is no resistance and inductance: six times 1 ms of 300 km here."""
    k, said = zone("AG", 0.3, reach_pu=0.8)
    k.g["lumped"], k.q["memory"]["age"] = 29, 28
    k.step(count=20, **said)
    assert k.q["pickup"] == 0
    k.q["memory"]["age"] = 29
    k.step(**said)
    assert k.q["pickup"] == 1
    k, said = zone("AG", 0.3, reach_pu=0.8, delay_ms=300.0)  # a starter is as early as ever
    k.g["lumped"], k.q["memory"]["age"] = 29, 28
    k.step(count=8, **said)
    assert k.q["pickup"] == 1


def test_beyond_the_reach_or_behind_nothing_starts() -> None:
    for at, more in ((0.81, {}), (-0.1, {}), (0.5, {"direction": "reverse"})):
        k, said = zone("BC", at, reach_pu=0.8, **more)
        k.step(count=500, **said)
        assert (k.q["pickup"], k.q["inside"]) == (0, 0), at


def test_a_balanced_fault_when_the_memory_has_ended_is_no_nearer_by_the_load() -> None:
    """Through 8 ohm at 86 %, 40 degrees of load: by the fault's current beyond 80 %, by the loop's within."""
    network = Network(angle_deg=-40.0)
    k = Kernel(PDIS, {"zone": 1, "reach_pu": 0.8, "tilt_deg": 0.0} | QUAD)
    k.disturb(network.solve(), network.solve("ABC", 0.86, 8.0))
    k.q["fault"], k.q["polarizing"] = THREE_PHASE, network.solve()[0]
    assert depth(k.g, k.q, k.c, 3) > 1.0
    k.q["memory"]["age"] = k.g["memory"] + 1
    v, i = k.q["x"][0] - k.q["x"][1], k.q["x"][3] - k.q["x"][4]
    assert quad_measures(k.g, k.q, k.c, 3, v, i, k.c["tilt"])[0] < 1.0
    assert depth(k.g, k.q, k.c, 3) > 1.0


def test_the_timer_counts_from_the_start_and_each_kind_has_its_own() -> None:
    for kind, samples in (("AG", 48), ("AB", 96)):
        k, said = zone(kind, 0.1, reach_pu=0.8, delay_ground_ms=10.0, delay_phase_ms=20.0)
        k.step(count=8, **said)
        assert k.q["pickup"] == 1
        k.step(count=samples - 1, **said)
        assert k.q["operate"] == 0
        k.step(**said)
        assert (k.q["operate"], k.q["request"]["fault"]) == (1, said["fault"])


@pytest.mark.parametrize("block", [{"blocked_zones": 1}, {"blocked_loops": 0b000001}])
def test_a_blocked_zone_does_not_start_and_drops_out(block: dict[str, int]) -> None:
    k, said = zone("AG", 0.1, reach_pu=0.8)
    k.step(count=100, **said, **block)
    assert k.q["pickup"] == 0
    k.step(count=8, **said)
    assert k.q["pickup"] == 1
    k.step(count=12, **said, **block)  # an eighth of a cycle
    assert k.q["pickup"] == 0
    others = {"blocked_zones": 0b10} if "blocked_zones" in block else {"blocked_loops": 0b111110}
    k.step(count=8, **said, **others)
    assert k.q["pickup"] == 1


def test_a_voltage_alone_and_rest_start_nothing() -> None:
    k, said = zone("AG", 0.1, reach_pu=0.8)
    k.q["fed"] = 0
    k.step(count=100, **said)
    assert k.q["pickup"] == 0
    k.q["fed"] = 1
    k.step(count=8, **said)
    assert k.q["pickup"] == 1
    k.q["disturbed"] = 0
    k.step(**said)
    assert (k.q["pickup"], k.q["operate"], k.q["request"]["made"]) == (0, 0, 0)


def test_a_zone_that_does_not_trip_and_the_pilot_zone() -> None:
    data = {"ptrc": {"zones": [], "pilot_zone": 1}}
    k = Kernel(PDIS, {"zone": 1, "reach_pu": 0.8}, **data)
    k.disturb(STRONG.solve(), STRONG.solve("AG", 0.1), 48)
    k.q["polarizing"] = STRONG.solve()[0]
    k.step(count=8, fault=1, released=1, direction=1)
    assert (k.q["operate"], k.q["request"]["made"], k.q["pilot"]) == (1, 0, 1)
