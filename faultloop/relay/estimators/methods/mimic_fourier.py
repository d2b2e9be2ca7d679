"""Digital mimic filter (Benmouyal 1995) before the full-cycle DFT: removes an offset of the mimic's time
constant.

The mimic is the replica impedance 1 + s tau by backward difference: y(n) = (1 + T) x(n) - T
x(n-1), with T = tau fs.  It is a differentiator in part and lets through more of the noise.  Voltages
pass it too: an impedance is a quotient, and equal filters leave the least of a transient in it.
"""

from __future__ import annotations

import numpy as np

from faultloop.relay.estimators.base import Estimator
from faultloop.relay.estimators.fir import fir_estimator
from faultloop.relay.estimators.parameters import number, samples_per_cycle
from faultloop.relay.estimators.quadrature import full_cycle_rows


def make(sampling_hz: int, frequency_hz: float, *, time_constant_ms: float = 40.0) -> Estimator:
    """Mimic filter and DFT.

    Parameters
    ----------
    time_constant_ms : time constant of the offset that the mimic removes [ms].

    Raises InputError below 4 samples per cycle or for a time constant outside 1 to 1000 ms.
    """
    samples_per_cycle(sampling_hz, frequency_hz, least=4, method="mimic-fourier")
    time_constant_s = 1e-3 * number("time_constant_ms", time_constant_ms, least=1.0, most=1000.0)
    samples = time_constant_s * sampling_hz
    mimic = np.array([1.0 + samples, -samples])
    dft = full_cycle_rows(sampling_hz, frequency_hz)
    rows = np.column_stack([np.convolve(mimic, dft[:, 0]), np.convolve(mimic, dft[:, 1])])
    return fir_estimator("mimic-fourier", rows, sampling_hz, frequency_hz)
