"""The rules of a line differential element: from the currents of all ends to restrain or operate.

Pure functions of phasors, so that a test can sweep the plane.  Currents are into the line, complex RMS; their
sum is the fault's.

Alpha plane (Benmouyal and Roberts 2004, "The alpha plane"; as SEL-311L and 411L have it): the ratio k of the
remote to the local current is -1 for whatever flows through.  Restrained is a sector of the ring around -1:
1/R < |k| < R, and the angle within half the sector of 180 degrees.  More than two ends become two equivalent
ones of the same differential and the same restraint (Kasztenny, Benmouyal, Altuve and Fischer 2011, "Tutorial
on operating characteristics of microprocessor-based multiterminal line current differential relays").

Percentage with two slopes (GE P54x): |sum| against half the sum of magnitudes.  While a fault outside is
known the angle is asked, too, as GE's B30 does beside its detector of saturation: a current transformer that
saturates leaves a part of the current, some 90 degrees late at most, and no slope stands that.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from faultloop.jit import njit
from faultloop.relay.memory import size2

Record = Any

RULE = np.dtype(
    [
        ("alpha", "i8"),  # 1: alpha plane; 0: percentage
        ("pickup", "f8"),  # of the differential current [A]
        ("ratio", "f8"),  # R of the alpha plane
        ("half_angle_cos", "f8"),  # cosine of half the sector
        ("slope1", "f8"),  # of the percentage
        ("slope2", "f8"),
        ("knee", "f8"),  # bias where the second slope begins [A]
    ],
    align=True,
)
SECURE = 1.2
"""Of ratio and pickup while a fault outside is known."""
MOST_RATIO = 8.0
SECURE_SLOPE = 0.7
"""At least, while a fault outside is known."""


@njit
def differential(currents: NDArray[np.complex128], n: int) -> complex:
    """The sum of the first n."""
    total = 0j
    for k in range(n):
        total += currents[k]
    return total


@njit
def restraint(currents: NDArray[np.complex128], n: int) -> float:
    """The sum of the magnitudes of the first n."""
    total = 0.0
    for k in range(n):
        total += math.sqrt(size2(currents[k]))
    return total


@njit
def ratio_of(currents: NDArray[np.complex128], n: int) -> complex:
    """k of two currents, or of the two equivalent ones of more; infinite where the local one is zero.

    Of more than two: the one whose projection on the differential current is greatest gives the angle of the
    first equivalent current; its size follows from |first| + |second| = restraint, first + second =
    differential.
    """
    if n == 2:
        first, second = currents[0], currents[1]
    else:
        total, bias = differential(currents, n), restraint(currents, n)
        best = currents[0]
        for k in range(1, n):
            own = (currents[k] * total.conjugate()).real
            if own > (best * total.conjugate()).real:
                best = currents[k]
        size = math.sqrt(size2(best))
        if size == 0.0:
            return complex(-1.0, 0.0)
        turn = best / size
        along = (total * turn.conjugate()).real
        rest = 2.0 * (bias - along)
        # bias = |total| along its own angle: all currents are in phase, and one equivalent current has all
        first = turn * ((bias * bias - size2(total)) / rest if rest > 1e-9 * bias else bias)
        second = total - first
    if size2(first) == 0.0:
        return complex(np.inf, 0.0)
    return second / first


@njit
def alpha_operates(k: complex, ratio: float, half_angle_cos: float) -> bool:
    """Whether a point of the alpha plane is outside the restraining sector."""
    size = math.sqrt(size2(k))
    if not 1.0 / ratio < size < ratio:
        return True
    return k.real > size * -half_angle_cos


@njit
def percentage_operates(c: Record, total: float, bias: float, secure: bool) -> bool:
    """Whether |sum| is above the two slopes over half the sum of magnitudes."""
    slope1 = max(c.slope1, SECURE_SLOPE) if secure else c.slope1
    slope2 = max(c.slope2, slope1)
    if bias <= c.knee:
        return total > slope1 * bias + c.pickup
    return total > slope2 * bias - (slope2 - slope1) * c.knee + c.pickup


@njit
def operates(c: Record, currents: NDArray[np.complex128], n: int, secure: bool) -> bool:
    """The rule: whether the currents (n,) of one phase at one instant are those of a fault between the ends.

    Parameters
    ----------
    c : a `RULE`.
    secure : a fault outside is known; the rule is then harder to satisfy, not blind.
    """
    total = math.sqrt(size2(differential(currents, n)))
    if not total > c.pickup * (SECURE if secure else 1.0):
        return False
    if not c.alpha:
        if not percentage_operates(c, total, restraint(currents, n) / 2, secure):
            return False
        if not secure:
            return True
    ratio = min(SECURE * c.ratio, max(MOST_RATIO, c.ratio)) if secure else c.ratio
    return alpha_operates(ratio_of(currents, n), ratio, c.half_angle_cos)
