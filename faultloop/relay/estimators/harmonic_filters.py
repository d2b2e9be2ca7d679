"""Six harmonic filters as one estimator: the layout of the state, what they share, and the phasor row.

Seed paper 001 filters one voltage in per unit.  A relay has six channels of any size, so the variances of
the paper are those over the squared peak of the three voltages, or of the three currents (disturbance.py);
the frequency's are in (rad/s)^2.  A channel sleeps until its group has a sample that is not zero, and passes
a missing sample over: it is predicted to first order.

What no measurement can ask for is kept out, for the filters linearise about their own estimate: one that has
left the signal widens its covariance, which throws the next one farther.  An amplitude stays within
`LARGEST_AMPLITUDE` peaks (no harmonic of a waveform has more than 4 / pi of its peak; the peak may still be
rising), the frequency of a channel within 20 % of nominal and its variance within the initial one.

The frequency reported is that of the three voltages, each with its squared amplitude for weight; rocof is
its derivative through a first-order low-pass of `ROCOF_CYCLES`.  Both are NaN until there has been a voltage
for the filter's settling time.
"""

from __future__ import annotations

import math

import numpy as np

from faultloop.jit import njit
from faultloop.relay.estimators.base import CHANNELS, FREQUENCY, ROCOF, Array
from faultloop.relay.estimators.disturbance import (
    DETECTION_THRESHOLD,
    FREQUENCY_HZ,
    HEADER,
    LEVEL,
    LEVEL_DECAY,
    SAMPLING_HZ,
    SMALLEST,
    VARIANCE_GAIN,
    N,
    follow_level,
    follow_variance,
    header,
    is_sample,
    noise_variance,
)
from faultloop.relay.estimators.filters.harmonic_model import (
    EXCESS,
    FADING,
    FORGETTING,
    FREQUENCY_SHARE,
    INNOVATION,
    MEMORY,
    PREDICTED,
    RESIDUAL_VARIANCE,
    SETTINGS,
    SOFTENING,
    SPREAD,
    STEP_S,
    HarmonicFilter,
    measurement_row,
    predict_extended,
)
from faultloop.relay.estimators.filters.strong_tracking import Seen
from faultloop.relay.estimators.filters.unscented import sigma_spread
from faultloop.relay.estimators.parameters import number, samples_per_cycle, whole
from faultloop.relay.estimators.reference import PEAK_TO_RMS, reference

STATES = HEADER  # n
PROCESS = HEADER + 1  # process noise of the quadratures per sample, over R
FREQUENCY_PROCESS = HEADER + 2  # of the frequency per sample [(rad/s)^2]
INITIAL = HEADER + 3  # initial variance of the quadratures, over the squared peak
FREQUENCY_INITIAL = HEADER + 4  # of the frequency [(rad/s)^2]
FUNDAMENTAL_CHANGE = HEADER + 5  # an expected disturbance's, over the squared peak
HARMONIC_CHANGE = HEADER + 6
SMOOTH_HZ = HEADER + 7  # low-pass of the frequency, for rocof
AWAKE = HEADER + 8  # samples since the first voltage
SETTLING = HEADER + 9  # of them until the frequency is reported
BAND = HEADER + 10  # of the frequency, over nominal, either way
MOST_AMPLITUDE = HEADER + 11  # over the peak
WIDENING = HEADER + 12  # the most that fading may make of a variance, over the initial one
SETTING = HEADER + 13
WORK = SETTING + SETTINGS

FREQUENCY_BAND = 0.2  # of nominal, either way
LARGEST_AMPLITUDE = 4.0  # over the peak
SETTLING_CYCLES = 4.0  # twice the memory of the frequency
ROCOF_CYCLES = 2.0


@njit
def work_length(n: int) -> int:
    """Q, root, work, points; row, disturbance, widest, gain; images, mean, total, innovation, cross, gain."""
    return 3 * n * n + (2 * n + 1) * n + 4 * n + (2 * n + 1) + 3 + 2 * n


