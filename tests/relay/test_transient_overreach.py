"""Travelling waves, raw: no zone operates for a fault beyond it, and no phasor is larger than what is there.

A 100 km line with 80 km behind it, no low-pass before the sampling, a source of up to thirty times the
line: the waves in the voltage are then as large as it was before the fault, and the fault's voltage is a
thirtieth of that.
"""

from __future__ import annotations

import numpy as np
import pytest

from faultloop.loop.scenario import Scenario
from faultloop.plant import Plant
from faultloop.relay import Relay, RelaySettings

Z1, Z0 = (6.0, 40.0), (24.0, 120.0)
WARM = 4800
LARGEST_VOLTAGE, LARGEST_CURRENT = (
    1.5,
    1.6,
)  # of the largest sample in the record; 1.29 and 1.39 of 3264 faults


def samples(sir: float, at: float, kind: str, angle: float) -> np.ndarray:
    """A second of load and 0.2 s with a fault at ``at`` of the line, (n, 6)."""
    line = {"model": "bergeron", "r1_ohm_per_km": 0.06, "x1_ohm_per_km": 0.4, "b1_us_per_km": 2.8,
            "r0_ohm_per_km": 0.24, "x0_ohm_per_km": 1.2, "b0_us_per_km": 1.8}  # fmt: skip
    near = at <= 1.0
    plant = Plant(
        Scenario.from_dict(
            {
                "scenario": {"name": "beyond zone 1", "duration_s": 0.4},
                "system": {"frequency_hz": 50, "base_kv": 220},
                "source": [
                    {"name": "SA", "bus": "A", "voltage_pu": 1.02, "sir": sir, "z0_over_z1": 1.5},
                    {"name": "SC", "bus": "C", "angle_deg": -8, "z1_ohm": [1.8, 20.0], "z0_ohm": [3.0, 17.0]},
                ],
                "line": [
                    {"name": "AB", "from": "A", "to": "B", "length_km": 100, **line},
                    {"name": "BC", "from": "B", "to": "C", "length_km": 80, **line},
                ],
                "fault": [
                    {"line": "AB" if near else "BC", "at_km": 100.0 * (at if near else at - 1.0),
                     "type": kind, "angle_deg": angle, "after_s": 0.1}
                ],
                "relay": [{"name": "R", "line": "AB", "end": "from", "settings": "none"}],
            }
        )
    )  # fmt: skip
    blocks = [plant.history(WARM)[:, 0]]
    while plant.sample_count < 1440:
        done = plant.advance(1440 - plant.sample_count)
        blocks.append(plant.samples[:done, 0].copy())
    return np.concatenate(blocks)


def default_relay() -> Relay:
    return Relay(
        RelaySettings.from_dict(
            {
                "relay": {"frequency_hz": 50, "nominal_kv": 220},
                "vt": {"kind": "ideal"},
                "line": {"z1_ohm": list(Z1), "z0_ohm": list(Z0)},
                "pdis": [
                    {"zone": 1, "reach_pu": 0.8},
                    {"zone": 2, "reach_pu": 0.8, "characteristic": "quad", "resistive_reach_ohm": 20.0},
                    {"zone": 3, "reach_pu": 0.5, "direction": "reverse"},
                    {"zone": 4, "reach_pu": 2.0, "delay_ms": 1000.0},
                ],
                "ptrc": {"zones": [4]},
            }
        )
    )


@pytest.mark.parametrize(
    ("sir", "at", "kind", "angle"),
    [
        (0.1, 0.85, "BC", 0.0),
        (1.0, 1.1, "ABC", 120.0),
        (3.0, 0.85, "BC", 60.0),
        (10.0, 0.9, "BCG", 90.0),
        (10.0, 1.0, "ABC", 0.0),
        (30.0, 0.85, "AG", 90.0),
        (30.0, 0.85, "BC", 120.0),
        (30.0, 1.0, "ABC", 0.0),
        (30.0, 1.1, "BCG", 60.0),
        (30.0, 1.1, "AG", 30.0),
    ],
)
def test_waves_neither_overreach_nor_lead_the_phasors_astray(
    sir: float, at: float, kind: str, angle: float
) -> None:
    x, relay, done = samples(sir, at, kind, angle), default_relay(), 0
    operate, pickup, largest = 0, 0, np.zeros(6)
    while done < len(x):
        m = relay.advance(x[done:])
        z = relay.phasors[:, :12].copy().view(np.complex128)
        if done >= WARM:
            largest = np.maximum(largest, np.abs(z).max(axis=0))
        operate |= int(np.bitwise_or.reduce(relay.operate))
        pickup |= int(np.bitwise_or.reduce(relay.pickup))
        done += m
    there = np.abs(x).max(axis=0) / np.sqrt(2.0)
    assert not operate & 0b111, f"operate {operate:b}"
    assert pickup & 0b1000, "zone 4 must see the fault"
    assert largest[:3].max() <= LARGEST_VOLTAGE * there[:3].max()
    assert largest[3:].max() <= LARGEST_CURRENT * there[3:].max()
