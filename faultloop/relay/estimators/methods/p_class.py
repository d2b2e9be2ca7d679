"""The reference filter of IEC/IEEE 60255-118-1, class P: a triangle of two cycles (annex D, eq. D.5, D.6).

Frequency and ROCOF are those of the window's centre, one cycle ago: `Estimator.delay_samples`.
"""

from __future__ import annotations

import numpy as np

from faultloop.relay.estimators.base import Estimator
from faultloop.relay.estimators.parameters import samples_per_cycle
from faultloop.relay.estimators.synchrophasor import centred_estimator, gain_offsets, triangle


def make(sampling_hz: int, frequency_hz: float) -> Estimator:
    """Class P reference filter.  Raises InputError below 8 samples per cycle."""
    samples_per_cycle(sampling_hz, frequency_hz, least=8, method="p-class")
    # Eq. D.6: over sin(pi (f0 + 1.625 dF) / (2 f0)).
    gain = np.sin(np.pi * (frequency_hz + 1.625 * gain_offsets(frequency_hz)) / (2.0 * frequency_hz))
    window = triangle(sampling_hz, frequency_hz)
    return centred_estimator("p-class", window, gain, sampling_hz, frequency_hz)
