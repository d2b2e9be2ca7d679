"""A power swing: settings, setting rules (ABB, application manual of the 670 series, ZMRPSB), boxes."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator

from faultloop.config.tables import Milliseconds, Positive, Seconds, Table
from faultloop.errors import InputError
from faultloop.relay.functions.function import Polygon
from faultloop.relay.functions.pdis import reach_ohm

if TYPE_CHECKING:
    from faultloop.relay.settings import RelaySettings

MARGIN, LOAD_MARGIN = 1.1, 0.8


class Rpsb(Table):
    """``[rpsb]``: power-swing blocking, out-of-step tripping."""

    outer_resistance_ohm: Positive
    """Of the outer box, to each side of the line's angle; at most 80 % of the least load impedance."""
    inner_resistance_ohm: Positive | None = None
    """Of the inner box; by `setting_rule` of `total_ohm` where that is given, else 0.8 of the outer one."""
    total_ohm: Positive | None = None
    """Of the line and both sources behind it, |Z1|: for the rule."""
    initial_slip_hz: Annotated[float, Field(gt=0, le=10)] = 2.5
    """Of the fastest first swing that the timer between the boxes must see: for the rule."""
    forward_reach_ohm: Positive | None = None
    """Of the inner box along the line's angle; 1.1 times the farthest forward zone where not given."""
    reverse_reach_ohm: Positive | None = None
    """The same backwards; 1.1 times the farthest reverse zone, but half the line at least."""
    crossing_ms: Milliseconds = 30.0
    """So long between the boxes is a swing ..."""
    next_ms: Milliseconds = 10.0
    """... and so long once there was one."""
    steady_ms: Annotated[float, Field(ge=10, le=200)] = 15.0
    """Or so long in steady motion."""
    least_slip_hz: Annotated[float, Field(ge=0.02, le=1)] = 0.15
    """What counts as motion."""
    unbalance_pu: Annotated[float, Field(gt=0.02, lt=1)] = 0.06
    """Of I1: above it I0 is a fault's, and I2 with what an estimator makes of the slip (0.15 at 7 Hz)
    added."""
    minimum_current_a: Positive | None = None
    """Of I1; below it there is no swing; 20 A primary where not given."""
    hold_ms: Milliseconds = 500.0
    """So long after the impedance has left the outer box, and has come to rest, the swing stands: where a
    stable one turns it is slow."""
    release_s: Seconds = 2.0
    """After so long in the outer box the zones are released."""
    trip: Literal["none", "way-in", "way-out"] = "none"
    """Out-of-step tripping, three-pole."""
    slips: Annotated[int, Field(ge=1, le=20)] = 1
    """How many pole slips until it trips on the way out."""

    @model_validator(mode="after")
    def _order(self) -> Rpsb:
        inner = self.inner_resistance_ohm
        if inner is not None and inner >= self.outer_resistance_ohm:
            raise ValueError(
                f"inner_resistance_ohm must be below outer_resistance_ohm, {self.outer_resistance_ohm:g}"
            )
        if self.total_ohm is not None and inner is not None:
            raise ValueError("give either inner_resistance_ohm or total_ohm, from which it follows")
        if self.slips > 1 and self.trip != "way-out":
            raise ValueError('slips belongs to trip = "way-out"')
        return self


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
