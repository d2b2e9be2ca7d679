"""What the recursive estimators share: each channel's noise variance, and the detection of a disturbance.

A recursive filter that has settled gives a new sample little weight; at a fault inception it must be told
to start afresh.  The test is on the innovations e = z - H x(k/k-1), whose variance the filter itself
predicts as S = H P H' + R: e^2 / S is chi-square with one degree of freedom whatever the noise, and falls
back by itself once a renewed covariance makes S large.  So there is no hold-off: an evolving fault is seen
at once, and while a current is still growing out of its renewed covariance the covariance is renewed again.

The decision is common to all six channels.  The phases of one line see the same inception, a loop impedance
is a quotient of channels and wants them equally young, and the offset has one start.  The variance is not
common: a noisy channel raises its own R, not the others'.

R is eq. 10 of Zhang and Chen (seed paper 000): e^2 - H P H' is an unbiased estimate of it.  One sample of
that has a standard deviation of sqrt(2) S, so it is averaged, with the weight of its precision (R / S)^2: a
step of Fisher scoring towards the maximum of the innovations' likelihood, in which a sample taken while P
is wide counts for nothing.  The paper takes each sample alone; at an inception R then jumps with e^2, the
gain goes to nothing and the filter stays behind.  A floor, relative to the peak of the three voltages or of
the three currents, keeps R from zero in a signal without noise.

A sample that is not finite (or beyond `LARGEST`) is missing: its channel is predicted, not corrected.
"""

from __future__ import annotations

import math

import numpy as np

from faultloop.jit import njit
from faultloop.relay.estimators.base import Array
from faultloop.relay.estimators.parameters import number

# The header of every recursive estimator's state.
N = 0  # number of the next sample
SAMPLING_HZ = 1
FREQUENCY_HZ = 2
RENEWALS = 3  # disturbances detected so far
SCORE = 4
THRESHOLD = 5
VARIANCE_GAIN = 6  # of the average of eq. 10, per sample; 0 keeps R as it is
FLOOR = 7  # least R over the level
LEVEL_DECAY = 8  # per sample
LEVEL = 9  # squared peak: of the voltages, of the currents
VARIANCE = 11  # R of the six channels, before the floor
AGE = 17  # samples since the last renewal
WORST = 18  # channel with the largest e^2 / S
WORST_RATIO = 19  # its e^2 / S
WORST_SQUARE = 20  # its e^2
WAVES = 21  # variance that a disturbance adds, over the level; decays
WAVES_AT_RENEWAL = 22
WAVES_DECAY = 23  # per sample
HEADER = 24

LARGEST = 1e100  # its square is still finite
SMALLEST = 1e-60  # a variance below any signal's: no 0 / 0 on dead channels

# e^2 / S of the worst channel, leaky over two samples; 60 is about seven standard deviations.
DETECTION_THRESHOLD = 60.0

# Least standard deviation of the noise over the peak.
NOISE_FLOOR = 0.005

# e^2 / S counts for at most this in the average: a disturbance that begins slowly must not raise R so fast
# that it is never detected.  It takes 0.5 % off the variance of Gaussian noise.
LARGEST_RATIO = 9.0

# Standard deviation, over the peak, of what travelling waves add to the voltages at a disturbance, and the
# time constant of its variance's decay [cycles].  It is the paper's own R(k) = R0 exp(-k dT / T).  Without it
# the unknowns are fitted to a few samples of a wave: a voltage of 129 kV was then estimated at 1.7 MV.
WAVE_NOISE = 0.2
WAVES_CYCLES = 0.2

# Soon after a renewal a large innovation may also mean that R is too small, or that the model does not fit
# (an offset of another time constant).  Then R of the channel is multiplied: where it is far too small
# every sample would renew P, and R cannot learn while P is wide.  An innovation of a small part of the peak
# is then no event at all.
YOUNG_CYCLES = 2.0
INFLATION = 4.0
SMALL_STEP = 0.2


