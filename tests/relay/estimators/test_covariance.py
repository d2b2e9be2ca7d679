"""The covariance of every Kalman-type estimator stays symmetric and positive definite, whatever comes in."""

from __future__ import annotations

import numpy as np
import pytest

from faultloop.relay.estimators import ROW, harmonic_filters, make_estimator, run_estimator
from faultloop.relay.estimators.filters import offset_bank
from faultloop.relay.estimators.methods import adaptive_kalman, rls, taylor_kalman

COUNT, LONG = 50_000, 1_000_000
BLOCK = 1000


def packed(p):
    """The symmetric matrix whose upper triangle is ``p``, row by row."""
    n = int(np.sqrt(2 * len(p)))
    full = np.zeros((n, n))
    full[np.triu_indices(n)] = p
    return full + np.triu(full, 1).T


def of_harmonics(state):
    return [harmonic_filters.filter_of(state, c).P for c in range(6)]


def of_adaptive(state):
    voltages = [packed(adaptive_kalman.voltage_of.py_func(state, c)[2:]) for c in range(3)]
    return voltages + [packed(adaptive_kalman.current_of.py_func(state, c)[3:]) for c in range(3)]


def of_bank(state):
    voltage = packed(state[offset_bank.VOLTAGE_P : offset_bank.VOLTAGE_P + 3])
    return [voltage, *offset_bank.model_covariances(state, 12)]


def of_rls(state):
    n = int(state[rls.UNKNOWNS])
    start = rls.WORK + 3 * n
    return [squared(state[start : start + n * n].reshape(n, n))]


def of_taylor(state):
    return [squared(state[taylor_kalman.ROOT : taylor_kalman.STATES].reshape(10, 10))]


def squared(root):
    return root @ root.T


COVARIANCES = {
    "adaptive-kalman": of_adaptive,
    "kalman-bank": of_bank,
    "rls": of_rls,
    "taylor-kalman": of_taylor,
} | dict.fromkeys(("ekf", "ukf", "stf", "stukf", "mstukf"), of_harmonics)


def samples_of(rng, first):
    """A thousand samples off nominal frequency: noise, harmonics outside any model, steps, gaps, spikes of
    1e90, a channel that is always dead and one that is dead for a while."""
    n = np.arange(first, first + BLOCK)
    angle = 2 * np.pi * 51 * n / 1200
    samples = np.cos(angle[:, None] + np.arange(6)) * rng.choice([0.0, 0.1, 1.0, 30.0], size=6)
    samples += rng.choice([0.0, 0.1]) * np.cos(11 * angle)[:, None]
    samples += rng.normal(scale=0.02, size=samples.shape)
    samples[:, 5] = 0.0
    samples[rng.integers(BLOCK, size=5)] = np.nan
    if rng.random() < 0.05:
        samples[rng.integers(BLOCK), rng.integers(5)] = 1e90
    return samples


def stay_positive_definite(method, count):
    """Every covariance, scaled to a unit diagonal: symmetric to the bit, and its least eigenvalue above 0."""
    rng = np.random.default_rng(6)
    estimator = make_estimator(method, 1200, 50.0)
    state, rows = estimator.state.copy(), np.empty((BLOCK, ROW))
    for first in range(0, count, BLOCK):
        run_estimator(estimator.step, state, samples_of(rng, first), rows)
        assert np.isfinite(rows[:, :12]).all()
        for k, P in enumerate(COVARIANCES[method](state)):
            if not P.any():
                continue  # a channel that has seen nothing yet
            np.testing.assert_array_equal(P, P.T)
            scale = np.sqrt(np.diag(P))
            assert np.isfinite(scale).all() and (scale > 0.0).all(), (first, k)
            assert np.linalg.eigvalsh(P / np.outer(scale, scale))[0] > 0.0, (first, k)


@pytest.mark.parametrize("method", COVARIANCES)
def test_covariance_stays_positive_definite(method):
    stay_positive_definite(method, COUNT)


@pytest.mark.slow
@pytest.mark.parametrize("method", COVARIANCES)
def test_covariance_stays_positive_definite_for_a_million_samples(method):
    stay_positive_definite(method, LONG)
