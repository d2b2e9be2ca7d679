"""A pair of samples a quarter of a cycle apart: the phasor of what is a sinusoid already, with no
filtering.

For records whose samples a relay has filtered before it stored them; on raw samples every disturbance
passes.
"""

from __future__ import annotations

import numpy as np

from faultloop.relay.estimators.base import Estimator
from faultloop.relay.estimators.fir import fir_estimator
from faultloop.relay.estimators.parameters import samples_per_cycle


def make(sampling_hz: int, frequency_hz: float) -> Estimator:
    """Quarter-cycle pair.  Raises InputError below 3 samples per cycle.

    The pair is the nearest whole number of samples apart, and the calibration at f0 takes up the rest.
    """
    per_cycle = samples_per_cycle(sampling_hz, frequency_hz, least=3, method="quarter-cycle")
    rows = np.zeros((round(per_cycle / 4) + 1, 2))
    rows[0, 0] = rows[-1, 1] = 1.0
    return fir_estimator("quarter-cycle", rows, sampling_hz, frequency_hz)
