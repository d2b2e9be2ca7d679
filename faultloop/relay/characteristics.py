"""The zones as polygons in the R-X plane, for people to look at: primary ohm, static.

A mho is drawn self-polarized (polarized by memory or across it grows towards the source behind), a quad
without load flow.  The decisions are made in ``pdis``, not with these.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from faultloop.relay.settings import Pdis, RelaySettings

Polygon = NDArray[np.float64]
POINTS = 73


def characteristics(settings: RelaySettings) -> dict[str, tuple[Polygon, Polygon]]:
    """Closed polygons (k, 2) of (r, x) per zone, for ground loops and for phase loops; empty if unused."""
    result = {}
    for number, zone in enumerate(settings.pdis, 1):
        ground, phase = _polygon(settings, zone, True), _polygon(settings, zone, False)
        empty = np.empty((0, 2))
        result[f"PDIS{number}"] = (
            ground if zone.loops != "phase" else empty,
            phase if zone.loops != "ground" else empty,
        )
    return result


def _polygon(settings: RelaySettings, zone: Pdis, ground: bool) -> Polygon:
    reach = settings.reach_ohm(zone)
    if zone.characteristic == "mho":
        turn = np.exp(2j * np.pi * np.linspace(0, 1, POINTS))
        points = reach * turn if zone.direction == "none" else reach / 2 * (1 + turn)
    else:
        points = _quad(settings, zone, reach, ground)
    if zone.direction == "reverse":
        points = -points
    return np.column_stack([points.real, points.imag])


def _quad(settings: RelaySettings, zone: Pdis, reach: complex, ground: bool) -> NDArray[np.complex128]:
    resistance = (zone.resistive_reach_ohm or 0.0) * settings.ohm_ratio
    if ground:
        if zone.resistive_reach_ground_ohm is not None:
            resistance = zone.resistive_reach_ground_ohm * settings.ohm_ratio
        # In the loop's plane a resistance to ground is divided by 1 + k0 (no infeed from the far end).
        resistance /= abs(1 + settings.residual_compensation_factor)
    slope = math.tan(math.radians(zone.tilt_deg))
    top_right = reach + _along(resistance, slope, reach)
    top_left = reach + _along(-resistance, slope, reach)
    if zone.direction == "none":
        corners = [top_right, top_left, -top_right, -top_left]
    else:
        low = -math.tan(math.radians(settings.rdir.minimum_angle_deg)) * resistance
        left = complex(0, reach.imag) / math.tan(math.radians(settings.rdir.maximum_angle_deg))
        left_foot = max(top_left.real, left.real)
        corners = [0j, complex(resistance, low), top_right, complex(left_foot, top_left.imag), 0j]
    corners.append(corners[0])
    return np.array(corners)


def _along(resistance: float, slope: float, reach: complex) -> complex:
    """From the reach point along the tilted reactance line to the blinder ``resistance`` away."""
    x = -slope * resistance
    return complex(resistance + x * reach.real / reach.imag, x)
