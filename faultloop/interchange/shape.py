"""Shapes in the impedance plane: half-planes to corners, and the quadrilateral that comes near a polygon."""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FAR = 1e5
"""Ohm: how far a shape that is open is followed."""
Corners = NDArray[np.complex128]


def cut(corners: Corners, point: complex, angle: float, left: bool) -> Corners:
    """What of a convex polygon lies to one side of a line through ``point`` in the direction ``angle``
    [rad] (Sutherland and Hodgman 1974)."""
    along = cmath.exp(1j * angle)
    side = ((corners - point) / along).imag * (1.0 if left else -1.0)
    kept: list[complex] = []
    for k in range(len(corners)):
        a, b, sa, sb = corners[k - 1], corners[k], side[k - 1], side[k]
        if (sa >= 0) != (sb >= 0):
            kept.append(a + (b - a) * sa / (sa - sb))
        if sb >= 0:
            kept.append(b)
    return np.array(kept, np.complex128)


def everything() -> Corners:
    return np.array([1 + 1j, -1 + 1j, -1 - 1j, 1 - 1j], np.complex128) * FAR


def inside(points: Corners, corners: Corners) -> NDArray[np.bool_]:
    """Whether points lie in a polygon (even-odd rule)."""
    found = np.zeros(points.shape, bool)
    for a, b in zip(corners, np.roll(corners, -1), strict=True):
        if a.imag == b.imag:
            continue
        between = (a.imag > points.imag) != (b.imag > points.imag)
        at = a.real + (points.imag - a.imag) * (b.real - a.real) / (b.imag - a.imag)
        found ^= between & (points.real < at)
    return found


def arc(start: complex, radius: float, from_deg: float, sweep_deg: float, clockwise: bool) -> list[complex]:
    """Points of an arc that begins at ``start``, seen from its centre at ``from_deg``."""
    centre = start - cmath.rect(radius, math.radians(from_deg))
    steps = max(2, math.ceil(abs(sweep_deg) / 5))
    turn = -abs(sweep_deg) if clockwise else abs(sweep_deg)
    return [
        centre + cmath.rect(radius, math.radians(from_deg + turn * k / steps)) for k in range(1, steps + 1)
    ]


def leaves(corners: Corners, angle: float) -> tuple[float, complex, complex] | None:
    """Where a ray from the origin leaves a polygon, the farthest: how far out; the ends of that side."""
    along, best = cmath.exp(1j * angle), None
    for a, b in zip(corners, np.roll(corners, -1), strict=True):
        u, v = a / along, b / along
        if (u.imag > 0) == (v.imag > 0):
            continue
        at = u.real + (v.real - u.real) * u.imag / (u.imag - v.imag)
        if at > 0 and (best is None or at > best[0]):
            best = (float(at), complex(a), complex(b))
    return best


@dataclass(frozen=True)
class FittedQuad:
    """Reach along the line's angle, resistance in the plane, tilt of the reactance line; what it misses."""

    reach: float
    resistive: float
    tilt_deg: float
    differs: float

    @classmethod
    def of(cls, corners: Corners, angle: float, both_ways: bool) -> FittedQuad | None:
        """For a polygon that lies forward (or about the origin), a line of ``angle`` [rad]: the side by which
        the line leaves is the reactance line, and its right end the resistive reach.  None where there is
        none, or where it stands too steep."""
        met = leaves(corners, angle)
        if met is None:
            return None
        reach, a, b = met
        right = a if a.real > b.real else b
        side = right - (a + b - right)
        if side.real <= 0 or abs(side.imag) > math.tan(math.radians(25)) * side.real:
            return None
        # Of the tilt's own definition: the reactance line goes by (1 - s cot(angle), -s), s = tan(tilt).
        fall = side.imag / side.real
        slope = fall / (fall / math.tan(angle) - 1)
        tilt = min(max(math.degrees(math.atan(slope)), -20.0), 20.0)
        resistive = (right - cmath.rect(reach, angle)).real / (1 - slope / math.tan(angle))
        if resistive <= 0:
            return None
        made = quad(cmath.rect(reach, angle), resistive, tilt, both_ways)
        return cls(reach, resistive, tilt, _missed(corners, made))


def quad(reach: complex, resistive: float, tilt_deg: float, both_ways: bool) -> Corners:
    """Corners of faultloop's own quadrilateral with its usual directional borders, -15 and 115 degrees."""
    slope = math.tan(math.radians(tilt_deg))
    along = complex(1 - slope * reach.real / reach.imag, -slope)
    right, left = reach + resistive * along, reach - resistive * along
    if both_ways:
        return np.array([right, left, -right, -left])
    whole = np.array([right, left, -right, -left])
    below = cut(whole, 0j, math.radians(-15.0), True)
    return cut(below, 0j, math.radians(115.0), False)


def _missed(one: Corners, other: Corners) -> float:
    """Part of the first one's area that lies in only one of the two; by points on a grid."""
    both = np.concatenate([one, other])
    r = np.linspace(both.real.min(), both.real.max(), 240)
    x = np.linspace(both.imag.min(), both.imag.max(), 240)
    points = (r[None, :] + 1j * x[:, None]).ravel()
    a, b = inside(points, one), inside(points, other)
    return float((a ^ b).sum() / max(a.sum(), 1))
