"""What the sources give is lost in resistances or stored: through a fault and its clearing."""

from __future__ import annotations

import numpy as np
import pytest

from faultloop.plant import Plant
from tests.measured import Measured
from tests.plant.record import now_ns, record
from tests.plant.reference import BASE_KV, KM, LINE, SOURCES, build

OMEGA = 2 * np.pi * 50
RATE = 19200
STEPWISE = {"sampling_hz": RATE, "steps_per_sample": 1}


def phase_real(zero: float, positive: float) -> np.ndarray:
    return np.eye(3) * positive + (zero - positive) / 3


@pytest.mark.parametrize("kind", ["AG", "BC", "ABC"])
def test_energy_balance_of_an_inductive_network(kind: str, measured: Measured) -> None:
    """Trapezoidal sums over each step against ``i L i / 2``, over the fault and both breakers' opening."""
    at = 0.45
    fault = {"name": "F", "line": "L", "at_pu": at, "type": kind, "start_s": 0.02, "resistance_ohm": 5.0}
    ends = [{"name": f"Q{e}", "line": "L", "end": e, "operate_ms": 30.0} for e in ("from", "to")]
    plant = Plant(build("rl", system=STEPWISE, fault=[fault], breaker=ends))
    plant.advance(1)
    for breaker in ("Qfrom", "Qto"):
        plant.command(breaker, "open", 7, now_ns(plant))
    parts = {  # R, L in ohm (at 50 Hz), and whose current
        bus: (*(phase_real(getattr(z0, c), getattr(z1, c)) for c in ("real", "imag")), bus)
        for bus, (_, z1, z0) in SOURCES.items()
    }
    for side, share in (("from", at), ("to", 1 - at)):
        length = share * KM
        parts[side] = (
            phase_real(LINE["r0"], LINE["r1"]) * length,
            phase_real(LINE["x0"], LINE["x1"]) * length,
            side,
        )
    power, stored = [], []
    for k in range(1300):
        given = lost = energy = 0.0
        for name, (r, x, who) in parts.items():
            i = plant.probe.source_current(who) if name in SOURCES else plant.probe.line_current("L", who)
            lost += i @ r @ i
            energy += i @ x @ i / (2 * OMEGA)
            if name in SOURCES:
                angle = OMEGA * k / RATE + np.radians(SOURCES[name][0]) - 2 * np.pi / 3 * np.arange(3)
                given += BASE_KV * 1e3 * np.sqrt(2 / 3) * np.cos(angle) @ i
        out = plant.probe.fault_current("F")
        power.append(given - lost - 5.0 * (out @ out))
        stored.append(energy)
        plant.advance(1)
    assert plant.closed("Qfrom") == plant.closed("Qto") == 0
    balance = np.concatenate([[0], np.cumsum((np.array(power)[1:] + power[:-1]) / 2 / RATE)])
    error = balance - (np.array(stored) - stored[0])
    measured("error of the balance", 100 * np.abs(error).max() / max(stored), "% of the stored peak")
    assert np.abs(error).max() < 2e-3 * max(stored)


def test_an_isolated_lossless_line_never_gains_energy() -> None:
    """Cut off with a fault's waves on it, for half a second: ten thousand steps, a thousand reflections."""
    line = {f"{k}_{'us' if k[0] == 'b' else 'ohm'}_per_km": v for k, v in LINE.items() if k[0] != "r"}
    line |= {
        "name": "L",
        "from": "A",
        "to": "B",
        "length_km": 137.0,
        "r1_ohm_per_km": 0.0,
        "r0_ohm_per_km": 0.0,
    }
    fault = {"name": "F", "line": "L", "at_pu": 0.37, "type": "AG", "start_s": 0.02, "duration_s": 0.01}
    ends = [{"name": f"Q{e}", "line": "L", "end": e, "operate_ms": 40.0} for e in ("from", "to")]
    relays = [
        {"name": f"R{e}", "line": "L", "end": e, "settings": "x.toml", "voltage_at": "line"}
        for e in ("from", "to")
    ]
    plant = Plant(build(system=STEPWISE, line=[line], fault=[fault], breaker=ends, relay=relays))
    plant.advance(1)
    for breaker in ("Qfrom", "Qto"):
        plant.command(breaker, "open", 7, now_ns(plant))
    record(plant, 2000)
    assert plant.closed("Qfrom") == plant.closed("Qto") == 0
    x, _ = record(plant, 10_000)
    # mean square over windows much longer than the travel time of 9 steps stands for the energy
    energy = (x[..., :3] ** 2).reshape(10, 1000, -1).mean(axis=(1, 2))
    assert energy[0] > (0.1 * BASE_KV * 1e3) ** 2
    assert np.all(np.diff(energy) < 1e-3 * energy[0])
