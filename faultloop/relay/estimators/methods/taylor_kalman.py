"""Taylor Kalman synchrophasor of ten states: phasor, frequency, ROCOF.

Wu Zhili, Zhao Qingsheng, Chen Huiying, Han Xiaoqing, Guo Hehong, "Research on a synchrophasor measurement
algorithm based on Kalman filtering at low sampling frequency" (Chinese), Power System Protection and Control,
2014 (15), pp. 94-99: seed paper 002.

The formulas (1) to (15) are missing from the text.  Derived here, and numbered as there:

(1) The frequency is f0 + x and rises by y per second:

    v(t) = Vm cos(w0 t + phi + 2 pi x t + pi y t^2) = Re[Vm e^(j phi) e^(j e) e^(j w0 t)],
    e = 2 pi x t + pi y t^2

(3) to (5) To the second order in (x, y) about (0, 0), e^(j e) = 1 + j e - e^2 / 2, so that

    v(t) = Re[(c0 + c1 t + c2 t^2 + c3 t^3 + c4 t^4) e^(j w0 t)],   with A = Vm e^(j phi)
    c0 = A                              c3 = -2 pi^2 x y A
    c1 = j 2 pi x A                     c4 = -(pi^2 / 2) y^2 A
    c2 = (j pi y - 2 pi^2 x^2) A

Five complex coefficients are the ten states.  The text says in one place that only terms of the first order
are kept (that would be six states), and in others that the second order and ten states are: ten it is.
States for 1, x, y, x^2, x y and y^2 would be twelve, and could not be told apart: y and x^2 both go with
t^2.

(7), (8) z_k = h_k X_k + noise with h = [t^m cos w0 t, -t^m sin w0 t], m = 0 .. 4; X_k+1 = X_k + noise.

(9) to (15) Vm = |c0|, phi = arg c0, x = Im(c1 / c0) / (2 pi), y = Im(c2 / c0) / pi: quotients of complex
numbers, which have a sign.  The paper takes roots of sums of squares, because its quotients of parts fail
near the zeros of cos phi or sin phi, and must then find the sign.  At a later t, with the polynomial p(t):
f = f0 + Im(p' / p) / (2 pi), ROCOF = Im(p'' / p - (p' / p)^2) / (2 pi).

Departures:

- The paper begins every window of 40 to 60 ms at t = 0 with the last estimate and covariance as they are.
  But the states belong to the window's origin: at 0.2 Hz off, the phase has turned by 3 degrees meanwhile.
  The filter as written is then wrong by 0.2 Hz at best, whatever its Q (the study of the paper shows it).
  Here the polynomial and its covariance are moved to the new origin, which is exact; a window is then only
  a way to keep the powers of t small.
- What forgets is the noise of (8), whose size the paper does not give: (1 / lambda - 1) P, as if P had
  grown by 1 / lambda, with lambda = (n - 1) / (n + 1) for a window of n samples.  Its weights have the
  window's effective length, whatever the sampling rate.  P is carried as its square root, and is renewed
  at a disturbance (disturbance.py).
- It runs at the relay's full rate.  To feed it the 200 to 400 Hz of the paper a relay would have to decimate,
  and without a filter before that (and its delay) the third harmonic would fold onto 50 Hz at 200 Hz.  The
  full rate costs no accuracy, and averages noise.

- It starts from a wide prior (about the last polynomial), so that it follows at once.  ``start =
  "least-squares"`` is section 2.2: the states and, over R, their covariance are those of the least squares
  over the first window after a disturbance, X0 = (H'H)^-1 H'Z and P0 = (H'H)^-1, and until then the last
  polynomial goes on.

Frequency and ROCOF are those of the positive-sequence voltage; NaN until there has been one for a window, and
held where it is below 0.1 % of the greatest phase.
"""

from __future__ import annotations

import math

import numpy as np

from faultloop.errors import InputError
from faultloop.jit import njit
from faultloop.relay.estimators.base import CHANNELS, FREQUENCY, ROCOF, Array, Estimator
from faultloop.relay.estimators.common_gain import correct_channels, innovate
from faultloop.relay.estimators.disturbance import (
    AGE,
    DETECTION_THRESHOLD,
    FREQUENCY_HZ,
    HEADER,
    NOISE_FLOOR,
    SAMPLING_HZ,
    N,
    follow_level,
    header,
    is_disturbed,
    is_sample,
)
from faultloop.relay.estimators.filters.square_root import correct_root, project
from faultloop.relay.estimators.parameters import choice, number, samples_per_cycle
from faultloop.relay.estimators.reference import PEAK_TO_RMS, reference
from faultloop.relay.estimators.synchrophasor import is_measurable, positive_sequence