# ``heap``, here and in all that calls it: numba's reshape gives an array that must be counted
@njit(heap=True)
def square(state: Array, start: int, n: int) -> Array:
    return state[start : start + n * n].reshape((n, n))


@njit(heap=True)
def filter_of(state: Array, c: int) -> HarmonicFilter:
    """The filter of channel c."""
    n = int(state[STATES])
    points = WORK + 3 * n * n
    vectors = points + (2 * n + 1) * n
    own = WORK + work_length(n) + c * (n + n * n + MEMORY)
    return HarmonicFilter(
        state[own : own + n],
        square(state, own + n, n),
        state[own + n + n * n : own + n + n * n + MEMORY],
        state[SETTING : SETTING + SETTINGS],
        square(state, WORK, n),
        state[vectors : vectors + n],
        state[vectors + n : vectors + 2 * n],
        state[vectors + 2 * n : vectors + 3 * n],
        state[vectors + 3 * n : vectors + 4 * n],
        square(state, WORK + n * n, n),
        square(state, WORK + 2 * n * n, n),
        state[points:vectors].reshape((2 * n + 1, n)),
    )


@njit(heap=True)
def seen_of(state: Array) -> Seen:
    """What a transform of the measurement overwrites."""
    n = int(state[STATES])
    start = WORK + 3 * n * n + (2 * n + 1) * n + 4 * n
    one = start + 2 * n + 1
    return Seen(
        state[start:one].reshape((2 * n + 1, 1)),
        state[one : one + 1],
        state[one + 1 : one + 2].reshape((1, 1)),
        state[one + 2 : one + 3],
        state[one + 3 : one + 3 + n].reshape((n, 1)),
        state[one + 3 + n : one + 3 + 2 * n].reshape((n, 1)),
    )


