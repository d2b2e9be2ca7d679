"""Adaptive Kalman filter: the variance of the noise found on line, the decaying offset in the currents'
model.

Zhang Zhe, Chen Deshu, "Application of the adaptive Kalman filter in computer relaying" (Chinese; its text
names neither journal nor year), Huazhong University of Science and Technology: seed paper 000.

Voltages have two states, the phasor (eq. 1, 2); currents three, the phasor and the offset, in either of two
forms:

- ``decaying``: the state is the offset's present value and decays in the transition (eq. 3, 4);
- ``initial-value``: the state is the offset's value at the inception, and the measurement row decays (eq.
  11, 12).

The paper takes the second, so that a wrong time constant is an error of the measurement only, which the
variance of eq. 10 takes in as virtual noise.  The two are one filter in different coordinates, and so they
are here.

Departures, because the paper's filter begins at the inception and ends a cycle later, and a relay's runs
for ever:

- The phasors have a process noise in proportion to R, so that the steady filter follows a system that is
  off its nominal frequency; the memory that it has then is the parameter.
- The offset has a process noise in proportion to its own square, as if its rate of decay were known to
  ``decay_uncertainty`` of itself: an error of the rate changes the next offset by so much.  It vanishes
  with the offset, so that voltages and currents then follow alike (a constant one would turn the loop
  impedance by 6 degrees at 49 Hz).  With time constants of 10 to 200 ms for a filter set to 40 ms, 20
  samples per cycle and 1 % noise, the magnitude overshoots by at most 6 % after a cycle and stays within
  5 % after 38 ms at the worst inception; without this noise by 30 %, and not within 160 ms.
- The covariance is renewed at a detected disturbance; the variance is averaged and has a floor
  (disturbance.py).

``form = "as-written"`` is without all of them: R of a sample is eq. 10 of that sample alone, cut at zero,
P(0) is taken once, at the first sample that is not zero, and there is no process noise.  It then does not
arrive at a fault within any useful time: an inception makes R as large as the innovation (the study of the
paper shows it).
"""

from __future__ import annotations

import math

import numpy as np

from faultloop.jit import njit
from faultloop.relay.estimators.base import CHANNELS, FREQUENCY, ROCOF, Array, Estimator
from faultloop.relay.estimators.disturbance import (
    DETECTION_THRESHOLD,
    FLOOR,
    FREQUENCY_HZ,
    HEADER,
    LEVEL,
    NOISE_FLOOR,
    RENEWALS,
    SAMPLING_HZ,
    SMALLEST,
    VARIANCE,
    VARIANCE_GAIN,
    WAVE_NOISE,
    N,
    compare,
    follow_level,
    follow_variance,
    header,
    is_disturbed,
    is_sample,
    noise_variance,
)
from faultloop.relay.estimators.parameters import choice, number, samples_per_cycle
from faultloop.relay.estimators.reference import PEAK_TO_RMS, reference

LEAST = 1e-24  # of a variance as written, over the squared peak: no 0 / 0
VOLTAGE_SPREAD = 1.0  # of the renewed covariance, over the peak: a fault does not raise a voltage
PROCESS = HEADER  # process noise of the phasor per sample, over R
OFFSET_PROCESS = HEADER + 1  # process noise of the offset per sample, over its square
RENEWAL = HEADER + 2  # renewed covariance over the squared peak
TRANSITION = HEADER + 3  # of the offset's state, per sample
OFFSET_ROW = HEADER + 4  # the offset's entry of H
OFFSET_ROW_DECAY = HEADER + 5  # per sample
INNOVATION = HEADER + 6  # six: e
PREDICTED = HEADER + 12  # six: H P H'
VOLTAGE = HEADER + 18  # three of: x0 x1 p00 p01 p11
CURRENT = VOLTAGE + 15  # three of: x0 x1 x2 p00 p01 p02 p11 p12 p22
LENGTH = CURRENT + 27


@njit(inline="always")
def voltage_of(state: Array, c: int) -> Array:
    return state[VOLTAGE + 5 * c : VOLTAGE + 5 * c + 5]


@njit(inline="always")
def current_of(state: Array, c: int) -> Array:
    return state[CURRENT + 9 * c : CURRENT + 9 * c + 9]


@njit
def predict_voltages(state: Array, x: Array, cos: float, sin: float) -> None:
    for c in range(3):
        v = voltage_of(state, c)
        noise = state[PROCESS] * noise_variance(state, c)
        v[2] += noise
        v[4] += noise
        state[PREDICTED + c] = cos * cos * v[2] - 2.0 * cos * sin * v[3] + sin * sin * v[4]
        state[INNOVATION + c] = x[c] - (cos * v[0] - sin * v[1]) if is_sample(x[c]) else 0.0


