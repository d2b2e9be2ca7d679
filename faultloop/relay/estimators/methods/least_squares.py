"""Batch least squares (Sachdev, Baribeau 1979): cos, sin, 1 and t, fitted to a window.

1 and t are the first terms of the Taylor series of a decaying offset whose time constant nobody knows;
over one cycle they leave little of any that is longer than half a cycle.
"""

from __future__ import annotations

import numpy as np

from faultloop.relay.estimators.base import Estimator
from faultloop.relay.estimators.fir import fir_estimator
from faultloop.relay.estimators.parameters import number, samples_per_cycle, whole
from faultloop.relay.estimators.quadrature import fit, fundamental, tap_times


def make(
    sampling_hz: int,
    frequency_hz: float,
    *,
    window_cycles: float = 1.0,
    harmonics: int = 1,
    offset_terms: int = 2,
) -> Estimator:
    """Least-squares estimator.

    Parameters
    ----------
    window_cycles : length of the window [cycles of f0].
    harmonics : harmonics in the model, the fundamental counted.
    offset_terms : terms of the offset's Taylor series: 0 none, 1 constant, 2 and t, 3 and t squared.

    Raises InputError if the window has fewer samples than the model has unknowns, or a harmonic is above
    fs / 2.
    """
    harmonics = whole("harmonics", harmonics, least=1, most=50)
    offset_terms = whole("offset_terms", offset_terms, least=0, most=3)
    per_cycle = samples_per_cycle(sampling_hz, frequency_hz, least=2.2 * harmonics, method="least-squares")
    taps = round(per_cycle * number("window_cycles", window_cycles, above=0.0, most=10.0))
    times = tap_times(taps, sampling_hz)
    columns = [fundamental(times, order * frequency_hz) for order in range(1, harmonics + 1)]
    columns += [(times * frequency_hz)[:, None] ** power for power in range(offset_terms)]
    return fir_estimator("least-squares", fit(np.hstack(columns)), sampling_hz, frequency_hz)
