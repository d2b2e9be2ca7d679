"""A synchrophasor filter of class M, reports at f0, with less delay than the reference one of IEC/IEEE
60255-118-1.

What class M asks for is a stop band: an interfering tone of 10 % at the Nyquist frequency of the reports,
25 Hz from f0 at 50 per second, may move the frequency by 10 mHz, so the window must pass less than
0.01 / (0.1 x 27.5) = 0.36 % there.  The reference (annex D, eq. D.7) is a windowed sinc of nine cycles, flat
within the pass band.  But flatness is not asked for where the magnitude can be divided by what the window
passes at the frequency found, as class P does; modulation, which this does not mend, may lose 30 %.

So the window is the class P triangle, whose double zeros lie on every harmonic, convolved with a
Dolph-Chebyshev window, which has the narrowest main lobe for its side lobes (Dolph 1946): 4.25 cycles at
50 dB.  At 50 Hz that is 125 ms to the reference's 178, and a delay of 62 ms to 89.  Both
windows are positive: the step response is monotone, without overshoot.
"""

from __future__ import annotations

import numpy as np
from scipy.signal.windows import chebwin

from faultloop.relay.estimators.base import Estimator
from faultloop.relay.estimators.parameters import samples_per_cycle
from faultloop.relay.estimators.synchrophasor import centred_estimator, gain_offsets, passband, triangle

SIDE_LOBES_DB = 50.0
SMOOTHING_CYCLES = 4.25  # length of the Dolph-Chebyshev window


def make(sampling_hz: int, frequency_hz: float) -> Estimator:
    """Class M filter.  Raises InputError below 8 samples per cycle."""
    samples_per_cycle(sampling_hz, frequency_hz, least=8, method="m-class")
    half = round(0.5 * SMOOTHING_CYCLES * sampling_hz / frequency_hz)
    smoothing = np.asarray(chebwin(2 * half + 1, SIDE_LOBES_DB), dtype=np.float64)
    window = np.convolve(triangle(sampling_hz, frequency_hz), smoothing)
    gain = passband(window, sampling_hz, gain_offsets(frequency_hz))
    return centred_estimator("m-class", window, gain, sampling_hz, frequency_hz)
