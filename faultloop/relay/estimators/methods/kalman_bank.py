"""Bank of Kalman filters over decay constants, mixed by their likelihood: no time constant to set.

Voltages have two states, the phasor.  Each current has one filter of three states (phasor, and the offset's
value at the renewal: Zhang and Chen, seed paper 000, eq. 11, 12) for every decay constant of a grid; the
estimate is their mean, weighted by the likelihood of what each predicted (multiple-model adaptive
estimation: Magill 1965; the filters do not interact).  A large offset soon tells its decay constant; where
it is too small to tell, all filters agree.

- The frequency is that of the voltages, from their turn over a cycle once the last disturbance is two cycles
  past, and held through the next.  The model turns at it, so that off the nominal frequency there is no lag:
  a full-cycle window at 49 Hz is 6 % behind the true phasor, for ever.
- P is that of unit noise and does not depend on the samples, so one serves the three voltages, and one of
  each decay constant the three currents.  Each channel's own R (disturbance.py) serves the detection and the
  likelihood.
- The filters see the mean of the last twelfth of a cycle: travelling waves, of some 1 kHz and as large as the
  voltage itself behind a weak source, are no noise that a few samples could average.  While that window
  still holds samples from before a disturbance nothing is learned from it; then P is renewed.  The model is
  turned back by half the window, so the phasor is that of the newest sample.
- The voltages' noise is raised at a renewal and decays (the paper's own R0 exp(-k dT / T)): what waves
  are left is not taken for a voltage.
- At a disturbance P is renewed and the evidence begins anew; the present mean is the prior.  Otherwise the
  phasors have a process noise that makes the memory of the steady filter, and the evidence fades.
- The weights are each phase's own: with a fault to ground the phases' offsets need not decay alike.

With twelve decay constants between 5 and 500 ms no offset of 10 to 200 ms lies so far from all of them that
the error after a cycle is above 3 %; with eight it reaches 6 % (13 ms, between two of them).
"""

from __future__ import annotations

import math

import numpy as np

from faultloop.errors import InputError
from faultloop.jit import njit
from faultloop.relay.estimators.base import CHANNELS, FREQUENCY, ROCOF, Estimator
from faultloop.relay.estimators.disturbance import (
    AGE,
    DETECTION_THRESHOLD,
    FLOOR,
    FREQUENCY_HZ,
    HEADER,
    SAMPLING_HZ,
    WAVES,
    WAVES_AT_RENEWAL,
    N,
    base_variance,
    compare,
    follow_level,
    follow_variance,
    header,
    is_disturbed,
    is_sample,
    noise_variance,
)
from faultloop.relay.estimators.parameters import number, samples_per_cycle, whole
from faultloop.relay.estimators.reference import PEAK_TO_RMS, reference

PROCESS = HEADER  # process noise of the phasors per sample, over R
ALPHA = HEADER + 1  # renewed covariance, over R
SHIFT = HEADER + 2  # angle by which the model is ahead of the reference [rad]
TURN = HEADER + 3  # its growth per sample
CYCLE = HEADER + 4  # samples
FADE = HEADER + 5  # of the evidence, per sample
MARK = HEADER + 6  # three of re, im: the voltages a cycle ago
INNOVATION = HEADER + 12  # six
PREDICTED = HEADER + 18  # six: H P H' over R
MEAN = HEADER + 24  # three of re, im, present offset: the mixed currents
VOLTAGE_P = HEADER + 33  # p00 p01 p11
VOLTAGE = HEADER + 36  # three of re, im
MODELS = HEADER + 42
TAPS = HEADER + 43  # samples in the mean
SCALE = HEADER + 44  # of their sum, so that f0 keeps its size
SMOOTH = HEADER + 45  # six: the mean
LISTS = HEADER + 51  # each list has a place for every model; after them the last samples, six each

# The lists; the innermost loops run over the models, so that they vectorise.
DECAY = 0  # of the offset, per sample
ROW = 1  # the offset's entry of H
P00, P01, P02, P11, P12, P22 = range(2, 8)
TOTAL = 8  # S = H P H' + 1
GAIN = 9  # three: P H', not yet divided by S
HALF_LOG = 12  # of S
STATE = 13  # three of re, im, offset
EVIDENCE = 22  # three: log likelihood, the best is 0
WEIGHT = 25  # three
LIST_COUNT = 28