@njit
def predict_currents(state: Array, x: Array, cos: float, sin: float) -> None:
    d = state[OFFSET_ROW]
    phi = state[TRANSITION]
    for c in range(3):
        i = current_of(state, c)
        noise = state[PROCESS] * noise_variance(state, 3 + c)
        i[2] *= phi
        i[5] *= phi
        i[7] *= phi
        i[3] += noise
        i[6] += noise
        # The last term keeps an offset that is long gone out of the denormal numbers, which are slow.
        i[8] = phi * phi * i[8] + state[OFFSET_PROCESS] * i[2] * i[2] + 1e-10 * (1.0 - phi) * noise
        phasor = cos * cos * i[3] - 2.0 * cos * sin * i[4] + sin * sin * i[6]
        state[PREDICTED + 3 + c] = phasor + d * (2.0 * (cos * i[5] - sin * i[7]) + d * i[8])
        e = x[3 + c] - (cos * i[0] - sin * i[1] + d * i[2])
        state[INNOVATION + 3 + c] = e if is_sample(x[3 + c]) else 0.0


@njit
def renew(state: Array) -> None:
    """Forget how sure the states were, and keep them as the prior mean."""
    for c in range(3):
        v = voltage_of(state, c)
        p = VOLTAGE_SPREAD**2 * state[LEVEL] + SMALLEST
        v[2], v[3], v[4] = p, 0.0, p
        state[PREDICTED + c] = p  # cos^2 + sin^2 = 1
        i = current_of(state, c)
        p = state[RENEWAL] * state[LEVEL + 1] + SMALLEST
        i[2] *= state[OFFSET_ROW]
        i[3:9] = 0.0
        i[3], i[6], i[8] = p, p, p
        state[PREDICTED + 3 + c] = 2.0 * p
    state[OFFSET_ROW] = 1.0


@njit
def correct_voltages(state: Array, x: Array, cos: float, sin: float) -> None:
    for c in range(3):
        if not is_sample(x[c]):
            continue
        v = voltage_of(state, c)
        e = state[INNOVATION + c]
        total = state[PREDICTED + c] + noise_variance(state, c)
        a = cos * v[2] - sin * v[3]
        b = cos * v[3] - sin * v[4]
        gain_a = a / total
        gain_b = b / total
        v[0] += gain_a * e
        v[1] += gain_b * e
        v[2] -= gain_a * a
        v[3] -= gain_a * b
        v[4] -= gain_b * b
        follow_variance(state, c, e, state[PREDICTED + c])


@njit
def correct_currents(state: Array, x: Array, cos: float, sin: float) -> None:
    d = state[OFFSET_ROW]
    for c in range(3):
        if not is_sample(x[3 + c]):
            continue
        i = current_of(state, c)
        e = state[INNOVATION + 3 + c]
        total = state[PREDICTED + 3 + c] + noise_variance(state, 3 + c)
        a = cos * i[3] - sin * i[4] + d * i[5]
        b = cos * i[4] - sin * i[6] + d * i[7]
        f = cos * i[5] - sin * i[7] + d * i[8]
        gain_a = a / total
        gain_b = b / total
        gain_f = f / total
        i[0] += gain_a * e
        i[1] += gain_b * e
        i[2] += gain_f * e
        i[3] -= gain_a * a
        i[4] -= gain_a * b
        i[5] -= gain_a * f
        i[6] -= gain_b * b
        i[7] -= gain_b * f
        i[8] -= gain_f * f
        follow_variance(state, 3 + c, e, state[PREDICTED + 3 + c])


@njit
def predict(state: Array, x: Array) -> tuple[float, float]:
    """Innovations of the six channels; cos and sin of the reference."""
    follow_level(state, x)
    cos, sin = reference(state[N], state[SAMPLING_HZ], state[FREQUENCY_HZ])
    d = state[OFFSET_ROW] * state[OFFSET_ROW_DECAY]
    state[OFFSET_ROW] = d if d > 1e-30 else 0.0  # no denormal numbers here either
    predict_voltages(state, x, cos, sin)
    predict_currents(state, x, cos, sin)
    return cos, sin


