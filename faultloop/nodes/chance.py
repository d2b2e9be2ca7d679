"""Chance that does not depend on who asks, nor when: a hash of a seed and a number."""

from __future__ import annotations

import numpy as np

from faultloop.jit import njit


@njit
def uniform(seed: int, number: int) -> float:
    """In [0, 1) (splitmix64; Steele, Lea, Flood 2014); both are uint64."""
    z = np.uint64(seed) + np.uint64(number) * np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z ^= z >> np.uint64(31)
    return np.float64(z >> np.uint64(11)) * 2.0**-53