# Four times the other recursive methods' floor: the renewal then waits until a travelling wave, or the
# low-pass in front, has done its worst, instead of fitting it.  On a 300 km line at 24 samples per cycle the
# three-phase fault's phasors stay within 5 % after 11 and 12 ms (median: voltages, currents), not 19 and 21.
BANK_NOISE_FLOOR = 0.02

# Standard deviation, over the peak, of what waves are left in the voltages at a renewal.  Of 2304 faults
# beyond zone 1 (docs/relay.md) the largest voltage estimate was then 1.1 of what was there, with 0.2 2.1;
# without the mean over a twelfth of a cycle 4.4, and a mho operated for 72 of them.
BANK_WAVE_NOISE = 0.5

LEAST_EVIDENCE = -60.0  # so that a model that was wrong can come back; and exp gives no denormal numbers
COHERENCE = 0.95  # of the voltages with those a cycle ago, squared: below it the turn is no frequency
LEAST_SIGNAL = (
    4.0  # squared peaks over the noise's variance: a dead line's noise has no frequency (it has 0.06)
)
FREQUENCY_GAIN = 0.5  # per cycle
FREQUENCY_RANGE = 0.1  # of the nominal


@njit(inline="always")
def listed(state, k):
    m = int(state[MODELS])
    return state[LISTS + k * m : LISTS + (k + 1) * m]


@njit
def smooth(state, x):
    """The mean of the last samples; not a number while one of them is missing."""
    taps = int(state[TAPS])
    mean, ring = state[SMOOTH : SMOOTH + CHANNELS], state[LISTS + LIST_COUNT * int(state[MODELS]) :]
    newest = CHANNELS * (int(state[N]) % taps)
    for c in range(CHANNELS):
        ring[newest + c] = x[c]
        mean[c] = 0.0
    for k in range(taps):  # summed anew: a running sum would keep its rounding, and a NaN, for ever
        for c in range(CHANNELS):
            mean[c] += ring[CHANNELS * k + c]
    for c in range(CHANNELS):
        mean[c] *= state[SCALE]
    return mean


@njit
def predict_voltages(state, x, cos, sin):
    p = state[VOLTAGE_P : VOLTAGE_P + 3]
    p[0] += state[PROCESS]
    p[2] += state[PROCESS]
    projected = cos * cos * p[0] - 2.0 * cos * sin * p[1] + sin * sin * p[2]
    for c in range(3):
        state[PREDICTED + c] = projected
        e = x[c] - (cos * state[VOLTAGE + 2 * c] - sin * state[VOLTAGE + 2 * c + 1])
        state[INNOVATION + c] = e if is_sample(x[c]) else 0.0


@njit
def predict_models(state, cos, sin):
    """P of every model, its P H' and its S."""
    decay, row, total = listed(state, DECAY), listed(state, ROW), listed(state, TOTAL)
    p00, p01, p02 = listed(state, P00), listed(state, P01), listed(state, P02)
    p11, p12, p22 = listed(state, P11), listed(state, P12), listed(state, P22)
    a, b, f = listed(state, GAIN), listed(state, GAIN + 1), listed(state, GAIN + 2)
    noise = state[PROCESS]
    for m in range(len(row)):
        d = row[m] * decay[m]
        d = d if d > 1e-30 else 0.0  # no denormal numbers: they are slow
        row[m] = d
        p00[m] += noise
        p11[m] += noise
        a[m] = cos * p00[m] - sin * p01[m] + d * p02[m]
        b[m] = cos * p01[m] - sin * p11[m] + d * p12[m]
        f[m] = cos * p02[m] - sin * p12[m] + d * p22[m]
        total[m] = 1.0 + cos * a[m] - sin * b[m] + d * f[m]


@njit
def predict_current(state, c, x, cos, sin):
    """Innovation of the mixture and its variance: of the models' mean, and between the models."""
    row, total = listed(state, ROW), listed(state, TOTAL)
    re, im = listed(state, STATE + 3 * c), listed(state, STATE + 3 * c + 1)
    offset, weight = listed(state, STATE + 3 * c + 2), listed(state, WEIGHT + c)
    mean = square = within = 0.0
    for m in range(len(row)):
        e = x - (cos * re[m] - sin * im[m] + row[m] * offset[m]) if is_sample(x) else 0.0
        mean += weight[m] * e
        square += weight[m] * e * e
        within += weight[m] * (total[m] - 1.0)
    between = max(0.0, square - mean * mean)
    state[INNOVATION + 3 + c] = mean
    state[PREDICTED + 3 + c] = within + between / noise_variance(state, 3 + c)