@njit
def correct_and_report(state: Array, x: Array, cos: float, sin: float, out: Array) -> None:
    correct_voltages(state, x, cos, sin)
    correct_currents(state, x, cos, sin)
    for c in range(3):
        v = voltage_of(state, c)
        i = current_of(state, c)
        out[2 * c] = PEAK_TO_RMS * v[0]
        out[2 * c + 1] = PEAK_TO_RMS * v[1]
        out[2 * c + 6] = PEAK_TO_RMS * i[0]
        out[2 * c + 7] = PEAK_TO_RMS * i[1]
    out[FREQUENCY] = math.nan
    out[ROCOF] = math.nan
    state[N] += 1.0


@njit
def adaptive_kalman_step(state: Array, x: Array, out: Array) -> None:
    cos, sin = predict(state, x)
    for c in range(CHANNELS):
        compare(state, c, state[INNOVATION + c], state[PREDICTED + c])
    if is_disturbed(state):
        renew(state)
    correct_and_report(state, x, cos, sin, out)


@njit
def as_written_step(state: Array, x: Array, out: Array) -> None:
    cos, sin = predict(state, x)
    if state[RENEWALS] == 0.0 and state[LEVEL] + state[LEVEL + 1] > 0.0:
        renew(state)
        state[RENEWALS] = 1.0
    for c in range(CHANNELS):
        e = state[INNOVATION + c]
        state[PREDICTED + c] = max(state[PREDICTED + c], 0.0)  # rounding, where R was zero
        state[VARIANCE + c] = max(0.0, e * e - state[PREDICTED + c])  # eq. 10
    correct_and_report(state, x, cos, sin, out)


STEPS = {"relay": adaptive_kalman_step, "as-written": as_written_step}


def make(
    sampling_hz: int,
    frequency_hz: float,
    *,
    offset: str = "decaying",
    time_constant_ms: float = 40.0,
    decay_uncertainty: float = 1.0,
    memory_cycles: float = 0.5,
    renewal_spread: float = 3.0,
    noise_floor: float = NOISE_FLOOR,
    detection_threshold: float = DETECTION_THRESHOLD,
    wave_noise: float = WAVE_NOISE,
    form: str = "relay",
) -> Estimator:
    """Adaptive Kalman filter.

    Parameters
    ----------
    offset : ``decaying`` (eq. 3, 4) or ``initial-value`` (eq. 11, 12).
    time_constant_ms : time constant of the offset [ms].
    decay_uncertainty : standard error of the offset's rate of decay, over the rate.
    memory_cycles : time constant of the steady filter [cycles of f0].
    renewal_spread : standard deviation of the currents' renewed states, over their peak; the voltages' is 1.
    noise_floor : least standard deviation of the noise, over the same peak.
    wave_noise : standard deviation that a disturbance adds, over the same peak; its variance decays within
        a fifth of a cycle.
    detection_threshold : squared normalised innovation that is a disturbance.
    form : ``relay``, or ``as-written``, in which of these parameters offset, time_constant_ms and
        renewal_spread (for P(0)) have a part.

    Raises InputError below 6 samples per cycle or for a parameter outside its limits.
    """
    per_cycle = samples_per_cycle(sampling_hz, frequency_hz, least=6, method="adaptive-kalman")
    tau = 1e-3 * number("time_constant_ms", time_constant_ms, least=1.0, most=1000.0)
    decay = math.exp(-1.0 / (tau * sampling_hz))
    memory = per_cycle * number("memory_cycles", memory_cycles, least=0.1, most=100.0)
    state = np.zeros(LENGTH)
    state[:HEADER] = header(sampling_hz, frequency_hz, noise_floor, detection_threshold, wave_noise)
    # A phasor of variance q R per sample that is seen through a unit sinusoid settles at the pole 1 -
    # sqrt(q / 2).
    state[PROCESS] = 2.0 / memory**2
    state[OFFSET_PROCESS] = (number("decay_uncertainty", decay_uncertainty, least=0.0) * (1.0 - decay)) ** 2
    state[RENEWAL] = number("renewal_spread", renewal_spread, above=0.0) ** 2
    if choice("offset", offset, ("decaying", "initial-value")) == "decaying":
        state[TRANSITION], state[OFFSET_ROW_DECAY] = decay, 1.0
    else:
        state[TRANSITION], state[OFFSET_ROW_DECAY] = 1.0, decay
    state[OFFSET_ROW] = 1.0
    if choice("form", form, tuple(STEPS)) == "as-written":
        state[PROCESS] = state[OFFSET_PROCESS] = state[VARIANCE_GAIN] = 0.0
        state[FLOOR] = LEAST
    return Estimator("adaptive-kalman", STEPS[form], state, math.ceil(per_cycle))
