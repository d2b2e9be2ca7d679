"""The filter of seed paper 002 as it is written: one channel, covariance form, t put back to zero.

Wu Zhili, Zhao Qingsheng, Chen Huiying, Han Xiaoqing, Guo Hehong, "Research on a synchrophasor measurement
algorithm based on Kalman filtering at low sampling frequency" (Chinese), Power System Protection and Control,
2014 (15), pp. 94-99.

Equations 5, 7, 8 and 16 to 20 with the states of `faultloop.relay.estimators.methods.taylor_kalman`; t is in
windows, R = 1 V^2, and Q = q I, which the paper leaves open.  What becomes of the estimate and its covariance
at a window's end is a function, and so is the start:

- ``as_they_are``: what section 2.3 says;  ``moved``: the polynomial about the new origin, which is exact;
- ``wide``: zero, and a covariance of 1e6 V^2;  ``least_squares``: section 2.2.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import comb
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

TERMS = 5
STATES = 2 * TERMS
INITIAL_COVARIANCE = 1e6  # [V^2]
FIRST = np.arange(1, TERMS)  # what a derivative, and a second one, multiplies the coefficients by
SECOND = FIRST[1:] * FIRST[:-1]


class Estimate(NamedTuple):
    """x (10,): real parts of c0 .. c4, then the imaginary ones; P (10, 10)."""

    x: Array
    P: Array


def as_they_are(estimate: Estimate, passed: float) -> Estimate:
    """The best estimate and its covariance are the next window's initial values (section 2.3)."""
    return estimate


def moved(estimate: Estimate, passed: float) -> Estimate:
    """Of the same polynomial about an origin that is ``passed`` windows later."""
    shift = np.array([[comb(k, m) * passed ** max(k - m, 0) for k in range(TERMS)] for m in range(TERMS)])
    both = np.kron(np.eye(2), shift)
    return Estimate(both @ estimate.x, both @ estimate.P @ both.T)


def wide(samples: Array, rows: Array) -> Estimate:
    """Nothing known."""
    return Estimate(np.zeros(STATES), INITIAL_COVARIANCE * np.eye(STATES))


def least_squares(samples: Array, rows: Array) -> Estimate:
    """Section 2.2: X0 = (H'H)^-1 H'Z of the m samples, and P0 = (H'H)^-1 R with R = 1 V^2."""
    inverse = np.linalg.pinv(rows)
    return Estimate(inverse @ samples, inverse @ inverse.T)


@dataclass(frozen=True)
class Form:
    """How the filter runs.

    window : samples after which t is zero again.
    carry : what becomes of the estimate then.
    start, first : the start, and the samples m that it takes; ``wide`` takes none.
    process_noise : q, per sample [V^2].
    forgetting : factor by which P grows in every sample, inverted: a memory in place of q.
    """

    window: int
    carry: Callable[[Estimate, float], Estimate] = as_they_are
    start: Callable[[Array, Array], Estimate] = wide
    first: int = 0
    process_noise: float = 0.0
    forgetting: float = 1.0


def row(t: float, angle: float) -> Array:
    """h of eq. 5 at t [windows]; ``angle`` = w0 t [rad], (10,)."""
    powers = t ** np.arange(TERMS)
    return np.concatenate([powers * np.cos(angle), -powers * np.sin(angle)])


def read_out(x: Array, t: float, window_s: float) -> tuple[complex, float, float]:
    """Phasor [V RMS], deviation of the frequency [Hz] and ROCOF [Hz/s] (eq. 9 to 15, at t)."""
    c = x[:TERMS] + 1j * x[TERMS:]
    powers = t ** np.arange(TERMS)
    value = complex(powers @ c)
    slope = complex(powers[:-1] @ (FIRST * c[1:])) / value
    curve = complex(powers[:-2] @ (SECOND * c[2:])) / value
    found = (curve - slope**2).imag / (2.0 * np.pi * window_s**2)
    return np.sqrt(0.5) * value, slope.imag / (2.0 * np.pi * window_s), found


def written_filter(
    samples: Array, sampling_hz: int, frequency_hz: float, form: Form
) -> tuple[Complex, Array, Array]:
    """Run it over one channel.

    Parameters
    ----------
    samples : (n,) [V].

    Returns the phasor (n,) [V RMS], the frequency (n,) [Hz] and ROCOF (n,) [Hz/s], at each sample; NaN during
    the samples of the start.
    """
    step = 2.0 * np.pi * frequency_hz / sampling_hz
    first, window_s = form.first, form.window / sampling_hz
    rows = np.array([row(n / form.window, step * n) for n in range(first)]).reshape(first, STATES)
    x, covariance = form.start(samples[:first], rows)
    phasor = np.full(len(samples), np.nan, complex)
    frequency, rocof = np.full(len(samples), np.nan), np.full(len(samples), np.nan)
    for n in range(first, len(samples)):
        since = (n - first) % form.window
        if since == 0 and n > 0:
            x, covariance = form.carry(
                Estimate(x, covariance), (first if n == first else form.window) / form.window
            )
        h = row(since / form.window, step * n)
        covariance = covariance / form.forgetting + form.process_noise * np.eye(STATES)
        gain = covariance @ h / (h @ covariance @ h + 1.0)
        x = x + gain * (samples[n] - h @ x)
        covariance = covariance - np.outer(gain, h @ covariance)
        covariance = 0.5 * (covariance + covariance.T)
        phasor[n], offset, rocof[n] = read_out(x, since / form.window, window_s)
        frequency[n] = frequency_hz + offset
    return phasor, frequency, rocof
