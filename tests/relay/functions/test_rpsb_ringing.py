"""RPSB where lines ring: a three-phase fault is no swing, and the swing after one is no fault."""

from __future__ import annotations

from types import ModuleType
from typing import Any

import numpy as np
import pytest

from faultloop.relay import Relay, RelaySettings
from tests.load import load
from tests.measured import Measured
from tests.relay.network import play


@pytest.fixture(scope="module")
def networks() -> ModuleType:
    return load("bench/security_cases.py")


@pytest.fixture(scope="module")
def bench() -> ModuleType:
    return load("bench/swing_network.py")


def relay_of(case: dict[str, Any], z1_ohm: float, blocking: bool) -> Relay:
    """Zone 1 of 80 %, a mho and a quadrilateral; with RPSB's boxes around both."""
    line, length = case["line"], case["length"]
    z1, z0 = ([line[f"{part}{n}_ohm_per_km"] * length for part in "rx"] for n in (1, 0))
    inner = 1.1 * max(0.6 * z1_ohm, 40.0)
    boxes = {"inner_resistance_ohm": inner, "outer_resistance_ohm": 1.4 * inner}
    zones = [{"zone": 1, "reach_pu": 0.8}]
    zones.append({"zone": 2, "reach_pu": 0.8, "characteristic": "quad", "resistive_reach_ohm": 40.0})
    given = {
        "relay": {"frequency_hz": case["f0"], "nominal_kv": case["kv"]},
        "line": {"z1_ohm": z1, "z0_ohm": z0},
        "vt": {"kind": "ideal"},
        "pdis": zones,
    }
    return Relay(RelaySettings.from_dict(given | ({"rpsb": boxes} if blocking else {})))


def first_start(relay: Relay, samples: np.ndarray) -> float:
    """Number of the sample at which either zone starts; infinite if none does."""
    done = 0
    while done < len(samples):
        begin, done = done, done + relay.advance(samples[done:])
        found = np.flatnonzero(relay.pickup & np.uint64(0b11))
        if len(found):
            return begin + int(found[0])
    return np.inf


@pytest.mark.parametrize(
    ("seed", "number", "kind", "end", "at", "of", "angle"),
    [
        (93011, 162, "mixed", 0, 0.5795, "ABC", 71.9),  # 187 km; zone 1 after 81 ms, without RPSB after 20
        (94501, 31, "mixed", 0, 0.6138, "ABCG", 94.2),  # 266 km; 138 and 25 ms
        (94501, 12, "mixed", 1, 0.2674, "ABCG", 166.2),  # 200 km; 128 and 24 ms
        (94502, 22, "long", 1, 0.3482, "ABCG", 286.9),  # 282 km; 156 and 27 ms
        (94502, 29, "long", 1, 0.3614, "ABC", 257.0),  # 348 km; 146 and 29 ms
        (94502, 114, "long", 0, 0.6182, "ABCG", 107.9),  # 366 km; 144 and 28 ms
        (94502, 90, "long", 1, 0.4398, "ABC", 101.5),  # 253 km; 121 and 19 ms
    ],
)
def test_a_three_phase_fault_that_rings_is_not_held_back(
    networks: ModuleType,
    seed: int,
    number: int,
    kind: str,
    end: int,
    at: float,
    of: str,
    angle: float,
    measured: Measured,
) -> None:
    """The estimate leaps for 50 ms, as at the fault's clearing, and moves on for 100, as in the swing after
    it; in the samples the pairs stand still."""
    case = networks.draw(seed, number, kind)
    case |= {"where": "inside", "at": at, "type": of, "angle": angle, "resistance": 0.0}
    x, start = networks.record(case, 1500.0, 4)
    alone, beside = (
        1e3 * (first_start(relay_of(case, networks.z1_of(case), on), x[end]) - start) / case["sampling"]
        for on in (False, True)
    )
    measured("zone 1 for a fault that rings, RPSB on", beside, "ms")
    assert alone < 35.0
    assert beside < alone + 5.0


def test_the_swing_after_a_fault_is_blocked_where_lines_ring(bench: ModuleType) -> None:
    """Drawn faults outside that make it, lines of 50 to 300 km beside the relay's: they ring then, too."""
    told = bench.settings("ideal")
    alone = told.model_copy(update={"rpsb": None})
    without = 0
    for case in range(8):
        data, _ = bench.scenario(np.random.default_rng([94703, case]), "after", "ideal")
        x = bench.samples(data, False)
        assert not [event for event in play(Relay(told), x) if event.trip], case
        without += any(event.trip for event in play(Relay(alone), x))
    assert without, "without RPSB a zone trips"
