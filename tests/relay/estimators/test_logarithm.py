"""The logarithm that vectorises, against `math.log`."""

from __future__ import annotations

import math

import numpy as np

from faultloop.jit import njit
from faultloop.relay.estimators.filters.logarithm import logarithm


@njit
def _each(x: np.ndarray, out: np.ndarray) -> None:
    for n in range(len(x)):
        out[n] = logarithm(x[n])


def test_is_the_logarithm() -> None:
    drawn = np.exp(np.random.default_rng(1).uniform(math.log(math.sqrt(0.5)), 600, 100_000))
    edges = [math.sqrt(0.5), 1.0, np.nextafter(1.0, 2.0), math.sqrt(2), np.nextafter(math.sqrt(2), 2.0), 2.0]
    x = np.concatenate([drawn, edges, 2.0 ** np.arange(0, 1000, 50), [1.7e308]])
    out = np.empty_like(x)
    _each(x, out)
    exact = np.log(x)
    np.testing.assert_array_less(np.abs(out - exact), 1e-15 * np.maximum(1.0, np.abs(exact)))
