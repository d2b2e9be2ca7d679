"""Recursive least squares: a decaying offset and n harmonics, from the first sample on.

Li Liezhong, Zhou Chao, "The application of recursive least squares in microprocessor protection" (Chinese),
1993 (its text does not name the journal): seed paper 004.

The model is eq. 5 there, x0 exp(-t / Td) + sum_j (xRj cos j w t + xIj sin j w t), and the recursion eq. 2
to 4 with P0 = alpha^2 I, so that it starts at N = 1 and is the batch estimate from N = 2 n + 1 on.  At a
detected disturbance it starts again.  The gain does not depend on the samples: one P serves the six
channels.

Departures.  The offset's state is its present value, which decays in the transition, and not its initial
value: the same estimate in other coordinates, but the row of the model stays 1, so that a forgetting factor
does not wind up once exp(-t / Td) has vanished.  P is carried as its square root (Potter).  To be the batch
estimate at N = 2 n + 1 the nearly collinear first samples need an alpha^2 of 1e16 at 96 samples per cycle,
where eq. 2 in double precision is wrong by 40 % later on and the square root by 1e-8.  The default of 1e5
is the least in the paper: it holds the first samples back, which noise would otherwise throw to several
times the amplitude.
"""

from __future__ import annotations

import math

import numpy as np

from faultloop.jit import njit
from faultloop.relay.estimators.base import CHANNELS, FREQUENCY, ROCOF, Array, Estimator
from faultloop.relay.estimators.common_gain import correct_channels, innovate
from faultloop.relay.estimators.disturbance import (
    DETECTION_THRESHOLD,
    FREQUENCY_HZ,
    HEADER,
    NOISE_FLOOR,
    SAMPLING_HZ,
    N,
    follow_level,
    header,
    is_disturbed,
)
from faultloop.relay.estimators.filters.square_root import correct_root, project
from faultloop.relay.estimators.parameters import number, samples_per_cycle, whole
from faultloop.relay.estimators.reference import PEAK_TO_RMS, reference

FORGETTING = HEADER
ALPHA = HEADER + 1
TRANSITION = HEADER + 2  # of the offset, per sample
UNKNOWNS = HEADER + 3
INNOVATION = HEADER + 4  # six
WORK = (
    HEADER + 10
)  # model row h, f = S' h, gain: three times the unknowns; then S row by row; then six times x


@njit
def fill_row(row: Array, cos: float, sin: float) -> None:
    """h = [1, cos w t, -sin w t, cos 2 w t, -sin 2 w t, ...]."""
    row[0] = 1.0
    c, s = cos, sin
    for j in range(1, len(row), 2):
        row[j] = c
        row[j + 1] = -s
        c, s = c * cos - s * sin, s * cos + c * sin


@njit
def rls_step(state: Array, x: Array, out: Array) -> None:
    n = int(state[UNKNOWNS])
    row = state[WORK : WORK + n]
    f = state[WORK + n : WORK + 2 * n]
    gain = state[WORK + 2 * n : WORK + 3 * n]
    root = state[WORK + 3 * n : WORK + 3 * n + n * n].reshape((n, n))
    states = state[WORK + 3 * n + n * n :].reshape((n, CHANNELS))
    innovation = state[INNOVATION : INNOVATION + CHANNELS]
    forgetting = state[FORGETTING]
    decay = state[TRANSITION]

    follow_level(state, x)
    cos, sin = reference(state[N], state[SAMPLING_HZ], state[FREQUENCY_HZ])
    fill_row(row, cos, sin)
    for j in range(n):
        v = root[0, j] * decay
        root[0, j] = v if abs(v) > 1e-100 else 0.0  # no denormal numbers: they are slow
    projected = project(root, row, f) / forgetting
    for c in range(CHANNELS):
        states[0, c] *= decay
    innovate(state, x, row, states, innovation, projected)
    if is_disturbed(state):
        root[:, :] = 0.0
        for i in range(n):
            root[i, i] = state[ALPHA]
        projected = project(root, row, f) / forgetting
    correct_root(root, f, gain, forgetting)
    correct_channels(state, x, gain, states, innovation, projected)
    for c in range(CHANNELS):
        out[2 * c] = PEAK_TO_RMS * states[1, c]
        out[2 * c + 1] = PEAK_TO_RMS * states[2, c]
    out[FREQUENCY] = math.nan
    out[ROCOF] = math.nan
    state[N] += 1.0


def make(
    sampling_hz: int,
    frequency_hz: float,
    *,
    time_constant_ms: float = 40.0,
    harmonics: int = 1,
    initial_covariance: float = 1e5,
    forgetting_factor: float | None = None,
    noise_floor: float = NOISE_FLOOR,
    detection_threshold: float = DETECTION_THRESHOLD,
) -> Estimator:
    """Recursive least squares.

    Parameters
    ----------
    time_constant_ms : Td, time constant of the offset [ms].
    harmonics : n, harmonics in the model, the fundamental counted.
    initial_covariance : alpha^2, over the variance of the noise; the paper has 1e5 to 1e10.
    forgetting_factor : weight of the last sample's past, per sample; 1 forgets nothing until a disturbance.
        Not given, the memory is half a cycle: 1 - 2 f0 / fs.
    noise_floor : least standard deviation of the noise, over the peak of the voltages or currents.
    detection_threshold : squared normalised innovation that is a disturbance.

    Raises InputError below two samples per cycle for each of the 2 n + 1 unknowns, or for a parameter
    outside its limits.
    """
    harmonics = whole("harmonics", harmonics, least=1, most=20)
    n = 2 * harmonics + 1
    per_cycle = samples_per_cycle(sampling_hz, frequency_hz, least=2 * n, method="rls")
    if forgetting_factor is None:
        forgetting_factor = 1.0 - 2.0 / per_cycle
    forgetting = number("forgetting_factor", forgetting_factor, least=0.5, most=1.0)
    tau = 1e-3 * number("time_constant_ms", time_constant_ms, least=1.0, most=1000.0)
    state = np.zeros(WORK + 3 * n + n * n + CHANNELS * n)
    state[:HEADER] = header(sampling_hz, frequency_hz, noise_floor, detection_threshold, 0.0)
    state[FORGETTING] = forgetting
    state[ALPHA] = math.sqrt(number("initial_covariance", initial_covariance, least=1.0, most=1e20))
    state[TRANSITION] = math.exp(-1.0 / (tau * sampling_hz))
    state[UNKNOWNS] = n
    return Estimator("rls", rls_step, state, math.ceil(per_cycle))
