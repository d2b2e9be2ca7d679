"""A voltage of a fundamental and odd harmonics whose frequency is a state (seed paper 001, eq. 40 to 42).

The states are x = [A1 sin p1, A1 cos p1, A3 sin p3, A3 cos p3, ..., w]: the momentary phase of each
harmonic in quadrature and the angular frequency [rad/s].  In one sample each pair turns by its harmonic of
w dt, which makes the transition nonlinear; a sample is the sum of the sines, which is linear.

Departure: eq. 42 numbers the blocks i = 1 to 4 and turns each by i w dt; harmonics 1, 3, 5, 7 are meant, as
the text under it says.  The 10 by 10 matrices of the paper's section 4 are 9 by 9.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from faultloop.jit import njit
from faultloop.relay.estimators.filters.kalman import correct, innovation_of, predict_covariance
from faultloop.relay.estimators.filters.unscented import draw, moments

Array = NDArray[np.float64]

# Settings of a filter.
STEP_S = 0  # dt
SPREAD = 1
EXCESS = 2
SOFTENING = 3
FORGETTING = 4
FREQUENCY_SHARE = 5  # of the frequency in the fading: its alpha_j of eq. 9
SETTINGS = 6

# What a filter keeps beside x and P.
RESIDUAL_VARIANCE = 0  # V of eq. 12; negative before the first sample
FADING = 1  # lambda of the last sample
INNOVATION = 2
PREDICTED = 3  # h P h' of the last sample; 0 where the filter faded for it
MEMORY = 4


class HarmonicFilter(NamedTuple):
    """One filter: n = 2 m + 1 states for m odd harmonics.

    Attributes
    ----------
    x, P : (n,), (n, n) state and covariance.
    memory : (MEMORY,).
    settings : (SETTINGS,).
    Q : (n, n) process noise per sample.
    row : (n,) the measurement row h.
    disturbance : (n,) what an expected disturbance adds to the variance of each state (strong_tracking.py).
    widest : (n,) the variance that fading may give each state; infinite in the papers.
    gain, root, work, points : (n,), (n, n), (n, n), (2 n + 1, n), overwritten in every step, so that
        filters may share them.
    """

    x: Array
    P: Array
    memory: Array
    settings: Array
    Q: Array
    row: Array
    disturbance: Array
    widest: Array
    gain: Array
    root: Array
    work: Array
    points: Array


def measurement_row(states: int) -> Array:
    """h = [1, 0, 1, 0, ..., 0], eq. 42."""
    row = np.zeros(states)
    row[0:-1:2] = 1.0
    return row


def harmonic_filter(harmonics: int, settings: Array) -> HarmonicFilter:
    """A filter of its own arrays, all zero but for the settings, the row and the endless ``widest``."""
    n = 2 * harmonics + 1
    memory = np.array([-1.0, 1.0, 0.0, 0.0])
    return HarmonicFilter(
        np.zeros(n), np.zeros((n, n)), memory, settings, np.zeros((n, n)), measurement_row(n),
        np.zeros(n), np.full(n, np.inf), np.zeros(n), np.zeros((n, n)), np.zeros((n, n)),
        np.zeros((2 * n + 1, n)),
    )  # fmt: skip


@njit
def advance(x: Array, step_s: float) -> None:
    """x <- f(x), eq. 42.  The turns by 3 w dt, 5 w dt ... are products of that by w dt and by 2 w dt."""
    angle = x[-1] * step_s
    c, s = math.cos(angle), math.sin(angle)
    twice_c, twice_s = c * c - s * s, 2.0 * c * s
    for i in range(0, len(x) - 1, 2):
        a, b = x[i], x[i + 1]
        x[i] = c * a + s * b
        x[i + 1] = c * b - s * a
        c, s = c * twice_c - s * twice_s, s * twice_c + c * twice_s


@njit
def jacobian(x: Array, step_s: float, F: Array) -> None:
    """F = df/dx at x, the blocks of eq. 42 and the column of w."""
    n = len(x)
    F[:, :] = 0.0
    F[n - 1, n - 1] = 1.0
    angle = x[-1] * step_s
    c, s = math.cos(angle), math.sin(angle)
    twice_c, twice_s = c * c - s * s, 2.0 * c * s
    for i in range(0, n - 1, 2):
        a, b = x[i], x[i + 1]
        F[i, i] = c
        F[i, i + 1] = s
        F[i + 1, i] = -s
        F[i + 1, i + 1] = c
        turn = (i + 1) * step_s
        F[i, n - 1] = turn * (c * b - s * a)
        F[i + 1, n - 1] = -turn * (c * a + s * b)
        c, s = c * twice_c - s * twice_s, s * twice_c + c * twice_s


@njit
def predict_extended(f: HarmonicFilter) -> None:
    """Predict x and P to first order."""
    jacobian(f.x, f.settings[STEP_S], f.root)
    advance(f.x, f.settings[STEP_S])
    predict_covariance(f.P, f.root, f.Q, f.work)


@njit
def predict_unscented(f: HarmonicFilter) -> None:
    """Predict x and P by one sigma-point transform, eq. 22 to 25."""
    draw(f.x, f.P, f.settings[SPREAD], f.points, f.root)
    for i in range(f.points.shape[0]):
        advance(f.points[i], f.settings[STEP_S])
    moments(f.points, f.settings[SPREAD], f.settings[EXCESS], f.x, f.P)
    n = len(f.x)
    for i in range(n):
        for j in range(n):
            f.P[i, j] += f.Q[i, j]


@njit
def correct_linear(f: HarmonicFilter, z: float, R: float) -> None:
    """Correct by the sample z of variance R, eq. 27 to 31: h is linear and needs no sigma points."""
    f.memory[INNOVATION] = innovation_of(f.x, f.row, z)
    correct(f.x, f.P, f.row, f.memory[INNOVATION], R, f.gain)


@njit
def step_extended(f: HarmonicFilter, z: float, R: float) -> None:
    """Extended Kalman filter."""
    predict_extended(f)
    correct_linear(f, z, R)


@njit
def step_unscented(f: HarmonicFilter, z: float, R: float) -> None:
    """Unscented Kalman filter.  The second transform, of the linear h, would change nothing."""
    predict_unscented(f)
    correct_linear(f, z, R)
