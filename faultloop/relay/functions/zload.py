"""ZLOAD: load encroachment.

A heavy load is an impedance well inside a long zone, but at a small angle, where no fault on the line
is.  Two sectors of the R-X plane, `angle_deg` to either side of the resistive axis and beyond
`resistance_ohm`, one ahead and one behind, are cut out of the phase loops while V1 / I1 is in one of them
and the currents are balanced.  (SEL-421, ABB 670 (RLd, ArgLd); NERC PRC-023 asks for 150 % of the highest
rating at 0.85 of the voltage and 30 degrees.)

A fault between two phases is not balanced, and a fault to ground has ground loops: they are not blocked.  A
three-phase fault with an arc stays out of the sectors, as an arc of a few ohm does not reach
`resistance_ohm`.

There is no logical node of the kind in IEC 61850-7-4: the name is an extension.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import Field

from faultloop.config.tables import Positive, Table
from faultloop.errors import InputError
from faultloop.jit import njit
from faultloop.relay.functions.function import Function, Polygon
from faultloop.relay.memory import size2
from faultloop.relay.quantities import Record, indicate

if TYPE_CHECKING:
    from faultloop.relay.settings import RelaySettings

PHASE_LOOPS = 0b111000
DRAWN = 3.0
"""Times the resistance: so far the sectors are drawn, which have no end."""


class Zload(Table):
    """``[zload]``: load encroachment; the impedances of loads are cut out of the phase loops."""

    resistance_ohm: Positive
    """The least load, at no angle, in size."""
    reverse_resistance_ohm: Positive | None = None
    """The same of a load that comes towards the relay; as ahead where not given."""
    angle_deg: Annotated[float, Field(gt=0, lt=60)] = 30.0
    """To either side of the resistive axis."""
    unbalance_pu: Annotated[float, Field(gt=0.02, lt=1)] = 0.2
    """I2 or I0 above this part of I1 is a fault's."""


def values(settings: RelaySettings, table: Zload) -> dict[str, Any]:
    """Primary."""
    reverse = table.reverse_resistance_ohm or table.resistance_ohm
    return {
        "forward": table.resistance_ohm * settings.ohm_ratio,
        "reverse": reverse * settings.ohm_ratio,
        "slope": math.tan(math.radians(table.angle_deg)),
        "unbalance": table.unbalance_pu,
    }


def check(settings: RelaySettings) -> None:
    """The sectors leave the line's own impedances alone."""
    table: Any = settings.zload
    line = math.degrees(np.angle(settings.z1_ohm))
    if table.angle_deg >= line - 10:
        what = f"must be 10 degrees below the line's angle, {line:.3g}: the sectors would cut out its faults"
        raise InputError(what, key="zload.angle_deg")


def is_in_area(settings: RelaySettings, table: Zload, ohm: complex) -> bool:
    """Whether a load's primary impedance, into the line, is in one of the sectors."""
    c = values(settings, table)
    least = c["forward"] if ohm.real >= 0 else c["reverse"]
    return abs(ohm) > least and abs(ohm.imag) < c["slope"] * abs(ohm.real)


@njit
def is_load(q: Record, c: Record) -> bool:
    """Whether V1 / I1 is a load's and the currents are balanced."""
    i1 = q.sequence[4]
    size = size2(i1)
    limit = c.unbalance**2 * size
    if size == 0.0 or size2(q.sequence[5]) > limit or size2(q.sequence[3]) > limit:
        return False
    z = q.sequence[1] * i1.conjugate() / size
    least = c.forward if z.real >= 0.0 else c.reverse
    return size2(z) > least * least and abs(z.imag) < c.slope * abs(z.real)


@njit
def step(g: Record, q: Record, c: Record, w: Record) -> None:
    """One sample."""
    load = is_load(q, c)
    if load:
        q.blocked_loops |= PHASE_LOOPS
    indicate(q, c.bit, load)


def polygons(settings: RelaySettings, table: Zload) -> tuple[Polygon, Polygon]:
    """Both sectors as one line through the origin's two sides, of the phase loops, primary ohm."""
    c = values(settings, table)
    half = math.atan(c["slope"])
    points = []
    for size, side in ((c["forward"], 1), (c["reverse"], -1)):
        arc = side * size * np.exp(1j * np.linspace(-half, half, 13))
        points += [DRAWN * arc[0], *arc, DRAWN * arc[-1]]
    points.append(points[0])
    line = np.array(points, np.complex128)
    return np.empty((0, 2)), np.column_stack([np.real(line), np.imag(line)])


ZLOAD = Function(
    name="ZLOAD",
    settings=Zload,
    step=step,
    constants=(("forward", "f8"), ("reverse", "f8"), ("slope", "f8"), ("unbalance", "f8")),
    values=values,
    bits=("Blk",),
    told=False,
    polygons=polygons,
    check=check,
)
