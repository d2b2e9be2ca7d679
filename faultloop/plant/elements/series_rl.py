"""A coupled series R-L between two nodes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from faultloop.plant.elements import Floats, Pair


@dataclass(frozen=True)
class SeriesRL:
    """A `Branch`; a mode with infinite ``r`` does not conduct."""

    start: str
    end: str
    r: Pair
    """[ohm]"""
    l: Pair
    """[H]"""

    def coefficients(self, dt: float) -> Floats:
        """(5, 2): ``G = 1 / (R + 2L/dt)``, ``h' = G v + G (2L/dt - R) i``."""
        reactive = 2 * self.l / dt
        conducting = np.isfinite(self.r)
        r = np.where(conducting, self.r, 1.0)
        g = np.where(conducting, 1 / (r + reactive), 0.0)
        inductive = self.l > 0  # a resistance alone has no history
        return np.array(
            [
                g,
                np.where(inductive, g, 0.0),
                np.where(inductive, g * (reactive - r), 0.0),
                np.zeros(2),
                g * reactive,
            ]
        )

    def admittance(self, s: complex) -> complex:
        """Positive sequence [S]; ``s`` is the derivative as the trapezoidal rule has it [1/s]."""
        return complex(1 / (self.r[1] + s * self.l[1])) if np.isfinite(self.r[1]) else 0j
