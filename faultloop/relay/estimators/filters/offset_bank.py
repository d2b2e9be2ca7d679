"""The kernels of `kalman-bank`: a filter for each decay constant of the currents' offset, and their mixture.

``models`` is a tuple whose length is the number of decay constants. A length belongs to the type, so to the
compiler it is a constant: every list then has a constant place in the state, no two of them overlap, and the
innermost loops vectorise. The three phases go side by side, as triples, so that their sums do not wait for
one another. Together the two made the step 1.6 times as fast (bench/estimators.py), with the same bits.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache

from faultloop.jit import njit
from faultloop.relay.estimators.base import CHANNELS, FREQUENCY, ROCOF, Array
from faultloop.relay.estimators.disturbance import (
    AGE,
    FLOOR,
    FREQUENCY_HZ,
    HEADER,
    RENEWALS,
    SAMPLING_HZ,
    WAVES,
    WAVES_AT_RENEWAL,
    N,
    base_variance,
    compare,
    follow_level,
    follow_variance,
    is_disturbed,
    is_sample,
    noise_variance,
)
from faultloop.relay.estimators.filters.logarithm import logarithm
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
TAPS = HEADER + 42  # samples in the mean
SCALE = HEADER + 43  # of their sum, so that f0 keeps its size
SMOOTH = HEADER + 44  # six: the mean
LISTS = HEADER + 50  # each list has a place for every model; after them the last samples, six each

DECAY = 0  # of the offset, per sample
ROW = 1  # the offset's entry of H
P00, P01, P02, P11, P12, P22 = range(2, 8)
TOTAL = 8  # S = H P H' + 1
GAIN = 9  # three: P H', not yet divided by S
PRECISION = 12  # 1 / S
HALF_LOG = 13  # of S
STATE = 14  # three of re, im, offset
EVIDENCE = 23  # three: log likelihood, the best is 0
WEIGHT = 26  # three
RESIDUAL = 29  # three: what the model did not foresee of the currents
LIST_COUNT = 32

LEAST_EVIDENCE = -60.0  # so that a model that was wrong can come back; and exp gives no denormal numbers
COHERENCE = 0.95  # of the voltages with those a cycle ago, squared: below it the turn is no frequency
# Squared peaks over the noise's variance: a dead line's noise has no frequency (it has 0.06).
LEAST_SIGNAL = 4.0
FREQUENCY_GAIN = 0.5  # per cycle
# The first turn is that of the second cycle after the start, and of the third after a disturbance: a voltage
# that falls to a few percent of what it was still has a quarter of its own in error after one cycle, whose
# turn was taken for 0.4 Hz, and turned the phasors by 2.5 degrees.
FIRST_LEARNED, LEARNED = 2.0, 3.0
FREQUENCY_RANGE = 0.1  # of the nominal


Models = tuple[float, ...]
"""As many as there are decay constants: the length alone counts."""
Triple = tuple[float, float, float]
"""Of the three phases."""
Flags = tuple[bool, bool, bool]


def state_size(models: int, taps: int) -> int:
    """Numbers in the state of a bank of so many models that see the mean of so many samples."""
    return LISTS + LIST_COUNT * models + CHANNELS * taps


def model_covariances(state: Array, models: int) -> Array:
    """P of every model over R, (models, 3, 3): of re, im and the offset."""
    lists = state[LISTS : LISTS + LIST_COUNT * models].reshape(LIST_COUNT, models)
    return lists[[[P00, P01, P02], [P01, P11, P12], [P02, P12, P22]]].transpose(2, 0, 1)


@njit(forceinline=True)
def place(models: Models, which: int) -> int:
    """Where list ``which`` begins in the state."""
    return LISTS + which * len(models)


@njit(forceinline=True)
def lane(state: Array, models: Models, which: int, m: int) -> Triple:
    """Entry ``m`` of three lists that follow each other, one a phase."""
    at = LISTS + which * len(models) + m
    return state[at], state[at + len(models)], state[at + 2 * len(models)]


@njit(forceinline=True)
def put_lane(state: Array, models: Models, which: int, m: int, values: Triple) -> None:
    at = LISTS + which * len(models) + m
    state[at], state[at + len(models)], state[at + 2 * len(models)] = values


@njit(forceinline=True)
def current(state: Array, models: Models, part: int, m: int) -> Triple:
    """Of model ``m`` the three currents' re (part 0), im (1) or offset (2)."""
    at = LISTS + (STATE + part) * len(models) + m
    return state[at], state[at + 3 * len(models)], state[at + 6 * len(models)]