@njit
def renew(state, cos, sin):
    """Forget how sure the states were and which model was right; keep the mean as every model's prior."""
    alpha = state[ALPHA]
    p = state[VOLTAGE_P : VOLTAGE_P + 3]
    p[0], p[1], p[2] = alpha, 0.0, alpha
    for k in (P01, P02, P12):
        listed(state, k)[:] = 0.0
    for k in (P00, P11, P22):
        listed(state, k)[:] = alpha
    listed(state, ROW)[:] = 1.0
    listed(state, TOTAL)[:] = 1.0 + 2.0 * alpha
    listed(state, GAIN)[:] = cos * alpha
    listed(state, GAIN + 1)[:] = -sin * alpha
    listed(state, GAIN + 2)[:] = alpha
    for k in range(9):
        listed(state, STATE + k)[:] = state[MEAN + k]
    for c in range(3):
        listed(state, EVIDENCE + c)[:] = 0.0
        listed(state, WEIGHT + c)[:] = 1.0 / state[MODELS]
        state[PREDICTED + c] = alpha  # cos^2 + sin^2 = 1
        state[PREDICTED + 3 + c] = 2.0 * alpha


@njit
def correct_voltages(state, x, cos, sin):
    p = state[VOLTAGE_P : VOLTAGE_P + 3]
    a = cos * p[0] - sin * p[1]
    b = cos * p[1] - sin * p[2]
    predicted = cos * a - sin * b
    total = predicted + 1.0 + state[WAVES] / state[FLOOR]
    for c in range(3):
        if is_sample(x[c]):
            e = state[INNOVATION + c]
            state[VOLTAGE + 2 * c] += a / total * e
            state[VOLTAGE + 2 * c + 1] += b / total * e
            follow_variance(state, c, e, predicted * base_variance(state, c))
    p[0] -= a * a / total
    p[1] -= a * b / total
    p[2] -= b * b / total


@njit
def correct_current(state, c, x, cos, sin):
    """Every model's state and evidence."""
    row, total, half_log = listed(state, ROW), listed(state, TOTAL), listed(state, HALF_LOG)
    a, b, f = listed(state, GAIN), listed(state, GAIN + 1), listed(state, GAIN + 2)
    re, im = listed(state, STATE + 3 * c), listed(state, STATE + 3 * c + 1)
    offset, evidence = listed(state, STATE + 3 * c + 2), listed(state, EVIDENCE + c)
    half_precision = 0.5 / noise_variance(state, 3 + c)
    fade = state[FADE]
    for m in range(len(row)):
        e = x - (cos * re[m] - sin * im[m] + row[m] * offset[m])
        ratio = e / total[m]
        re[m] += a[m] * ratio
        im[m] += b[m] * ratio
        offset[m] += f[m] * ratio
        evidence[m] = fade * evidence[m] - half_precision * e * ratio - half_log[m]


@njit(inline="always")
def likelihood(evidence):
    """e^x for -60 <= x <= 0: the 1024th power of its series at x / 1024; to 1e-12 above -8, 1e-7 at -60.

    The compiler vectorises this and not `math.exp`: 20 ns for twelve, not 114.
    """
    z = evidence * (1.0 / 1024.0)
    p = 1.0 + z * (1.0 + z * (1.0 / 2.0 + z * (1.0 / 6.0 + z * (1.0 / 24.0 + z * (1.0 / 120.0)))))
    p *= p
    p *= p
    p *= p
    p *= p
    p *= p
    p *= p
    p *= p
    p *= p
    p *= p
    return p * p


@njit
def mix(state, c):
    """Weights from the evidence, and the mean of the models."""
    row, weight, evidence = listed(state, ROW), listed(state, WEIGHT + c), listed(state, EVIDENCE + c)
    best = evidence[0]
    for m in range(len(row)):  # 2 ns for twelve; evidence.max() takes 17
        best = max(best, evidence[m])
    for m in range(len(row)):
        evidence[m] = max(evidence[m] - best, LEAST_EVIDENCE)
        weight[m] = likelihood(evidence[m])
    whole = 0.0
    for m in range(len(row)):
        whole += weight[m]
    re, im = listed(state, STATE + 3 * c), listed(state, STATE + 3 * c + 1)
    offset = listed(state, STATE + 3 * c + 2)
    mean = state[MEAN + 3 * c : MEAN + 3 * c + 3]
    mean[:] = 0.0
    for m in range(len(row)):
        weight[m] /= whole
        mean[0] += weight[m] * re[m]
        mean[1] += weight[m] * im[m]
        mean[2] += weight[m] * offset[m] * row[m]


