"""Square-root form of a scalar correction (Potter 1963): P = S S' stays positive definite under rounding."""

from __future__ import annotations

import math

from faultloop.jit import njit
from faultloop.relay.estimators.base import Array


@njit
def project(root: Array, row: Array, f: Array) -> float:
    """f = S' h; returns h P h'."""
    total = 0.0
    for j in range(len(row)):
        v = 0.0
        for i in range(len(row)):
            v += root[i, j] * row[i]
        f[j] = v
        total += v * v
    return total


@njit
def correct_root(root: Array, f: Array, gain: Array, forgetting: float) -> None:
    """Potter's update of S, eq. 2, and the gain, eq. 4."""
    n = len(f)
    total = forgetting
    for j in range(n):
        total += f[j] * f[j]
    factor = 1.0 / (total + math.sqrt(forgetting * total))
    stretch = 1.0 / math.sqrt(forgetting)
    for i in range(n):
        v = 0.0
        for j in range(n):
            v += root[i, j] * f[j]
        gain[i] = v / total
        for j in range(n):
            root[i, j] = stretch * (root[i, j] - factor * v * f[j])
