"""An inverter and its transformer in the plant: what the tables in ``cases/`` ask."""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from faultloop.loop.scenario import Scenario
from faultloop.plant import Plant
from faultloop.study.suites.functions.inverter_network import element_scores
from faultloop.study.suites.functions.two_ended import FORTESCUE, phasors, record

Case = dict[str, Any]
MVA, KV = 100.0, 220.0
OHM = KV**2 / MVA
VOLTS, AMPERES = KV * 1e3 * math.sqrt(2 / 3), MVA * 1e6 / (KV * 1e3) * math.sqrt(2 / 3)
"""Peaks of one per unit."""
FAULT_S, SEEN_S = 0.1, (0.05, 0.14)
"""When the fault is, and between when after it the outcome is looked at."""
PICKUP = 0.2


def pair(pu: complex) -> list[float]:
    """Of an impedance per unit."""
    return [pu.real * OHM, pu.imag * OHM]


def behind(x_pu: float, grid_pu: float, inverter: Case, fault: str | None) -> Plant:
    """An inverter at N, a reactance of ``x_pu`` to F, where the fault is and the grid begins."""
    r, x = pair(complex(0.01 * x_pu, x_pu))
    grid = pair(complex(0.05 * grid_pu, grid_pu))
    line = {f"{key}_ohm_per_km": value for key, value in (("r1", r), ("x1", x), ("r0", r), ("x0", x))}
    data: Case = {
        "scenario": {"name": "inverter", "duration_s": 1.0},
        "system": {"frequency_hz": 50, "base_kv": KV},
        "source": [{"name": "S", "bus": "F", "z1_ohm": grid, "z0_ohm": grid}],
        "line": [{"name": "L", "from": "F", "to": "N", "length_km": 1.0, "model": "rl", **line}],
        "inverter": [{"name": "I", "bus": "N", "rated_mva": MVA} | inverter],
        "relay": [{"name": "R", "line": "L", "end": "to", "settings": "none.toml"}],
    }
    if fault is not None:
        data["fault"] = [{"bus": "F", "type": fault, "start_s": FAULT_S}]
    return Plant(Scenario.from_dict(data))


def sequences(samples: NDArray[np.float64], end: int, hz: int) -> tuple[complex, ...]:
    """V1, V2, I1, I2 of the cycle before sample ``end``, per unit; the current is out of the inverter."""
    x = phasors(samples[:end], 0, hz)
    inverse = np.linalg.inv(FORTESCUE)
    (_, v1, v2), (_, i1, i2) = inverse @ x[:3] / VOLTS, inverse @ x[3:] / AMPERES
    return complex(v1), complex(v2), complex(i1), complex(i2)


def outcome(given: Case) -> Case:
    """Means over what is looked at: magnitudes per unit, angles in degrees; the largest peak of the fault's
    first cycle; power before it, and how far the fourth cycle of all is from the first; whether a negative-
    sequence overcurrent element with a pickup of 0.2 sees the fault."""
    plant = behind(given["x_pu"], given["grid_pu"], given["inverter"], given.get("fault"))
    hz = plant.sampling_hz
    rows = record(plant, round((FAULT_S + SEEN_S[1]) * hz))[0][:, 0]
    first = round(FAULT_S * hz)
    ends = range(first + round(SEEN_S[0] * hz), len(rows) + 1, 24)
    found = np.array([sequences(rows, end, hz) for end in ends])
    v1, v2, i1, i2 = found.T
    cycle = hz // 50
    return {
        "v1": float(np.mean(np.abs(v1))),
        "i1": float(np.mean(np.abs(i1))),
        "i1_deg": turned(i1, v1),
        "v2": float(np.mean(np.abs(v2))),
        "i2": float(np.mean(np.abs(i2))),
        "i2_leads_deg": turned(i2, v2),
        "first_peak": float(np.max(np.abs(rows[first : first + cycle, 3:])) / AMPERES),
        "drift": float(np.max(np.abs(rows[:cycle, 3:] - rows[3 * cycle : 4 * cycle, 3:])) / AMPERES),
        "power": power(rows, first, hz).real,
        "50Q": "operates" if np.min(np.abs(i2)) > PICKUP else "does not",
    }


def power(rows: NDArray[np.float64], end: int, hz: int) -> complex:
    """Complex power before the fault, per unit."""
    v1, _, i1, _ = sequences(rows, end, hz)
    return v1 * i1.conjugate()


def turned(a: NDArray[np.complex128], b: NDArray[np.complex128]) -> float:
    """Mean angle of a against b in degrees."""
    return math.degrees(cmath.phase(complex(np.mean(a * b.conj() / np.maximum(np.abs(a * b), 1e-12)))))


def transformer(given: Case) -> Case:
    """What a line with a transformer at its end looks like from its head: zero sequence in an A-G fault
    there, positive sequence of a load behind the delta before it."""
    data: Case = {
        "scenario": {"name": "transformer", "duration_s": 1.0},
        "system": {"frequency_hz": 50, "base_kv": KV},
        "source": [{"name": "S", "bus": "A", "z1_ohm": [1.0, 15.0], "z0_ohm": [2.0, 20.0]}],
        "line": [
            {"name": "L", "from": "A", "to": "B", "length_km": 50.0, "model": "rl"}
            | {"r1_ohm_per_km": 0.06, "x1_ohm_per_km": 0.4, "r0_ohm_per_km": 0.24, "x0_ohm_per_km": 1.2}
        ],
        "transformer": [{"name": "T", "bus": "B", "delta_bus": "D"} | given["transformer"]],
        "load": [{"name": "P", "bus": "D", "mw": 60.0, "mvar": 20.0, "connection": "delta"}],
        "relay": [{"name": "R", "line": "L", "end": "from", "settings": "none.toml"}],
        "fault": [{"bus": "A", "type": "AG", "resistance_ohm": 10.0, "start_s": FAULT_S}],
    }
    plant = Plant(Scenario.from_dict(data))
    hz = plant.sampling_hz
    rows = record(plant, round(0.9 * hz))[0][:, 0]
    inverse = np.linalg.inv(FORTESCUE)
    found = []
    for end in (round(FAULT_S * hz), len(rows)):
        x = phasors(rows[:end], 0, hz)
        found.append((inverse @ x[:3]) / (inverse @ x[3:]))
    z1, z0 = complex(found[0][1]), complex(found[1][0])
    return {"z1_ohm": [z1.real, z1.imag], "z0_ohm": [z0.real, z0.imag]}


CHECKS: dict[str, Callable[[Case], Case]] = {
    "inverter": outcome,
    "transformer": transformer,
    "inverter-elements": element_scores,
}
