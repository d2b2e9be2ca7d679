"""Zones as RIO (family TESTOBJECT), for test sets: each by its corners in the impedance plane."""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from faultloop.relay.functions.pdis import Pdis, polygons, reach_ohm
from faultloop.relay.settings import RelaySettings


def rio_text(settings: RelaySettings, name: str) -> str:
    """All zones of a relay, in primary ohms.

    A mho is a MHOSHAPE, self-polarized as it is drawn; a quadrilateral its half-planes.
    """
    z1, k0 = settings.z1_ohm, settings.residual_compensation_factor
    head = settings.relay
    ct, vt = head.ct_ratio or 1.0, head.vt_ratio or 1.0
    nominal = 1000 * head.nominal_kv if head.nominal_kv else 100.0 * vt
    lines = [
        "BEGIN TESTOBJECT",
        "  BEGIN DEVICE",
        f"    NAME {name}",
        f"    VNOM {nominal / vt:.6g}",
        f"    VPRIM-LL {nominal:.6g}",
        "    INOM 1",
        f"    IPRIM {ct:.6g}",
        f"    FNOM {head.frequency_hz:g}",
        "  END DEVICE",
        "  BEGIN DISTANCE",
        f"    LINEANGLE {math.degrees(cmath.phase(z1)):.9g}",
        "    IMPPRIM YES",
        f"    KL {abs(k0):.9g},{math.degrees(cmath.phase(k0)):.9g}",
    ]
    index = 0
    for zone in settings.pdis:
        for loops, points in zip(("LN", "LL"), polygons(settings, zone), strict=True):
            if len(points):
                index += 1
                lines += _zone(settings, zone, index, loops, points[:, 0] + 1j * points[:, 1])
    return "\n".join([*lines, "  END DISTANCE", "END TESTOBJECT", ""])


def _zone(
    settings: RelaySettings, zone: Pdis, index: int, loops: str, corners: NDArray[np.complex128]
) -> Iterator[str]:
    own = zone.delay_ground_ms if loops == "LN" else zone.delay_phase_ms
    delay_ms = zone.delay_ms if own is None else own
    trips = zone.zone in settings.ptrc.zones
    yield "    BEGIN ZONE"
    yield f"      INDEX {zone.zone}"
    yield f"      LABEL Z{zone.zone} {loops} {index}"
    yield f"      TYPE {'TRIPPING' if trips else 'NONTRIPPING'}"
    yield f"      FAULTLOOP {loops}"
    yield f"      TRIPTIME {delay_ms / 1e3:.9g}"
    yield "      ACTIVE YES"
    if zone.characteristic == "mho" and zone.direction != "none":
        reach = reach_ohm(settings, zone) * (-1 if zone.direction == "reverse" else 1)
        yield "      BEGIN MHOSHAPE"
        yield f"        ANGLE {math.degrees(cmath.phase(reach)):.9g}"
        yield f"        REACH {abs(reach):.9g}"
        yield "        OFFSET 0"
        yield "      END MHOSHAPE"
    else:
        yield "      BEGIN SHAPE"
        side = _side(corners)
        for a, b in pairwise(corners.tolist()):
            if a != b:
                degrees = math.degrees(cmath.phase(b - a))
                yield f"        LINE {a.real:.9g},{a.imag:.9g},{degrees:.9g},{side}"
        yield "      END SHAPE"
    yield "    END ZONE"


def _side(corners: NDArray[np.complex128]) -> str:
    """Where the inside of a closed polygon is."""
    area = np.imag(np.conj(corners[:-1]) * corners[1:]).sum()
    return "LEFT" if area > 0 else "RIGHT"
