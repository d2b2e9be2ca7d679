"""Setting rules of a power swing's boxes (ABB, application manual of the 670 series, ZMRPSB)."""

from __future__ import annotations

import math


def angle_deg(total_ohm: float, resistance_ohm: float) -> float:
    """Angle between two equal sources when the swing is at a distance from the total impedance between
    them."""
    return 2 * math.degrees(math.atan(total_ohm / (2 * resistance_ohm)))


def resistance_at(total_ohm: float, angle: float) -> float:
    """The distance at an angle [degrees]."""
    return total_ohm / (2 * math.tan(math.radians(angle) / 2))


def setting_rule(
    total_ohm: float, outer_ohm: float, slip_hz: float, crossing_s: float, next_slip_hz: float = 7.0
) -> tuple[float, float]:
    """Inner resistance [ohm] that a first swing of this slip takes ``crossing_s`` to reach from the outer
    one, and the time [s] that one of ``next_slip_hz`` takes."""
    outer = angle_deg(total_ohm, outer_ohm)
    inner = outer + 360 * slip_hz * crossing_s
    return resistance_at(total_ohm, inner), (inner - outer) / (360 * next_slip_hz)


def load_angle_deg(angle: float, ratio: float) -> float:
    """The load's angle [degrees] as the inner box has it, whose resistance alone is smaller by ``ratio``."""
    return math.degrees(math.atan(math.tan(math.radians(angle)) / ratio))
