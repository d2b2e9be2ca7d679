"""Full-cycle discrete Fourier transform (Phadke, Thorp 1988, ch. 3): blind to direct current and all
harmonics.

Where fs / f0 is not whole the window is the nearest number of samples, and the coefficients are the
least-squares fit of the fundamental, the direct component and the harmonics to it: a plain truncated DFT
would leave an error even on a pure sinusoid.
"""

from __future__ import annotations

from faultloop.relay.estimators.base import Estimator
from faultloop.relay.estimators.fir import fir_estimator
from faultloop.relay.estimators.parameters import samples_per_cycle
from faultloop.relay.estimators.quadrature import full_cycle_rows


def make(sampling_hz: int, frequency_hz: float) -> Estimator:
    """Full-cycle DFT.  Raises InputError below 4 samples per cycle."""
    samples_per_cycle(sampling_hz, frequency_hz, least=4, method="fourier")
    return fir_estimator("fourier", full_cycle_rows(sampling_hz, frequency_hz), sampling_hz, frequency_hz)