TERMS = 5
UNKNOWNS = 2 * TERMS

FORGETTING = HEADER
WINDOW = HEADER + 1  # samples
TICK = HEADER + 2  # samples since the window's origin
FOUND_FREQUENCY = HEADER + 3
FOUND_ROCOF = HEADER + 4
INNOVATION = HEADER + 5  # six
PRIOR = HEADER + 11  # five: renewed standard deviations over that of the noise
ROW = PRIOR + TERMS
PROJECTED = ROW + UNKNOWNS
GAIN = PROJECTED + UNKNOWNS
DERIVATIVE = GAIN + UNKNOWNS  # six: p' of the voltages, in windows; then six: p''
ROOT = DERIVATIVE + 12
STATES = ROOT + UNKNOWNS * UNKNOWNS
START = STATES + CHANNELS * UNKNOWNS  # samples of the least squares that start it; 0: from the prior
LEFT = START + 1  # of them still to come
NORMAL = START + 2
RIGHT = NORMAL + UNKNOWNS * UNKNOWNS
LENGTH = RIGHT + CHANNELS * UNKNOWNS


@njit
def fill_row(row: Array, t: float, cos: float, sin: float) -> None:
    """h of eq. 5 at the time t [windows]."""
    power = 1.0
    for m in range(TERMS):
        row[2 * m] = power * cos
        row[2 * m + 1] = -power * sin
        power *= t


@njit
def move_origin(coefficients: Array, t: float) -> None:
    """Polynomials in columns (10, k), re and im in turn, about the origin t: Horner's scheme."""
    for i in range(TERMS - 1):
        for m in range(TERMS - 2, i - 1, -1):
            for part in range(2):
                for k in range(coefficients.shape[1]):
                    coefficients[2 * m + part, k] += t * coefficients[2 * m + 2 + part, k]


@njit
def renew(state: Array, root: Array, states: Array, t: float) -> None:
    """Begin a window here, keeping the polynomials as the prior mean."""
    move_origin(states, t)
    state[TICK] = 0.0
    state[LEFT] = state[START]
    state[NORMAL:] = 0.0
    root[:, :] = 0.0
    for m in range(TERMS):
        root[2 * m, 2 * m] = state[PRIOR + m]
        root[2 * m + 1, 2 * m + 1] = state[PRIOR + m]


@njit(heap=True)
def collect(state: Array, x: Array, row: Array, root: Array, states: Array) -> None:
    """A row of the least squares, a missing sample as predicted; after the last one, section 2.2's start."""
    normal = state[NORMAL:RIGHT].reshape((UNKNOWNS, UNKNOWNS))
    right = state[RIGHT:].reshape((UNKNOWNS, CHANNELS))
    for i in range(UNKNOWNS):
        for j in range(UNKNOWNS):
            normal[i, j] += row[i] * row[j]
    for c in range(CHANNELS):
        z = x[c]
        if not is_sample(z):
            z = 0.0
            for i in range(UNKNOWNS):
                z += row[i] * states[i, c]
        for i in range(UNKNOWNS):
            right[i, c] += row[i] * z
    state[LEFT] -= 1.0
    if state[LEFT] == 0.0:
        inverse = np.linalg.inv(normal)
        root[:, :] = np.linalg.cholesky(0.5 * (inverse + inverse.T))
        states[:, :] = inverse @ right


@njit
def evaluate(states: Array, t: float, out: Array, derivative: Array) -> None:
    """p of the six channels to ``out`` (RMS), p' and p'' of the voltages to ``derivative``, at t."""
    for k in range(2 * CHANNELS):
        part, c = k % 2, k // 2
        p = first = second = 0.0
        for m in range(TERMS - 1, -1, -1):
            second = second * t + 2.0 * first
            first = first * t + p
            p = p * t + states[2 * m + part, c]
        out[k] = PEAK_TO_RMS * p
        if c < 3:
            derivative[k] = PEAK_TO_RMS * first
            derivative[6 + k] = PEAK_TO_RMS * second


@njit
def frequency(state: Array, out: Array, derivative: Array) -> None:
    """f and ROCOF from p, p' and p'' of the positive sequence."""
    v1 = positive_sequence(out)
    begun = state[AGE] < state[WINDOW] and math.isnan(state[FOUND_FREQUENCY])
    if is_measurable(out, v1) and not begun:
        window_s = state[WINDOW] / state[SAMPLING_HZ]
        slope = positive_sequence(derivative[:6]) / v1
        curve = positive_sequence(derivative[6:]) / v1
        state[FOUND_FREQUENCY] = state[FREQUENCY_HZ] + slope.imag / (2.0 * math.pi * window_s)
        state[FOUND_ROCOF] = (curve - slope * slope).imag / (2.0 * math.pi * window_s * window_s)
    out[FREQUENCY] = state[FOUND_FREQUENCY]
    out[ROCOF] = state[FOUND_ROCOF]


