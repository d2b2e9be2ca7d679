"""A two-ended network as a scenario, what its plant gives, and phasors of that."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from faultloop.loop.scenario import Scenario
from faultloop.plant import Change, Plant

Complex = NDArray[np.complex128]

FREQUENCY = 50.0
BASE_KV = 220.0
KM = 120.0
LINE = {"r1": 0.06, "x1": 0.40, "b1": 2.8, "r0": 0.24, "x0": 1.2, "b0": 1.8}
SOURCES = {  # angle, z1, z0
    "A": (0.0, 2.5 + 14j, 3.0 + 11j),
    "B": (-12.0, 3.5 + 20j, 5.0 + 26j),
}
A = np.exp(2j * np.pi / 3)
FORTESCUE = np.array([[1, 1, 1], [1, A**2, A], [1, A, A**2]])


def network(model: str = "bergeron", **tables: Any) -> dict[str, Any]:
    """The scenario as a dict: sources at A and B, line L, a relay at each end; no breaker, no fault."""
    line = {f"{k}_{'us' if k[0] == 'b' else 'ohm'}_per_km": v for k, v in LINE.items()}
    if model == "rl":
        line = {k: v for k, v in line.items() if k[0] != "b"}
    data: dict[str, Any] = {
        "scenario": {"name": "reference", "duration_s": 2.0},
        "system": {"frequency_hz": 50, "base_kv": BASE_KV},
        "source": [
            {"name": bus, "bus": bus, "angle_deg": angle, "z1_ohm": pair(z1), "z0_ohm": pair(z0)}
            for bus, (angle, z1, z0) in SOURCES.items()
        ],
        "line": [{"name": "L", "from": "A", "to": "B", "length_km": KM, "model": model, **line}],
        "relay": [
            {"name": f"R{bus}", "line": "L", "end": end, "settings": "none.toml"}
            for bus, end in (("A", "from"), ("B", "to"))
        ],
    }
    for name, value in tables.items():
        data[name] = data[name] | value if isinstance(value, dict) and name in data else value
    return data


def build(model: str = "bergeron", **tables: Any) -> Scenario:
    """`network` as a Scenario."""
    return Scenario.from_dict(network(model, **tables))


def pair(z: complex) -> list[float]:
    return [z.real, z.imag]


def record(plant: Plant, count: int, block: int = 10**6) -> tuple[NDArray[np.float64], list[Change]]:
    """The next ``count`` samples (count, relays, 6), and what changed in them."""
    samples: list[NDArray[np.float64]] = []
    changes: list[Change] = []
    while (done := sum(map(len, samples))) < count:
        plant.advance(min(block, count - done))
        samples.append(plant.samples.copy())
        changes += plant.changes
    return np.concatenate(samples), changes


def phasors(samples: NDArray[np.float64], first: int, sampling_hz: int) -> Complex:
    """Peak phasors of the last axis-0 whole cycle of samples whose first has number ``first``."""
    count = round(sampling_hz / FREQUENCY)
    k = np.arange(len(samples) - count, len(samples))
    turn = np.exp(-2j * np.pi * FREQUENCY / sampling_hz * (first + k))
    return np.asarray(2 / count * np.tensordot(turn, samples[k], axes=1), np.complex128)
