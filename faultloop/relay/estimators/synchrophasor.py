"""The kernel of the synchrophasor filters: a linear-phase window, time-stamped at its centre.

IEC/IEEE 60255-118-1 annex D: the samples are turned by -w0 t and weighted by a symmetric window, which is
the FIR kernel with the rows w(k) cos w0 t and -w(k) sin w0 t; frequency and ROCOF are the first and second
central difference of the positive-sequence voltage's angle; the magnitude is divided by what the window
passes at the frequency found.  The difference needs the sample after the centre, so a row refers to the time
(taps - 1) / 2 + 1 samples before the newest: `Estimator.delay_samples`.

Frequency and ROCOF are NaN until a positive-sequence voltage has filled the window, and held while there is
none to measure them on (below 0.1 % of the greatest phase, or a sample is missing) and until it has filled
the window again.
"""

from __future__ import annotations

import math

import numpy as np

from faultloop.jit import njit
from faultloop.relay.estimators.base import FREQUENCY, ROCOF, Array, Estimator
from faultloop.relay.estimators.fir import FREQUENCY_HZ, SAMPLING_HZ, TAPS, fir_estimator, fir_step
from faultloop.relay.estimators.quadrature import fundamental

# Behind the FIR kernel's state.
GAIN = 0  # four: the window's passband over (offset from f0)^2
LARGEST_OFFSET = 4  # the gain is that of this offset beyond it [Hz]
FOUND_FREQUENCY = 5
FOUND_ROCOF = 6
BEFORE = 7  # two: positive sequence a sample before the centre
CENTRE = 9  # twelve: the phasors at the centre
MEASURABLE = 21  # samples since when there is a voltage to measure on
EXTRA = 22

A_RE, A_IM = -0.5, math.sqrt(0.75)
LEAST_SEQUENCE = 1e-3  # of the greatest phase voltage

# The passband is corrected within this part of f0 on either side: what the standard's M class spans at 50 Hz.
CORRECTED = 0.1


@njit(forceinline=True)
def positive_sequence(row: Array) -> complex:
    """Of the voltages in a phasor row."""
    re = row[0] + A_RE * (row[2] + row[4]) - A_IM * (row[3] - row[5])
    im = row[1] + A_RE * (row[3] + row[5]) + A_IM * (row[2] - row[4])
    return complex(re / 3.0, im / 3.0)


@njit(forceinline=True)
def turn(after: complex, before: complex) -> float:
    """Angle from one phasor to the next [rad]."""
    z = after * before.conjugate()
    return math.atan2(z.imag, z.real)


@njit(forceinline=True)
def is_measurable(row: Array, v1: complex) -> bool:
    """False for NaN too."""
    phase = max(math.hypot(row[0], row[1]), math.hypot(row[2], row[3]), math.hypot(row[4], row[5]))
    return abs(v1) > LEAST_SEQUENCE * phase


@njit
def centred_step(state: Array, x: Array, out: Array) -> None:
    extra = state[len(state) - EXTRA :]
    fir_step(state, x, out)
    centre = extra[CENTRE : CENTRE + 12]
    after, middle = positive_sequence(out), positive_sequence(centre)
    before = complex(extra[BEFORE], extra[BEFORE + 1])
    fs = state[SAMPLING_HZ]
    extra[MEASURABLE] = extra[MEASURABLE] + 1.0 if is_measurable(out, after) else 0.0
    if extra[MEASURABLE] >= state[TAPS] + 2.0:
        second, first = turn(after, middle), turn(middle, before)
        extra[FOUND_FREQUENCY] = state[FREQUENCY_HZ] + (second + first) * fs / (4.0 * math.pi)
        extra[FOUND_ROCOF] = (second - first) * fs * fs / (2.0 * math.pi)
    offset = abs(extra[FOUND_FREQUENCY] - state[FREQUENCY_HZ])
    d = min(offset, extra[LARGEST_OFFSET]) ** 2 if offset >= 0.0 else 0.0  # NaN: not known yet
    scale = 1.0 / (extra[GAIN] + d * (extra[GAIN + 1] + d * (extra[GAIN + 2] + d * extra[GAIN + 3])))
    extra[BEFORE], extra[BEFORE + 1] = middle.real, middle.imag
    for k in range(12):
        newest = out[k]
        out[k] = centre[k] * scale
        centre[k] = newest
    out[FREQUENCY] = extra[FOUND_FREQUENCY]
    out[ROCOF] = extra[FOUND_ROCOF]


def triangle(sampling_hz: int, frequency_hz: float) -> Array:
    """The reference window of class P (annex D, eq. D.5), (2 ceil(fs / f0) - 1,).

    W(k) = 1 - 2 |k| / (N + 2), N = 2 (fs / f0 - 1), is 1 - |k| f0 / fs: two cycles of f0, with double zeros
    at every multiple of f0 (to 2e-5 where fs / f0 is not whole).
    """
    half = math.ceil(sampling_hz / frequency_hz - 1e-9) - 1
    return 1.0 - np.abs(np.arange(-half, half + 1)) * frequency_hz / sampling_hz


def passband(window: Array, sampling_hz: int, offset_hz: Array) -> Array:
    """What a symmetric window passes of a phasor that turns at f0 + offset, over that at f0, (m,)."""
    k = np.arange(len(window)) - (len(window) - 1) / 2
    return np.cos(2.0 * np.pi / sampling_hz * np.outer(offset_hz, k)) @ window / window.sum()


def centred_estimator(
    name: str, window: Array, gain: Array, sampling_hz: int, frequency_hz: float
) -> Estimator:
    """The estimator of a symmetric window of odd length.

    Parameters
    ----------
    window : (taps,) float64; its scale does not matter.
    gain : (m,) what the magnitudes are divided by at the offsets `gain_offsets` gives.
    """
    taps = len(window)
    times = (np.arange(taps // 2, -taps // 2, -1)) / sampling_hz  # from the centre; tap 0 is the newest
    rows = window[:, None] * fundamental(times, frequency_hz)
    fir = fir_estimator(name, rows, sampling_hz, frequency_hz)
    extra = np.zeros(EXTRA)
    offsets = gain_offsets(frequency_hz)
    powers = offsets[:, None] ** np.array([2, 4, 6])
    extra[GAIN] = 1.0
    extra[GAIN + 1 : GAIN + 4] = np.linalg.lstsq(powers / powers[-1], gain - 1.0, rcond=None)[0] / powers[-1]
    extra[LARGEST_OFFSET] = offsets[-1]
    extra[FOUND_FREQUENCY] = extra[FOUND_ROCOF] = math.nan
    state = np.concatenate([fir.state, extra])
    return Estimator(name, centred_step, state, taps + 2, taps // 2 + 1)


def gain_offsets(frequency_hz: float) -> Array:
    """Offsets from f0 at which a gain is given [Hz], (m,)."""
    return np.linspace(0.0, CORRECTED * frequency_hz, 21)
