"""Two faults at once, one behind the relay or beyond the line and one elsewhere, in other phases."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from faultloop.loop.scenario import Scenario
from faultloop.plant import Plant
from faultloop.relay import Relay, RelaySettings
from tests.relay.test_zones import run

RATE, WARM, TOTAL = 4800, 1920, 1056
FIRST_S = 0.06
LINE = {
    "model": "bergeron",
    "r1_ohm_per_km": 0.06, "x1_ohm_per_km": 0.40, "b1_us_per_km": 2.8,
    "r0_ohm_per_km": 0.24, "x0_ohm_per_km": 1.20, "b0_us_per_km": 1.8,
}  # fmt: skip
PLACES: dict[str, dict[str, Any]] = {
    "behind": {"bus": "A"},
    "inside": {"line": "AB", "at_pu": 0.3},
    "beyond": {"line": "BC", "at_pu": 0.2},
}
SETTINGS = RelaySettings.from_dict(
    {
        "relay": {"frequency_hz": 50, "nominal_kv": 220},
        "vt": {"kind": "ideal"},
        "line": {"z1_ohm": [6.0, 40.0], "z0_ohm": [24.0, 120.0]},
        "pdis": [
            {"zone": 1, "reach_pu": 0.8},
            {
                "zone": 1,
                "reach_pu": 0.8,
                "characteristic": "quad",
                "resistive_reach_ohm": 20.0,
                "resistive_reach_ground_ohm": 30.0,
            },
            {"zone": 3, "reach_pu": 0.5, "direction": "reverse", "delay_ms": 1000.0},
        ],
        "ptrc": {"zones": [3]},
    }
)


def zone1(sir: float, load: float, faults: tuple[tuple[str, str], tuple[str, str]], after_ms: float) -> float:
    """When zone 1, mho or quadrilateral, starts, in ms from the second fault; NaN if never.

    A - B of 100 km between 30 km behind and 80 km beyond, sources behind X and C; both faults go on.
    """
    z1, z0 = [6.0 * sir, 40.0 * sir], [9.0 * sir, 60.0 * sir]
    plant = Plant(
        Scenario.from_dict(
            {
                "scenario": {"name": "cross-country", "duration_s": TOTAL / RATE},
                "system": {"frequency_hz": 50, "base_kv": 220},
                "source": [
                    {"name": "SX", "bus": "X", "angle_deg": load, "z1_ohm": z1, "z0_ohm": z0},
                    {"name": "SC", "bus": "C", "z1_ohm": [6.0, 40.0], "z0_ohm": [9.0, 60.0]},
                ],
                "line": [
                    {"name": name, "from": name[0], "to": name[1], "length_km": km, **LINE}
                    for name, km in (("XA", 30), ("AB", 100), ("BC", 80))
                ],
                "fault": [
                    {"name": f"F{k}", "type": kind, "start_s": FIRST_S + k * after_ms / 1e3, **PLACES[place]}
                    for k, (place, kind) in enumerate(faults)
                ],
                "relay": [{"name": "R", "line": "AB", "end": "from", "settings": "none"}],
                "front_end": {"antialias_hz": 1500},
            }
        )
    )  # fmt: skip
    blocks = [plant.history(WARM)[:, 0]]
    while plant.sample_count < TOTAL:
        done = plant.advance(TOTAL - plant.sample_count)
        blocks.append(plant.samples[:done, 0].copy())
    started = np.flatnonzero(run(Relay(SETTINGS), np.concatenate(blocks)) & np.uint64(0b11))
    return 1e3 * ((started[0] - WARM) / RATE - FIRST_S) - after_ms if len(started) else np.nan


@pytest.mark.parametrize("after_ms", [2.0, 10.0, 40.0])
@pytest.mark.parametrize("kinds", [("AG", "BG"), ("BC", "AG"), ("CG", "ABC"), ("ABG", "CG"), ("AG", "BC")])
def test_a_fault_on_the_line_beside_one_behind(kinds: tuple[str, str], after_ms: float) -> None:
    """Direction, and the selection of the change, are those of the first fault; zone 1 trips all the same."""
    started = zone1(1.0, 8.0, (("behind", kinds[0]), ("inside", kinds[1])), after_ms)
    assert 0 < started < 40


@pytest.mark.parametrize("after_ms", [25.0, 50.0])
@pytest.mark.parametrize("kinds", [("BG", "CG"), ("BCG", "AG"), ("CAG", "BG"), ("BC", "ABG")])
def test_a_fault_on_the_line_beside_one_beyond(kinds: tuple[str, str], after_ms: float) -> None:
    """The direction is right, but both look like one fault of other phases, whose loop measures nothing:
    the type is that of the change against what the first has settled to."""
    started = zone1(1.0, 8.0, (("beyond", kinds[0]), ("inside", kinds[1])), after_ms)
    assert 0 < started < 40


@pytest.mark.parametrize(
    ("sir", "load", "faults", "after_ms"),
    [
        (0.9, -25.0, (("beyond", "CA"), ("behind", "CA")), 57.0),
        (0.14, 5.0, (("beyond", "BCG"), ("behind", "ABC")), 54.0),
        (9.3, -27.0, (("beyond", "AB"), ("behind", "CAG")), 50.0),
        (0.4, -5.0, (("beyond", "CG"), ("behind", "BC")), 33.0),
        (0.4, -26.0, (("behind", "CA"), ("beyond", "AG")), 6.0),
        (0.3, -22.0, (("beyond", "CA"), ("behind", "BCG")), 46.0),
        (0.7, 28.0, (("behind", "BC"), ("beyond", "CG")), 25.0),
        (3.6, 12.0, (("beyond", "CA"), ("behind", "AB")), 32.0),
    ],
)
def test_no_zone_1_for_two_faults_outside(
    sir: float, load: float, faults: tuple[tuple[str, str], tuple[str, str]], after_ms: float
) -> None:
    """A quadrilateral took what the two made of a loop for a fault ahead, 13 to 160 ms after the second."""
    assert np.isnan(zone1(sir, load, faults, after_ms))
