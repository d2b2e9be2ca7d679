"""Runs a plant and keeps what it gives."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from faultloop.plant import Change, Plant


def record(plant: Plant, count: int, block: int = 10**6) -> tuple[NDArray[np.float64], list[Change]]:
    """The next ``count`` samples (count, relays, 6), and what changed in them."""
    samples: list[NDArray[np.float64]] = []
    changes: list[Change] = []
    while (done := sum(map(len, samples))) < count:
        plant.advance(min(block, count - done))
        samples.append(plant.samples.copy())
        changes += plant.changes
    return np.concatenate(samples), changes


def now_ns(plant: Plant) -> int:
    """Time of the last sample."""
    return (plant.sample_count - 1) * 10**9 // plant.sampling_hz
