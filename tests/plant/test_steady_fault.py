"""The faulted steady state against exact long-line equations, and the purity of what comes before."""

from __future__ import annotations

import numpy as np
import pytest

from faultloop.plant import Plant
from faultloop.plant.fault import FAULT_TYPES
from tests.measured import Measured
from tests.plant.reference import build, phasors, solve

POSITIONS = (0.0, 0.1, 0.45, 0.8, 1.0)
LIMIT = {"rl": 0.001, "pi": 0.001, "bergeron": 0.001}
SECONDS = 0.6  # the slowest decay of this network has 25 ms


def settled(model: str, kind: str, position: float, resistance: float) -> np.ndarray:
    fault = {"line": "L", "at_pu": position, "type": kind, "start_s": 0.0, "resistance_ohm": resistance}
    plant = Plant(build(model, fault=[{"name": "F", **fault}]))
    samples, number = [], 0
    while number < SECONDS * plant.sampling_hz:
        number += plant.advance(int(SECONDS * plant.sampling_hz) - number)
        samples.append(plant.samples.copy())
    return phasors(np.concatenate(samples), 0, plant.sampling_hz)


@pytest.mark.parametrize("position", POSITIONS)
@pytest.mark.parametrize("model", ["rl", "pi", "bergeron"])
def test_fault_phasors(model: str, position: float, measured: Measured) -> None:
    for kind in FAULT_TYPES:
        for resistance in (0.0, 20.0):
            ours, exact = settled(model, kind, position, resistance), solve(model, position, kind, resistance)
            # the vector error bounds both: 0.5 % of it is 0.29 degrees; a phase near zero is
            # measured against 2 % of the largest
            for part in (slice(0, 3), slice(3, 6)):
                size = np.maximum(np.abs(exact[:, part]), 0.02 * np.abs(exact[:, part]).max())
                error = np.abs(ours[:, part] - exact[:, part]) / size
                measured(f"vector error of {model}", 100 * error.max(), "%")
                assert error.max() < LIMIT[model], (kind, resistance, part, error)


@pytest.mark.parametrize("model", ["rl", "pi", "bergeron"])
def test_before_the_fault_the_samples_are_a_pure_sinusoid(model: str, measured: Measured) -> None:
    plant = Plant(build(model))
    plant.advance(4800)
    x = plant.samples
    k = np.arange(len(x))
    basis = np.stack([np.cos(2 * np.pi * k / 96), np.sin(2 * np.pi * k / 96)], axis=1)
    for relay in range(2):
        fit, *_ = np.linalg.lstsq(basis, x[:, relay], rcond=None)
        residual = np.abs(basis @ fit - x[:, relay]).max(axis=0)
        measured("what no sinusoid is", (residual / np.hypot(*fit)).max())
        assert (residual / np.hypot(*fit)).max() < 1e-9
    exact = solve(model, 0.5, None)
    assert np.abs(phasors(x, 0, 4800) / exact - 1).max() < 1e-3