@njit(heap=True)
def prepare(state: Array, f: HarmonicFilter, c: int) -> bool:
    """Q, D and the widest variances of channel c.  False while its group has been nothing but zero."""
    level = state[LEVEL + c // 3]
    n = len(f.x)
    quadrature = state[PROCESS] * noise_variance(state, c)
    for i in range(n - 1):
        f.Q[i, i] = quadrature
        f.disturbance[i] = state[HARMONIC_CHANGE] * level
        f.widest[i] = state[WIDENING] * state[INITIAL] * level
    f.widest[n - 1] = state[WIDENING] * state[FREQUENCY_INITIAL]
    f.Q[n - 1, n - 1] = state[FREQUENCY_PROCESS]
    f.disturbance[0] = state[FUNDAMENTAL_CHANGE] * level
    f.disturbance[1] = f.disturbance[0]
    return level > 0.0


@njit(heap=True)
def renew(state: Array, f: HarmonicFilter, c: int) -> None:
    """Forget how sure the quadratures were, and keep them as the prior mean; the frequency stays."""
    n = len(f.x)
    frequency = f.P[n - 1, n - 1] if f.P[n - 1, n - 1] > 0.0 else state[FREQUENCY_INITIAL]
    f.P[:, :] = 0.0
    for i in range(n - 1):
        f.P[i, i] = state[INITIAL] * state[LEVEL + c // 3] + SMALLEST
    f.P[n - 1, n - 1] = frequency


@njit(heap=True)
def bound(state: Array, f: HarmonicFilter, c: int) -> None:
    """Keep the amplitudes and the frequency where they can be, and the frequency's variance within the
    initial one."""
    n = len(f.x)
    most = state[MOST_AMPLITUDE] ** 2 * state[LEVEL + c // 3] + SMALLEST
    for i in range(0, n - 1, 2):
        square = f.x[i] * f.x[i] + f.x[i + 1] * f.x[i + 1]
        if square > most:
            shrink = math.sqrt(most / square)
            f.x[i] *= shrink
            f.x[i + 1] *= shrink
    nominal = 2.0 * math.pi * state[FREQUENCY_HZ]
    f.x[n - 1] = min(max(f.x[n - 1], (1.0 - state[BAND]) * nominal), (1.0 + state[BAND]) * nominal)
    widest = state[WIDENING] * state[FREQUENCY_INITIAL]
    if f.P[n - 1, n - 1] > widest:
        shrink = math.sqrt(widest / f.P[n - 1, n - 1])
        for i in range(n):  # a row and a column by one factor: still positive definite
            f.P[n - 1, i] *= shrink
            f.P[i, n - 1] *= shrink


@njit(heap=True)
def begin(state: Array, x: Array) -> None:
    """Levels; a channel whose group has come alive gets its initial covariance."""
    follow_level(state, x)
    for c in range(CHANNELS):
        f = filter_of(state, c)
        if prepare(state, f, c) and f.P[0, 0] == 0.0:
            renew(state, f, c)


@njit(heap=True)
def is_due(state: Array, f: HarmonicFilter, c: int, z: float) -> bool:
    """True if channel c is awake and has a sample; where it is missing, the filter is predicted here."""
    if not prepare(state, f, c):
        return False
    if is_sample(z):
        return True
    predict_extended(f)
    bound(state, f, c)
    return False


@njit(heap=True)
def follow(state: Array, f: HarmonicFilter, c: int) -> None:
    """The noise of channel c after a strong tracking step, and the bounds.

    A sample that the filter faded for counts as if P were zero: P is then as wide as was asked for, and says
    nothing of what the sample should have been.  So a residual that comes for ever, as that of a harmonic
    outside the model, is noise within a cycle, while a disturbance is over before.
    """
    follow_variance(state, c, f.memory[INNOVATION], f.memory[PREDICTED])
    bound(state, f, c)


@njit(heap=True)
def report(state: Array, out: Array) -> None:
    """The phasor row, from x = [A sin p, A cos p, ..., w] of each channel."""
    cos, sin = reference(state[N], state[SAMPLING_HZ], state[FREQUENCY_HZ])
    weight, total = SMALLEST, SMALLEST * state[FREQUENCY_HZ]
    for c in range(CHANNELS):
        x = filter_of(state, c).x
        out[2 * c] = PEAK_TO_RMS * (x[0] * cos - x[1] * sin)
        out[2 * c + 1] = -PEAK_TO_RMS * (x[1] * cos + x[0] * sin)
        if c < 3:
            amplitude = x[0] * x[0] + x[1] * x[1]
            weight += amplitude
            total += amplitude * x[-1] / (2.0 * math.pi)
    time_s = ROCOF_CYCLES / state[FREQUENCY_HZ]
    found = total / weight
    rate = (found - state[SMOOTH_HZ]) / time_s
    state[SMOOTH_HZ] += rate / state[SAMPLING_HZ]
    if state[LEVEL] > 0.0:
        state[AWAKE] += 1.0
    settled = state[AWAKE] > state[SETTLING]
    out[FREQUENCY] = found if settled else math.nan
    out[ROCOF] = rate if settled else math.nan
    state[N] += 1.0


def make_state(
    sampling_hz: int,
    frequency_hz: float,
    *,
    harmonics: int,
    measurement_variance: float,
    process_variance: float | None,
    frequency_process_variance: float | None,
    detection_threshold: float = DETECTION_THRESHOLD,
) -> Array:
    """The state of six filters that sleep.

    Parameters
    ----------
    harmonics : m odd harmonics in the model, the fundamental counted; n = 2 m + 1 states.
    measurement_variance : R, over the squared peak.
    process_variance : Q of each quadrature per sample, over the squared peak.  Not given: a memory of half a
        cycle, R times 2 / memory^2.
    frequency_process_variance : Q of the frequency per sample [(rad/s)^2].  Not given: a memory of two
        cycles, Q / dt^2 of the quadratures over memory^2.

    Raises
    ------
    InputError : a variance that is not positive, or fewer than 4 m samples per cycle: the highest
        harmonic, 2 m - 1, must stay below half of sampling_hz.
    """
    harmonics = whole("harmonics", harmonics, least=1, most=12)
    per_cycle = samples_per_cycle(
        sampling_hz, frequency_hz, least=max(6, 4 * harmonics), method=f"harmonics = {harmonics}"
    )
    R = number("measurement_variance", measurement_variance, above=0.0, most=0.04)
    if process_variance is None:
        process_variance = R * 2.0 / (0.5 * per_cycle) ** 2
    quadrature = number("process_variance", process_variance, above=0.0)
    if frequency_process_variance is None:
        frequency_process_variance = quadrature * sampling_hz**2 / (2.0 * per_cycle) ** 2
    n = 2 * harmonics + 1
    state = np.zeros(WORK + work_length(n) + CHANNELS * (n + n * n + MEMORY))
    state[:HEADER] = header(sampling_hz, frequency_hz, math.sqrt(R), detection_threshold)
    state[STATES] = n
    state[PROCESS] = quadrature / R
    state[FREQUENCY_PROCESS] = number("frequency_process_variance", frequency_process_variance, above=0.0)
    state[SMOOTH_HZ] = frequency_hz
    state[SETTLING] = settling_samples(sampling_hz, frequency_hz)
    state[BAND], state[MOST_AMPLITUDE], state[WIDENING] = FREQUENCY_BAND, LARGEST_AMPLITUDE, 1.0
    state[SETTING + STEP_S] = 1.0 / sampling_hz
    filter_of.py_func(state, 0).row[:] = measurement_row(n)
    for c in range(CHANNELS):
        f = filter_of.py_func(state, c)
        f.x[-1] = 2.0 * math.pi * frequency_hz
        f.memory[RESIDUAL_VARIANCE] = -1.0
        f.memory[FADING] = 1.0
    return state


def set_initial(state: Array, initial_variance: float, frequency_initial_variance: float) -> None:
    """P0: of the quadratures over the squared peak, of the frequency in (rad/s)^2; both above 0."""
    state[INITIAL] = number("initial_variance", initial_variance, above=0.0, most=1e9)
    state[FREQUENCY_INITIAL] = number("frequency_initial_variance", frequency_initial_variance, above=0.0)


def set_sigma_points(state: Array, alpha: float, beta: float, kappa: float) -> None:
    """alpha, beta, kappa of the sigma points (unscented.py)."""
    spread, excess = sigma_spread(int(state[STATES]), alpha, beta, kappa)
    state[SETTING + SPREAD] = spread
    state[SETTING + EXCESS] = excess


def set_fading(
    state: Array, softening_factor: float, forgetting_factor: float, frequency_share: float = 0.0
) -> None:
    """beta of eq. 10, rho of eq. 12, and the frequency's alpha of eq. 9."""
    state[SETTING + SOFTENING] = number("softening_factor", softening_factor, least=1.0)
    state[SETTING + FORGETTING] = number("forgetting_factor", forgetting_factor, above=0.0, most=1.0)
    state[SETTING + FREQUENCY_SHARE] = number("frequency_share", frequency_share, least=0.0, most=1.0)


def set_as_written(state: Array) -> None:
    """R stays at its share of the greatest squared peak so far, and nothing is bounded: seed paper 001's "
    "own."""
    state[VARIANCE_GAIN] = 0.0
    state[LEVEL_DECAY] = 1.0
    state[BAND] = state[MOST_AMPLITUDE] = state[WIDENING] = math.inf


def settling_samples(sampling_hz: int, frequency_hz: float) -> int:
    """Of any of these filters."""
    return math.ceil(SETTLING_CYCLES * sampling_hz / frequency_hz)
