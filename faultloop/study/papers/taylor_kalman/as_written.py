"""The filter of seed paper 002 as it is written: one channel, covariance form, t put back to zero.

Equations 5, 7, 8 and 16 to 20 with the states of `faultloop.relay.estimators.methods.taylor_kalman`; t is in
windows, R = 1 V^2, and Q = q I, which the paper leaves open.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

TERMS = 5
INITIAL_COVARIANCE = 1e6  # [V^2]


def written_filter(
    samples: Array, sampling_hz: int, frequency_hz: float, window: int, process_noise: float
) -> tuple[NDArray[np.complex128], Array, Array]:
    """Run it over one channel.

    Parameters
    ----------
    samples : (n,) [V].
    window : samples after which t is zero again, the estimate and the covariance carried over as they are.
    process_noise : q, per sample [V^2].

    Returns the phasor (n,) [V RMS], the frequency (n,) [Hz] and ROCOF (n,) [Hz/s], at each sample.
    """
    x = np.zeros(2 * TERMS)
    covariance = INITIAL_COVARIANCE * np.eye(2 * TERMS)
    window_s = window / sampling_hz
    powers = np.arange(TERMS)
    phasor = np.empty(len(samples), complex)
    frequency, rocof = np.empty(len(samples)), np.empty(len(samples))
    for n, z in enumerate(samples):
        t = (n % window) / window
        angle = 2.0 * np.pi * frequency_hz * n / sampling_hz
        row = np.concatenate([t**powers * np.cos(angle), -(t**powers) * np.sin(angle)])
        covariance = covariance + process_noise * np.eye(2 * TERMS)
        gain = covariance @ row / (row @ covariance @ row + 1.0)
        x = x + gain * (z - row @ x)
        covariance = covariance - np.outer(gain, row @ covariance)
        covariance = 0.5 * (covariance + covariance.T)
        polynomial = np.polynomial.Polynomial(x[:TERMS] + 1j * x[TERMS:])
        value = polynomial(t)
        slope, curve = polynomial.deriv()(t) / value, polynomial.deriv(2)(t) / value
        phasor[n] = np.sqrt(0.5) * value
        frequency[n] = frequency_hz + slope.imag / (2.0 * np.pi * window_s)
        rocof[n] = (curve - slope**2).imag / (2.0 * np.pi * window_s**2)
    return phasor, frequency, rocof
