"""A coupled capacitor between two nodes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from faultloop.plant.elements import Floats, Pair


@dataclass(frozen=True)
class Capacitor:
    """A `Branch`."""

    start: str
    end: str
    c: Pair
    """[F]"""

    def coefficients(self, dt: float) -> Floats:
        """(5, 2): ``G = 2C/dt``, ``h' = -G v - i``."""
        g = 2 * self.c / dt
        return np.array([g, -g, np.where(g != 0, -1.0, 0.0), -g, np.zeros(2)])

    def admittance(self, s: complex) -> complex:
        """Positive sequence [S]; ``s`` is the derivative as the trapezoidal rule has it [1/s]."""
        return complex(s * self.c[1])
