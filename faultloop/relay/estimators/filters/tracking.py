"""A harmonic filter over a whole waveform, for studies: one loop for each filter.

The loops differ in one word.  One that takes the step as an argument would be compiled anew in every
process, since numba's file cache does not know a function by its name: 6 times 1.5 s.
"""

from __future__ import annotations

import math

from faultloop.jit import njit
from faultloop.relay.estimators.base import Array
from faultloop.relay.estimators.filters.harmonic_model import (
    FADING,
    HarmonicFilter,
    step_extended,
    step_unscented,
)
from faultloop.relay.estimators.filters.strong_tracking import (
    Seen,
    step_disturbed,
    step_modified,
    step_strong,
    step_strong_unscented,
)


@njit
def note(f: HarmonicFilter, out: Array) -> None:
    """[A1, A3, ..., phase p1 of the fundamental's sine, w, lambda]: m + 3 numbers."""
    m = (len(f.x) - 1) // 2
    for i in range(m):
        out[i] = math.hypot(f.x[2 * i], f.x[2 * i + 1])
    out[m] = math.atan2(f.x[0], f.x[1])
    out[m + 1] = f.x[-1]
    out[m + 2] = f.memory[FADING]


@njit
def track_extended(f: HarmonicFilter, z: Array, R: float, out: Array) -> None:
    """EKF over z (k,), into out (k, m + 3)."""
    for k in range(len(z)):
        step_extended(f, z[k], R)
        note(f, out[k])


@njit
def track_unscented(f: HarmonicFilter, z: Array, R: float, out: Array) -> None:
    """UKF."""
    for k in range(len(z)):
        step_unscented(f, z[k], R)
        note(f, out[k])


@njit
def track_strong(f: HarmonicFilter, z: Array, R: float, out: Array) -> None:
    """STF."""
    for k in range(len(z)):
        step_strong(f, z[k], R)
        note(f, out[k])


@njit
def track_modified(f: HarmonicFilter, z: Array, R: float, out: Array) -> None:
    """MSTUKF."""
    for k in range(len(z)):
        step_modified(f, z[k], R)
        note(f, out[k])


@njit
def track_disturbed(f: HarmonicFilter, z: Array, R: float, out: Array) -> None:
    """MSTUKF with an expected disturbance."""
    for k in range(len(z)):
        step_disturbed(f, z[k], R)
        note(f, out[k])


@njit
def track_strong_unscented(f: HarmonicFilter, s: Seen, z: Array, R: float, out: Array) -> None:
    """STUKF; ``s`` as `seen` makes it."""
    for k in range(len(z)):
        step_strong_unscented(f, s, z[k], R)
        note(f, out[k])
