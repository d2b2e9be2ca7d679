"""The reference that every phasor is against: cos(2 pi f0 n / fs)."""

from __future__ import annotations

import math

from faultloop.jit import njit

PEAK_TO_RMS = math.sqrt(0.5)


@njit(forceinline=True)
def reference(n: int, sampling_hz: float, frequency_hz: float) -> tuple[float, float]:
    """cos and sin of 2 pi f0 n / fs; n f0 is reduced to one turn first: exact for whole f0, no drift."""
    beats = n * frequency_hz
    beats -= sampling_hz * math.floor(beats / sampling_hz)
    angle = beats * (2.0 * math.pi / sampling_hz)
    return math.cos(angle), math.sin(angle)