@njit
def correct_currents(state, x, cos, sin):
    total, half_log = listed(state, TOTAL), listed(state, HALF_LOG)
    for m in range(len(total)):
        half_log[m] = 0.5 * math.log(total[m])  # once for three phases: 0.82 us per sample became 0.71
    for c in range(3):
        if is_sample(x[3 + c]):
            variance = noise_variance(state, 3 + c)
            correct_current(state, c, x[3 + c], cos, sin)
            follow_variance(state, 3 + c, state[INNOVATION + 3 + c], state[PREDICTED + 3 + c] * variance)
            mix(state, c)
    p00, p01, p02 = listed(state, P00), listed(state, P01), listed(state, P02)
    p11, p12, p22 = listed(state, P11), listed(state, P12), listed(state, P22)
    a, b, f = listed(state, GAIN), listed(state, GAIN + 1), listed(state, GAIN + 2)
    for m in range(len(total)):
        s = 1.0 / total[m]
        p00[m] -= s * a[m] * a[m]
        p01[m] -= s * a[m] * b[m]
        p02[m] -= s * a[m] * f[m]
        p11[m] -= s * b[m] * b[m]
        p12[m] -= s * b[m] * f[m]
        p22[m] -= s * f[m] * f[m]


@njit
def follow_frequency(state):
    """Once a cycle after the last disturbance: the voltages' turn against the model."""
    cycle = state[CYCLE]
    if state[AGE] < cycle or state[AGE] % cycle != 0.0:
        return
    re = im = now = then = noise = 0.0
    for c in range(3):
        noise += noise_variance(state, c)
        a, b = state[VOLTAGE + 2 * c], state[VOLTAGE + 2 * c + 1]
        p, q = state[MARK + 2 * c], state[MARK + 2 * c + 1]
        state[MARK + 2 * c], state[MARK + 2 * c + 1] = a, b
        re += a * p + b * q
        im += b * p - a * q
        now += a * a + b * b
        then += p * p + q * q
    if state[AGE] < 2.0 * cycle or re <= 0.0 or now < LEAST_SIGNAL * noise:
        return
    # Divided, not multiplied out: the fourth power of a large sample is infinite.
    if (re / now) * (re / then) + (im / now) * (im / then) < COHERENCE:
        return
    limit = 2.0 * math.pi * FREQUENCY_RANGE * state[FREQUENCY_HZ] / state[SAMPLING_HZ]
    turn = state[TURN] + FREQUENCY_GAIN * math.atan2(im, re) / cycle
    state[TURN] = min(limit, max(-limit, turn))


@njit
def write(state, out, cos, sin):
    """The phasors, turned from the model's frequency to the reference."""
    for c in range(3):
        a, b = PEAK_TO_RMS * state[VOLTAGE + 2 * c], PEAK_TO_RMS * state[VOLTAGE + 2 * c + 1]
        out[2 * c] = a * cos - b * sin
        out[2 * c + 1] = b * cos + a * sin
        a, b = PEAK_TO_RMS * state[MEAN + 3 * c], PEAK_TO_RMS * state[MEAN + 3 * c + 1]
        out[2 * c + 6] = a * cos - b * sin
        out[2 * c + 7] = b * cos + a * sin
    out[FREQUENCY] = math.nan
    out[ROCOF] = math.nan


@njit
def learn(state, y, cos, sin):
    """Compare the mean of the window with the prediction, and correct what may be corrected."""
    if state[AGE] < state[TAPS] - 1.0:  # the window holds samples from before the disturbance
        state[AGE] += 1.0
        if state[AGE] < state[TAPS] - 1.0:
            return
        state[WAVES] = state[WAVES_AT_RENEWAL]
        renew(state, cos, sin)
    else:
        for c in range(CHANNELS):
            compare(state, c, state[INNOVATION + c], state[PREDICTED + c] * base_variance(state, c))
        if is_disturbed(state):
            if state[TAPS] > 1.0:
                return
            renew(state, cos, sin)
    correct_voltages(state, y, cos, sin)
    correct_currents(state, y, cos, sin)
    follow_frequency(state)


