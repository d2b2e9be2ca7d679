"""A transposed line's constants per kilometre, and the exact long line that its models are measured by."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from faultloop.plant.elements import Complex, Pair


@dataclass(frozen=True)
class LineConstants:
    """Per kilometre: series resistance [ohm], inductance [H], capacitance [F], each ``[mode 0, mode 1]``."""

    r: Pair
    l: Pair
    c: Pair
    frequency_hz: float

    def travel_time(self, length_km: float) -> Pair:
        """Of a lossless wave over the length [s]."""
        return length_km * np.sqrt(self.l * self.c)

    def exact_admittances(self, length_km: float) -> tuple[Complex, Complex]:
        """Exact long-line two-port at system frequency, per mode, as its admittance [S] for equal voltages at
        both ends, ``tanh(gl/2)/Zc``, and for opposite ones, ``coth(gl/2)/Zc``."""
        omega = 2 * np.pi * self.frequency_hz
        z = np.asarray(self.r + 1j * omega * self.l, dtype=np.complex128)
        y = np.asarray(1j * omega * self.c, dtype=np.complex128)
        zc = np.sqrt(z / y)
        tanh = np.tanh(np.sqrt(z * y) * (length_km / 2))
        return np.asarray(tanh / zc, np.complex128), np.asarray(1 / (tanh * zc), np.complex128)