@njit(forceinline=True)
def put_current(state: Array, models: Models, part: int, m: int, values: Triple) -> None:
    at = LISTS + (STATE + part) * len(models) + m
    state[at], state[at + 3 * len(models)], state[at + 6 * len(models)] = values


@njit(forceinline=True)
def plus(a: Triple, b: Triple) -> Triple:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@njit(forceinline=True)
def times(a: Triple, b: Triple) -> Triple:
    return a[0] * b[0], a[1] * b[1], a[2] * b[2]


@njit(forceinline=True)
def scaled(a: Triple, k: float) -> Triple:
    return a[0] * k, a[1] * k, a[2] * k


@njit(forceinline=True)
def chosen(which: Flags, a: Triple, b: Triple) -> Triple:
    return a[0] if which[0] else b[0], a[1] if which[1] else b[1], a[2] if which[2] else b[2]


@njit
def smooth(state: Array, models: Models, x: Array) -> None:
    """The mean of the last samples, to SMOOTH; not a number while one of them is missing."""
    taps, ring = int(state[TAPS]), place(models, LIST_COUNT)
    newest = ring + CHANNELS * (int(state[N]) % taps)
    for c in range(CHANNELS):
        state[newest + c] = x[c]
    # Summed anew: a running sum would keep its rounding, and a NaN, for ever.
    v = i = (0.0, 0.0, 0.0)
    for at in range(ring, ring + CHANNELS * taps, CHANNELS):
        v = plus(v, (state[at], state[at + 1], state[at + 2]))
        i = plus(i, (state[at + 3], state[at + 4], state[at + 5]))
    for c in range(3):
        state[SMOOTH + c] = v[c] * state[SCALE]
        state[SMOOTH + 3 + c] = i[c] * state[SCALE]


@njit
def predict_voltages(state: Array, x: Array, cos: float, sin: float) -> None:
    p = state[VOLTAGE_P : VOLTAGE_P + 3]
    p[0] += state[PROCESS]
    p[2] += state[PROCESS]
    projected = cos * cos * p[0] - 2.0 * cos * sin * p[1] + sin * sin * p[2]
    for c in range(3):
        state[PREDICTED + c] = projected
        e = x[c] - (cos * state[VOLTAGE + 2 * c] - sin * state[VOLTAGE + 2 * c + 1])
        state[INNOVATION + c] = e if is_sample(x[c]) else 0.0


@njit
def predict_models(state: Array, models: Models, cos: float, sin: float) -> None:
    """P of every model, its P H' and its S."""
    row, decay, total = place(models, ROW), place(models, DECAY), place(models, TOTAL)
    at00, at01, at02 = place(models, P00), place(models, P01), place(models, P02)
    at11, at12, at22 = place(models, P11), place(models, P12), place(models, P22)
    noise = state[PROCESS]
    for m in range(len(models)):
        d = state[row + m] * state[decay + m]
        d = d if d > 1e-30 else 0.0  # no denormal numbers: they are slow
        state[row + m] = d
        state[at00 + m] += noise
        state[at11 + m] += noise
        p00, p01, p02 = state[at00 + m], state[at01 + m], state[at02 + m]
        p11, p12, p22 = state[at11 + m], state[at12 + m], state[at22 + m]
        a = cos * p00 - sin * p01 + d * p02
        b = cos * p01 - sin * p11 + d * p12
        f = cos * p02 - sin * p12 + d * p22
        put_lane(state, models, GAIN, m, (a, b, f))
        state[total + m] = 1.0 + cos * a - sin * b + d * f


@njit
def compare_models(state: Array, models: Models, x: Array, sampled: Flags, cos: float, sin: float) -> None:
    """What every model did not foresee of the three currents; 0 of one that is missing."""
    for m in range(len(models)):
        row = state[place(models, ROW) + m]
        re, im = current(state, models, 0, m), current(state, models, 1, m)
        offset = current(state, models, 2, m)
        foreseen = plus(plus(scaled(re, cos), scaled(im, -sin)), scaled(offset, row))
        residual = chosen(sampled, plus(x, scaled(foreseen, -1.0)), (0.0, 0.0, 0.0))
        put_lane(state, models, RESIDUAL, m, residual)


