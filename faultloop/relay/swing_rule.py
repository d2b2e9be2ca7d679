"""A power swing's boxes: setting rules (ABB, application manual of the 670 series, ZMRPSB) and sizes."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from faultloop.errors import InputError
from faultloop.relay.functions.function import Polygon
from faultloop.relay.functions.pdis import reach_ohm

if TYPE_CHECKING:
    from faultloop.relay.functions.rpsb import Rpsb
    from faultloop.relay.settings import RelaySettings

MARGIN, LOAD_MARGIN = 1.1, 0.8


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


def inner_ohm(settings: RelaySettings, table: Rpsb) -> float:
    """Resistance of the inner box, as the file has its ohms."""
    if table.inner_resistance_ohm is not None:
        return table.inner_resistance_ohm
    if table.total_ohm is None:
        return LOAD_MARGIN * table.outer_resistance_ohm
    slip, crossing = table.initial_slip_hz, table.crossing_ms / 1000
    return setting_rule(table.total_ohm, table.outer_resistance_ohm, slip, crossing)[0]


def reaches(settings: RelaySettings, table: Rpsb) -> tuple[float, float]:
    """Forward and reverse reach of the inner box, primary [ohm]."""
    given = []
    for key, direction in (("forward_reach_ohm", "forward"), ("reverse_reach_ohm", "reverse")):
        value = getattr(table, key)
        zones = [abs(reach_ohm(settings, z)) for z in settings.pdis if z.direction in (direction, "none")]
        least = max([*zones, 0.5 * abs(settings.z1_ohm)])
        given.append(MARGIN * least if value is None else value * settings.ohm_ratio)
    return given[0], given[1]


def check(settings: RelaySettings) -> None:
    """The inner box lies around every zone, and within the outer one."""
    table: Any = settings.rpsb
    inner, outer = inner_ohm(settings, table), table.outer_resistance_ohm
    if inner >= outer or inner <= 0:
        what = (
            f"the rule puts the inner box at {inner:.4g} ohm, not below the outer one at {outer:g}; "
            "a slower initial_slip_hz, a shorter crossing_ms or a total_ohm that is the sum of line "
            "and sources"
        )
        raise InputError(what, key="rpsb.total_ohm")
    for number, zone in enumerate(settings.pdis, 1):
        blind = (zone.resistive_reach_ohm or 0.0) if zone.characteristic == "quad" else 0.0
        if zone.characteristic == "mho":
            blind = (
                abs(reach_ohm(settings, zone)) / settings.ohm_ratio / (1 if zone.direction == "none" else 2)
            )
        if blind > inner:
            what = (
                f"the inner box, {inner:.4g} ohm to each side of the line, must be around every zone: "
                f"PDIS{number} reaches {blind:.4g} ohm"
            )
            raise InputError(what, key="rpsb.inner_resistance_ohm")


def polygons(settings: RelaySettings, table: Rpsb) -> tuple[Polygon, Polygon]:
    """The boxes as one line, from the outer to the inner one and back, primary ohm."""
    axis = settings.z1_ohm / abs(settings.z1_ohm)
    forward, reverse = reaches(settings, table)
    inner, outer = (r * settings.ohm_ratio for r in (inner_ohm(settings, table), table.outer_resistance_ohm))
    corners = []
    for resistance, more in ((outer, outer - inner), (inner, 0.0)):
        box = [complex(forward + more, side * resistance) for side in (-1, 1)]
        box += [complex(-reverse - more, side * resistance) for side in (1, -1)]
        corners += [*box, box[0]]
    points = axis * np.array([*corners, corners[0]])
    return np.empty((0, 2)), np.column_stack([points.real, points.imag])