def header(
    sampling_hz: int,
    frequency_hz: float,
    noise_floor: float,
    detection_threshold: float,
    wave_noise: float = 0.0,
) -> Array:
    """The header of a fresh state, (HEADER,); R is averaged over one cycle.

    The estimator leaves P at zero: the first sample that is not zero is then a disturbance, and renews it.

    Raises InputError for a floor that is not positive, a threshold below 10 (noise alone would pass it), or
    one that no first sample could pass (e^2 / S is then 1 / noise_floor^2).
    """
    floor = number("noise_floor", noise_floor, above=0.0, most=0.2) ** 2
    threshold = number("detection_threshold", detection_threshold, least=10.0, most=0.9 / floor)
    state = np.zeros(HEADER)
    state[SAMPLING_HZ] = sampling_hz
    state[FREQUENCY_HZ] = frequency_hz
    state[THRESHOLD] = threshold
    state[VARIANCE_GAIN] = frequency_hz / sampling_hz
    state[FLOOR] = floor
    state[LEVEL_DECAY] = 1.0 - frequency_hz / sampling_hz
    state[AGE] = 1e9
    state[WAVES_AT_RENEWAL] = number("wave_noise", wave_noise, least=0.0, most=1.0) ** 2
    state[WAVES_DECAY] = math.exp(-1.0 / (WAVES_CYCLES * sampling_hz / frequency_hz))
    return state


@njit(forceinline=True)
def is_sample(x: float) -> bool:
    return abs(x) < LARGEST  # false for NaN too


@njit
def follow_level(state: Array, x: Array) -> None:
    """Squared peak of the voltages and of the currents: up at once, down in about a cycle."""
    for group in range(2):
        level = state[LEVEL + group] * state[LEVEL_DECAY]
        for c in range(3 * group, 3 * group + 3):
            if is_sample(x[c]):
                level = max(level, x[c] * x[c])
        state[LEVEL + group] = level


@njit(forceinline=True)
def waves(state: Array, c: int) -> float:
    """What a disturbance adds to a voltage's variance for a while; currents carry little of it."""
    return state[WAVES] * state[LEVEL] if c < 3 else 0.0


@njit(forceinline=True)
def base_variance(state: Array, c: int) -> float:
    """R of channel c without waves: what was learned, not below the floor."""
    return max(state[VARIANCE + c], state[FLOOR] * state[LEVEL + c // 3] + SMALLEST)


@njit(forceinline=True)
def noise_variance(state: Array, c: int) -> float:
    """R of channel c, and what a disturbance adds for a while."""
    return base_variance(state, c) + waves(state, c)


@njit(forceinline=True)
def follow_variance(state: Array, c: int, innovation: float, predicted_variance: float) -> None:
    """Eq. 10, averaged.  ``predicted_variance`` is H P H'."""
    level = state[LEVEL + c // 3]
    variance = max(state[VARIANCE + c], state[FLOOR] * level + SMALLEST)
    total = predicted_variance + variance + waves(state, c)
    weight = state[VARIANCE_GAIN] * (variance / total) ** 2
    squared = min(innovation * innovation, LARGEST_RATIO * total)
    state[VARIANCE + c] = max(0.0, variance + weight * (squared - total))


@njit(forceinline=True)
def compare(state: Array, c: int, innovation: float, predicted_variance: float) -> None:
    """Note e^2 / S of a channel if it is this sample's largest so far."""
    square = innovation * innovation
    ratio = square / (predicted_variance + noise_variance(state, c))
    if ratio > state[WORST_RATIO]:
        state[WORST_RATIO] = ratio
        state[WORST_SQUARE] = square
        state[WORST] = c


@njit
def is_disturbed(state: Array) -> bool:
    """True at a disturbance, from this sample's largest e^2 / S."""
    state[AGE] += 1.0
    state[WAVES] *= state[WAVES_DECAY]
    state[SCORE] = 0.5 * state[SCORE] + state[WORST_RATIO]
    state[WORST_RATIO] = 0.0
    if state[SCORE] <= state[THRESHOLD]:
        return False
    state[SCORE] = 0.0
    if state[AGE] * state[FREQUENCY_HZ] < YOUNG_CYCLES * state[SAMPLING_HZ]:
        c = int(state[WORST])
        floor = state[FLOOR] * state[LEVEL + c // 3] + SMALLEST
        state[VARIANCE + c] = INFLATION * max(state[VARIANCE + c], floor)
        if state[WORST_SQUARE] < SMALL_STEP**2 * state[LEVEL + c // 3]:
            return False
    state[AGE] = 0.0
    state[WAVES] = state[WAVES_AT_RENEWAL]
    state[RENEWALS] += 1.0
    return True