@njit
def predict_currents(state: Array, models: Models) -> None:
    """Innovation of the mixture and its variance: of the models' mean, and between the models."""
    total = place(models, TOTAL)
    mean = square = within = (0.0, 0.0, 0.0)
    for m in range(len(models)):
        e = lane(state, models, RESIDUAL, m)
        weight = lane(state, models, WEIGHT, m)
        mean = plus(mean, times(weight, e))
        square = plus(square, times(times(weight, e), e))
        within = plus(within, scaled(weight, state[total + m] - 1.0))
    for c in range(3):
        between = max(0.0, square[c] - mean[c] * mean[c])
        state[INNOVATION + 3 + c] = mean[c]
        state[PREDICTED + 3 + c] = within[c] + between / noise_variance(state, 3 + c)


@njit
def renew(state: Array, models: Models, cos: float, sin: float) -> None:
    """Forget how sure the states were and which model was right; keep the mean as every model's prior."""
    alpha = state[ALPHA]
    p = state[VOLTAGE_P : VOLTAGE_P + 3]
    p[0], p[1], p[2] = alpha, 0.0, alpha
    for m in range(len(models)):
        for k in (P01, P02, P12):
            state[place(models, k) + m] = 0.0
        for k in (P00, P11, P22):
            state[place(models, k) + m] = alpha
        state[place(models, ROW) + m] = 1.0
        state[place(models, TOTAL) + m] = 1.0 + 2.0 * alpha
        put_lane(state, models, GAIN, m, (cos * alpha, -sin * alpha, alpha))
        for part in range(3):
            mean = (state[MEAN + part], state[MEAN + 3 + part], state[MEAN + 6 + part])
            put_current(state, models, part, m, mean)
        put_lane(state, models, EVIDENCE, m, (0.0, 0.0, 0.0))
        even = 1.0 / len(models)
        put_lane(state, models, WEIGHT, m, (even, even, even))
    for c in range(3):
        state[PREDICTED + c] = alpha  # cos^2 + sin^2 = 1
        state[PREDICTED + 3 + c] = 2.0 * alpha


@njit
def correct_voltages(state: Array, x: Array, cos: float, sin: float) -> None:
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
def correct_models(state: Array, models: Models, sampled: Flags) -> None:
    """Every model's three states and evidence."""
    precision, half_log = place(models, PRECISION), place(models, HALF_LOG)
    fade = state[FADE]
    half_precision = (
        0.5 / noise_variance(state, 3),
        0.5 / noise_variance(state, 4),
        0.5 / noise_variance(state, 5),
    )
    for m in range(len(models)):
        e = lane(state, models, RESIDUAL, m)
        ratio = scaled(e, state[precision + m])
        gain = lane(state, models, GAIN, m)
        for part in range(3):
            moved = plus(current(state, models, part, m), scaled(ratio, gain[part]))
            put_current(state, models, part, m, moved)
        before = lane(state, models, EVIDENCE, m)
        unlikely = times(times(half_precision, e), ratio)
        log = state[half_log + m]
        evidence = plus(plus(scaled(before, fade), scaled(unlikely, -1.0)), (-log, -log, -log))
        put_lane(state, models, EVIDENCE, m, chosen(sampled, evidence, before))


@njit(forceinline=True)
def likelihood(evidence: float) -> float:
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
def weigh(state: Array, models: Models) -> None:
    """Weights from the evidence."""
    best = lane(state, models, EVIDENCE, 0)
    for m in range(len(models)):
        e = lane(state, models, EVIDENCE, m)
        best = (max(best[0], e[0]), max(best[1], e[1]), max(best[2], e[2]))
    for m in range(len(models)):
        e = plus(lane(state, models, EVIDENCE, m), scaled(best, -1.0))
        least = LEAST_EVIDENCE
        put_lane(state, models, EVIDENCE, m, (max(e[0], least), max(e[1], least), max(e[2], least)))
    evidence, weight = place(models, EVIDENCE), place(models, WEIGHT)
    for m in range(3 * len(models)):
        state[weight + m] = likelihood(state[evidence + m])
    whole = (0.0, 0.0, 0.0)
    for m in range(len(models)):
        whole = plus(whole, lane(state, models, WEIGHT, m))
    part = (1.0 / whole[0], 1.0 / whole[1], 1.0 / whole[2])
    for m in range(len(models)):
        put_lane(state, models, WEIGHT, m, times(lane(state, models, WEIGHT, m), part))


@njit
def mix(state: Array, models: Models, sampled: Flags) -> None:
    """The mean of the models, of each current that has a sample."""
    row = place(models, ROW)
    re = im = offset = (0.0, 0.0, 0.0)
    for m in range(len(models)):
        weight = lane(state, models, WEIGHT, m)
        re = plus(re, times(weight, current(state, models, 0, m)))
        im = plus(im, times(weight, current(state, models, 1, m)))
        offset = plus(offset, scaled(times(weight, current(state, models, 2, m)), state[row + m]))
    for c in range(3):
        if sampled[c]:
            state[MEAN + 3 * c], state[MEAN + 3 * c + 1], state[MEAN + 3 * c + 2] = re[c], im[c], offset[c]


