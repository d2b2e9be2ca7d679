"""The last samples, over a cycle and a half: for what is judged in time and not by phasors.

At most 128 values a cycle are kept: above that sampling rate each is the mean of several samples.
"""

from __future__ import annotations

import cmath
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from faultloop.jit import njit

Record = Any
PER_CYCLE = 128
LENGTH = 3 * PER_CYCLE // 2
LARGEST = 1e100
SQRT2 = math.sqrt(2.0)

RECENT = np.dtype(
    [
        ("value", "f8", (LENGTH, 7)),  # va vb vc ia ib ic, 3 i0 of the parallel line
        ("head", "i8"),  # the newest
        ("sum", "f8", (7,)),  # of the samples towards the next
        ("count", "i8"),
        ("mutual", "f8"),  # what of the parallel line's counts with 3 i0 in a ground loop; 0: nothing
        ("beside", "c16"),  # phasor of the parallel line's, over the last cycle [A RMS]
    ],
    align=True,
)


def stride(sampling_hz: float, frequency_hz: float) -> int:
    """Samples in a value."""
    return math.ceil(sampling_hz / frequency_hz / PER_CYCLE)


@njit
def instantaneous(sample: NDArray, x: NDArray, turn: complex, out: NDArray) -> None:
    """The six samples; for one that is missing what its phasor (RMS) says, ``turn`` = e^(j w0 t)."""
    for k in range(6):
        out[k] = sample[k] if abs(sample[k]) < LARGEST else SQRT2 * (x[k] * turn).real


@njit
def keep(g: Record, r: Record, sample: NDArray, beside: float, turn: complex) -> None:
    """Take a sample in, and that of the parallel line's 3 i0 (NaN: none); ``turn`` = e^(j w0 t)."""
    for k in range(6):
        r.sum[k] += sample[k]
    if not np.isnan(beside):
        r.sum[6] += beside
    r.count += 1
    if r.count < g.stride:
        return
    r.count = 0
    r.head = (r.head + 1) % LENGTH
    for k in range(7):
        r.value[r.head, k] = r.sum[k] / g.stride
        r.sum[k] = 0.0
    if not np.isnan(beside):
        new, old = r.value[r.head, 6], r.value[(r.head - g.values) % LENGTH, 6]
        back = cmath.rect(1.0, g.turn_per_value * g.values)
        r.beside += SQRT2 / g.values * (new - old * back) * turn.conjugate()


@njit
def largest_current(r: Record, phase: int, count: int) -> float:
    """Of one phase, in size, over the last ``count`` values [A, peak]."""
    result = 0.0
    for j in range(count):
        result = max(result, abs(r.value[(r.head - j) % LENGTH, 3 + phase]))
    return result
