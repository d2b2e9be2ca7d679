"""Full-cycle cosine filter (Schweitzer, Hou 1993): its output now and a quarter of a cycle ago are the
phasor.

The cosine is blind to a constant and nearly to a ramp, so a decaying offset passes less than through the
sine half of the DFT.
"""

from __future__ import annotations

import numpy as np

from faultloop.relay.estimators.base import Estimator
from faultloop.relay.estimators.fir import fir_estimator
from faultloop.relay.estimators.parameters import samples_per_cycle
from faultloop.relay.estimators.quadrature import full_cycle_rows


def make(sampling_hz: int, frequency_hz: float) -> Estimator:
    """Cosine filter.  Raises InputError below 8 samples per cycle.

    Where fs / f0 is not a multiple of 4 the delay is the nearest whole number of samples, and the
    calibration at f0 takes up the rest.
    """
    per_cycle = samples_per_cycle(sampling_hz, frequency_hz, least=8, method="cosine")
    cosine = full_cycle_rows(sampling_hz, frequency_hz)[:, 0]
    delay = np.zeros(round(per_cycle / 4))
    rows = np.column_stack([np.concatenate([cosine, delay]), np.concatenate([delay, cosine])])
    return fir_estimator("cosine", rows, sampling_hz, frequency_hz)
