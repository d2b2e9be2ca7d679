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
    along = complex(1 - slope * reach.real / reach.imag, -slope)  # the reactance line, per ohm of resistance
    right, left = reach + resistance * along, reach - resistance * along
    if zone.direction == "none":
        return np.array([right, left, -right, -left, right])
    low = -math.tan(math.radians(settings.rdir.minimum_angle_deg)) * resistance
    border = complex(np.exp(1j * math.radians(settings.rdir.maximum_angle_deg)))
    if _cross(left, border) > 0:  # the left blinder comes first; it goes down to the directional border
        corners = [left, left - reach * _cross(left, border) / _cross(reach, border)]
    else:
        corners = [reach - along * _cross(reach, border) / _cross(along, border)]
    return np.array([0j, complex(resistance, low), right, *corners, 0j])


def _cross(a: complex, b: complex) -> float:
    """Positive where b is to the left of a."""
    return a.real * b.imag - a.imag * b.real
