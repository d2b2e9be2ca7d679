"""Plant and relay together: what the relay measures of a fault that the plant makes."""

from __future__ import annotations

import numpy as np
import pytest

from faultloop.loop.scenario import Scenario
from faultloop.plant import Plant
from faultloop.plant.fault import FAULT_TYPES
from faultloop.relay import Relay, RelaySettings
from tests.examples import scenario
from tests.measured import Measured

Z1 = 6 + 40j
LOOP = {"AG": "AG", "BG": "BG", "CG": "CG", "ABG": "AB", "BCG": "BC", "CAG": "CA", "ABCG": "ABC"}
PLACES = {"AG": 0, "BG": 2, "CG": 4, "AB": 6, "BC": 8, "CA": 10}
SAMPLES = 1250  # 0.26 s, with the fault at 0.06 s: ten cycles of it

ESTIMATORS = ("fourier", "adaptive-kalman")


def settings(estimator: str) -> RelaySettings:
    return RelaySettings.from_dict(
        {
            "relay": {"frequency_hz": 50, "nominal_kv": 220},
            "estimator": {"method": estimator, "unsafe": True},
            "vt": {"kind": "ideal"},
            "line": {"z1_ohm": [6.0, 40.0], "z0_ohm": [24.0, 120.0]},
            "pdis": [
                {"zone": 1, "reach_pu": 0.85},
                {"zone": 2, "reach_pu": 1.25, "delay_ms": 100},
                {"zone": 3, "direction": "reverse", "reach_pu": 0.5},
            ],
            "ptrc": {"zones": [1, 2]},
        }
    )


def faulted(estimator: str, **fault: object) -> tuple[Relay, np.ndarray, np.ndarray, dict[str, int]]:
    """The relay at A after the fault, its last loops and the first sample of each zone's pickup."""
    data = scenario(fault=[{"start_s": 0.06, **fault}], relay=[], breaker=[])
    data["relay"] = [{"name": "RA", "line": "AB", "end": "from", "settings": "none"}]
    plant, relay = Plant(Scenario.from_dict(data)), Relay(settings(estimator))
    first: dict[str, int] = {}
    loops = np.full((0, 12), np.nan)
    while plant.sample_count < SAMPLES:
        m = plant.advance(SAMPLES - plant.sample_count)
        block = plant.samples[:m, 0].copy()
        while len(block):
            n = relay.advance(block)
            words = relay.pickup.copy()
            for place, name in enumerate(relay.bits):
                on = np.flatnonzero(words >> np.uint64(place) & np.uint64(1))
                if len(on) and name not in first:
                    first[name] = relay.sample_count - n + int(on[0])
            loops = relay.loops.copy()
            block = block[n:]
    return relay, loops[-1], words, first


@pytest.mark.parametrize("estimator", ESTIMATORS)
@pytest.mark.parametrize("at_pu", [0.1, 0.3, 0.5, 0.7, 0.9])
@pytest.mark.parametrize("kind", FAULT_TYPES)
def test_a_bolted_fault_is_seen_where_it_is(
    estimator: str, kind: str, at_pu: float, measured: Measured
) -> None:
    relay, loops, _, first = faulted(estimator, line="AB", at_pu=at_pu, type=kind)
    loop = LOOP.get(kind, kind)
    for name in (loop,) if loop != "ABC" else ("AB", "BC", "CA"):
        place = PLACES[name]
        seen = complex(loops[place], loops[place + 1])
        measured(f"error of {estimator}", 100 * abs(seen / (at_pu * Z1) - 1), "%")
        assert abs(seen - at_pu * Z1) <= 0.01 * abs(at_pu * Z1), f"{name}: {seen} for {at_pu * Z1}"
    assert "RDIR1.DirFwd" in first
    assert "RDIR1.DirRev" not in first
    assert ("PDIS1" in first) == (at_pu < 0.85)
    assert "PDIS2" in first
    assert "PDIS3" not in first
    assert relay.outputs.trip_poles == 7
    assert relay.fault_location == pytest.approx(at_pu, abs=0.01)


@pytest.mark.parametrize("estimator", ESTIMATORS)
@pytest.mark.parametrize("at_pu", [0.0, 0.002])
@pytest.mark.parametrize("kind", FAULT_TYPES)
def test_close_in_forward(estimator: str, kind: str, at_pu: float) -> None:
    relay, _, _, first = faulted(estimator, line="AB", at_pu=at_pu, type=kind)
    assert "PDIS1" in first
    assert "RDIR1.DirRev" not in first
    assert "PDIS3" not in first
    assert relay.outputs.trip_poles == 7


@pytest.mark.parametrize("estimator", ESTIMATORS)
@pytest.mark.parametrize("kind", FAULT_TYPES)
def test_close_in_reverse(estimator: str, kind: str) -> None:
    relay, _, _, first = faulted(estimator, bus="A", type=kind)
    assert relay.outputs.trip_poles == 0
    assert not {"PDIS1", "PDIS2", "RDIR1.DirFwd"} & set(first)
    assert "RDIR1.DirRev" in first
    assert "PDIS3" in first


@pytest.mark.parametrize("estimator", ESTIMATORS)
@pytest.mark.parametrize("kind", ["AG", "BC", "CAG"])
def test_one_fault_releases_one_loop(estimator: str, kind: str) -> None:
    relay, _, words, _ = faulted(estimator, line="AB", at_pu=0.4, type=kind)
    released = [
        name
        for place, name in enumerate(relay.bits)
        if name.startswith("PHS1.") and int(words[-1]) >> place & 1
    ]
    assert released == [f"PHS1.{LOOP.get(kind, kind)}"]