@njit
def correct_currents(state: Array, models: Models, sampled: Flags) -> None:
    total, precision, half_log = place(models, TOTAL), place(models, PRECISION), place(models, HALF_LOG)
    for m in range(len(models)):
        state[precision + m] = 1.0 / state[total + m]
        state[half_log + m] = 0.5 * logarithm(state[total + m])
    correct_models(state, models, sampled)
    for c in range(3):
        if sampled[c]:
            predicted = state[PREDICTED + 3 + c] * noise_variance(state, 3 + c)
            follow_variance(state, 3 + c, state[INNOVATION + 3 + c], predicted)
    weigh(state, models)
    mix(state, models, sampled)
    at00, at01, at02 = place(models, P00), place(models, P01), place(models, P02)
    at11, at12, at22 = place(models, P11), place(models, P12), place(models, P22)
    for m in range(len(models)):
        s = state[precision + m]
        a, b, f = lane(state, models, GAIN, m)
        state[at00 + m] -= s * a * a
        state[at01 + m] -= s * a * b
        state[at02 + m] -= s * a * f
        state[at11 + m] -= s * b * b
        state[at12 + m] -= s * b * f
        state[at22 + m] -= s * f * f


@njit
def follow_frequency(state: Array) -> None:
    """Once a cycle after the last disturbance: the voltages' turn against the model."""
    cycle = state[CYCLE]
    cycles = state[AGE] / cycle
    if cycles < 1.0 or cycles != math.floor(cycles):  # both are whole: exact, and % takes 15 ns
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
    least = LEARNED if state[RENEWALS] > 1.0 else FIRST_LEARNED
    if cycles < least or re <= 0.0 or now < LEAST_SIGNAL * noise:
        return
    # Divided, not multiplied out: the fourth power of a large sample is infinite.
    if (re / now) * (re / then) + (im / now) * (im / then) < COHERENCE:
        return
    limit = 2.0 * math.pi * FREQUENCY_RANGE * state[FREQUENCY_HZ] / state[SAMPLING_HZ]
    turn = state[TURN] + FREQUENCY_GAIN * math.atan2(im, re) / cycle
    state[TURN] = min(limit, max(-limit, turn))


@njit
def write(state: Array, out: Array, cos: float, sin: float) -> None:
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
def learn(state: Array, models: Models, y: Array, sampled: Flags, cos: float, sin: float) -> None:
    """Compare the mean of the window with the prediction, and correct what may be corrected."""
    currents = (y[3], y[4], y[5])
    if state[AGE] < state[TAPS] - 1.0:  # the window holds samples from before the disturbance
        state[AGE] += 1.0
        if state[AGE] < state[TAPS] - 1.0:
            return
        state[WAVES] = state[WAVES_AT_RENEWAL]
        renew(state, models, cos, sin)
        compare_models(state, models, currents, sampled, cos, sin)
    else:
        for c in range(CHANNELS):
            compare(state, c, state[INNOVATION + c], state[PREDICTED + c] * base_variance(state, c))
        if is_disturbed(state):
            if state[TAPS] > 1.0:
                return
            renew(state, models, cos, sin)
            compare_models(state, models, currents, sampled, cos, sin)
    correct_voltages(state, y, cos, sin)
    correct_currents(state, models, sampled)
    follow_frequency(state)


@njit
def step(state: Array, models: Models, x: Array, out: Array) -> None:
    """One sample of six channels into a row of phasors."""
    smooth(state, models, x)
    y = state[SMOOTH : SMOOTH + CHANNELS]
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
    sampled = (is_sample(y[3]), is_sample(y[4]), is_sample(y[5]))
    predict_voltages(state, y, cos, sin)
    predict_models(state, models, cos, sin)
    compare_models(state, models, (y[3], y[4], y[5]), sampled, cos, sin)
    predict_currents(state, models)
    learn(state, models, y, sampled, cos, sin)
    write(state, out, math.cos(ahead), math.sin(ahead))
    state[N] += 1.0


@cache
def bank_step(count: int) -> Callable[[Array, Array, Array], None]:
    """``step(state, x, out)`` of a bank of ``count`` models; compiled once for each count asked for."""
    models = (0.0,) * count

    @njit
    def kalman_bank_step(state: Array, x: Array, out: Array) -> None:
        step(state, models, x, out)

    return kalman_bank_step