@njit
def kalman_bank_step(state, x, out):
    y = smooth(state, x)
    follow_level(state, y)
    ahead = state[SHIFT] + state[TURN]
    ahead -= 2.0 * math.pi * math.floor(ahead / (2.0 * math.pi) + 0.5)
    state[SHIFT] = ahead
    # The mean is that of half a window ago.
    omega = 2.0 * math.pi * state[FREQUENCY_HZ] / state[SAMPLING_HZ]
    turned = ahead - 0.5 * (state[TAPS] - 1.0) * (omega + state[TURN])
    turned_cos, turned_sin = math.cos(turned), math.sin(turned)
    nominal_cos, nominal_sin = reference(state[N], state[SAMPLING_HZ], state[FREQUENCY_HZ])
    cos = nominal_cos * turned_cos - nominal_sin * turned_sin
    sin = nominal_sin * turned_cos + nominal_cos * turned_sin
    predict_voltages(state, y, cos, sin)
    predict_models(state, cos, sin)
    for c in range(3):
        predict_current(state, c, y[3 + c], cos, sin)
    learn(state, y, cos, sin)
    write(state, out, math.cos(ahead), math.sin(ahead))
    state[N] += 1.0


def make(
    sampling_hz: int,
    frequency_hz: float,
    *,
    models: int = 12,
    shortest_ms: float = 5.0,
    longest_ms: float = 500.0,
    memory_cycles: float = 1.0,
    evidence_cycles: float = 1.0,
    renewal_spread: float = 2.0,
    window_cycles: float = 1 / 12,
    noise_floor: float = BANK_NOISE_FLOOR,
    detection_threshold: float = DETECTION_THRESHOLD,
    wave_noise: float = BANK_WAVE_NOISE,
) -> Estimator:
    """Bank of Kalman filters.

    Parameters
    ----------
    models : decay constants, in a geometric row from ``shortest_ms`` to ``longest_ms``.
    shortest_ms, longest_ms : the first and the last decay constant [ms].
    memory_cycles : time constant of the steady filter [cycles of f0].
    evidence_cycles : time constant with which the models' evidence fades [cycles of f0].
    renewal_spread : standard deviation of the renewed states, over the peak of the voltages or currents.
    window_cycles : length of the mean that the filters see [cycles of f0]; below two samples it is none.
    noise_floor : least standard deviation of the noise, over the peak of the voltages or currents.
    detection_threshold : squared normalised innovation that is a disturbance.
    wave_noise : standard deviation that a disturbance adds to the voltages, over their peak; its variance
        decays within a fifth of a cycle.

    Raises InputError below 6 samples per cycle or for a parameter outside its limits.
    """
    per_cycle = samples_per_cycle(sampling_hz, frequency_hz, least=6, method="kalman-bank")
    count = whole("models", models, least=1, most=64)
    shortest = number("shortest_ms", shortest_ms, least=1.0, most=1000.0)
    longest = number("longest_ms", longest_ms, least=1.0, most=10_000.0)
    if longest < shortest:
        raise InputError(f"{longest:g} should be at least shortest_ms, {shortest:g}", key="longest_ms")
    memory = per_cycle * number("memory_cycles", memory_cycles, least=0.1, most=100.0)
    evidence = per_cycle * number("evidence_cycles", evidence_cycles, least=0.1, most=100.0)
    taps = max(1, math.floor(per_cycle * number("window_cycles", window_cycles, least=0.0, most=0.25) + 1e-9))
    state = np.zeros(LISTS + LIST_COUNT * count + CHANNELS * taps)
    state[:HEADER] = header(sampling_hz, frequency_hz, noise_floor, detection_threshold, wave_noise)
    # A phasor of variance q R per sample that is seen through a unit sinusoid settles at the pole 1 -
    # sqrt(q / 2).
    state[PROCESS] = 2.0 / memory**2
    state[ALPHA] = number("renewal_spread", renewal_spread, above=0.0, most=1e3) ** 2 / state[FLOOR]
    half = math.pi * frequency_hz / sampling_hz
    state[TAPS], state[SCALE] = taps, math.sin(half) / math.sin(taps * half)
    state[CYCLE] = round(per_cycle)
    state[FADE] = math.exp(-1.0 / evidence)
    state[MODELS] = count
    constants_s = 1e-3 * np.geomspace(shortest, longest, count)
    state[LISTS + DECAY * count : LISTS + (DECAY + 1) * count] = np.exp(-1.0 / (constants_s * sampling_hz))
    state[LISTS + WEIGHT * count : LISTS + (WEIGHT + 3) * count] = 1.0 / count
    return Estimator("kalman-bank", kalman_bank_step, state, math.ceil(per_cycle) + taps)