@njit
def taylor_kalman_step(state: Array, x: Array, out: Array) -> None:
    row = state[ROW : ROW + UNKNOWNS]
    f = state[PROJECTED : PROJECTED + UNKNOWNS]
    gain = state[GAIN : GAIN + UNKNOWNS]
    innovation = state[INNOVATION : INNOVATION + CHANNELS]
    derivative = state[DERIVATIVE : DERIVATIVE + 12]
    root = state[ROOT:STATES].reshape((UNKNOWNS, UNKNOWNS))
    states = state[STATES:START].reshape((UNKNOWNS, CHANNELS))
    forgetting = state[FORGETTING]

    follow_level(state, x)
    cos, sin = reference(state[N], state[SAMPLING_HZ], state[FREQUENCY_HZ])
    t = state[TICK] / state[WINDOW]
    fill_row(row, t, cos, sin)
    projected = project(root, row, f) / forgetting
    if state[LEFT] == 0.0:
        innovate(state, x, row, states, innovation, projected)
        if is_disturbed(state):
            renew(state, root, states, t)
            t = 0.0
            fill_row(row, t, cos, sin)
            projected = project(root, row, f) / forgetting
    if state[LEFT] > 0.0:
        collect(state, x, row, root, states)
    else:
        correct_root(root, f, gain, forgetting)
        correct_channels(state, x, gain, states, innovation, projected)
    evaluate(states, t, out, derivative)
    frequency(state, out, derivative)

    state[N] += 1.0
    state[TICK] += 1.0
    if state[TICK] >= state[WINDOW]:
        move_origin(states, 1.0)
        move_origin(root, 1.0)
        state[TICK] = 0.0


def make(
    sampling_hz: int,
    frequency_hz: float,
    *,
    window_ms: float = 50.0,
    frequency_deviation_hz: float = 2.0,
    initial_covariance: float = 1e5,
    start: str = "prior",
    noise_floor: float = NOISE_FLOOR,
    detection_threshold: float = DETECTION_THRESHOLD,
) -> Estimator:
    """Taylor Kalman filter.

    Parameters
    ----------
    window_ms : length of the window, and of the memory [ms]; the paper has 40 to 60.
    frequency_deviation_hz : standard deviation that a renewal gives the frequency [Hz]; coefficient m then
        has (2 pi deviation window)^m / m! of the phasor's.
    initial_covariance : of a renewed phasor, over the variance of the noise.
    start : ``prior``, or ``least-squares`` over the first window (section 2.2).
    noise_floor : least standard deviation of the noise, over the peak of the voltages or currents.
    detection_threshold : squared normalised innovation that is a disturbance.

    Raises InputError below 4 samples per cycle, for a window of fewer samples than the ten states, or for a
    parameter outside its limits.
    """
    samples_per_cycle(sampling_hz, frequency_hz, least=4, method="taylor-kalman")
    window_s = 1e-3 * number("window_ms", window_ms, above=0.0, most=1000.0)
    window = round(window_s * sampling_hz)
    if window < UNKNOWNS:
        raise InputError(
            f"a window of {window} samples is shorter than the {UNKNOWNS} states: "
            f"at {sampling_hz} Hz it should be at least {1e3 * UNKNOWNS / sampling_hz:g} ms",
            key="window_ms",
        )
    deviation = number("frequency_deviation_hz", frequency_deviation_hz, above=0.0, most=0.5 * frequency_hz)
    spread = math.sqrt(number("initial_covariance", initial_covariance, least=1.0, most=1e20))
    state = np.zeros(LENGTH)
    state[:HEADER] = header(sampling_hz, frequency_hz, noise_floor, detection_threshold)
    state[FORGETTING] = (window - 1.0) / (window + 1.0)
    state[WINDOW] = window
    state[FOUND_FREQUENCY] = state[FOUND_ROCOF] = math.nan
    state[START] = window if choice("start", start, ("prior", "least-squares")) == "least-squares" else 0.0
    for m in range(TERMS):
        state[PRIOR + m] = spread * (2.0 * math.pi * deviation * window_s) ** m / math.factorial(m)
    return Estimator("taylor-kalman", taylor_kalman_step, state, window)
