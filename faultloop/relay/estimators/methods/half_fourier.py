"""Half-cycle discrete Fourier transform (Phadke, Thorp 1988, ch. 3): blind to odd harmonics only.

Twice as fast as the full cycle, and open to direct current: a decaying offset shows in full.
"""

from __future__ import annotations

from faultloop.relay.estimators.base import Estimator
from faultloop.relay.estimators.fir import fir_estimator
from faultloop.relay.estimators.parameters import samples_per_cycle
from faultloop.relay.estimators.quadrature import harmonic_rows


def make(sampling_hz: int, frequency_hz: float) -> Estimator:
    """Half-cycle DFT.  Raises InputError below 6 samples per cycle."""
    per_cycle = samples_per_cycle(sampling_hz, frequency_hz, least=6, method="half-fourier")
    taps = round(per_cycle / 2)
    rows = harmonic_rows(taps, sampling_hz, frequency_hz, range(1, taps, 2))
    return fir_estimator("half-fourier", rows, sampling_hz, frequency_hz)
