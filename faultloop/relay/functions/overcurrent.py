"""What the overcurrent functions share: which current, its direction, and when the stage is there at all.

Direction compares the current with a polarizing voltage that the fault does not take away:

- of a phase the voltage between the other two (quadrature), 90 degrees behind its own: a fault's current lies
  ahead of it, by 90 degrees less the angle of the fault's impedance;
- of 3 I0 the zero-sequence voltage, of I2 the negative-sequence one, each with its sign turned: for a fault
  ahead V0 = -Z0 I0 of the source behind, so the current lags -V0 by the angle of that impedance.

The characteristic angle is that of the greatest sensitivity, and the current may be `sector_deg` to either
side of it.  A three-phase fault close in leaves no voltage: then the one before the fault polarizes for as
long as the memory does, and the last direction stands after that.  (Horowitz and Phadke, Power System
Relaying, chapter 4; Ziegler, Numerical Distance Protection, section 3.1.)
"""

from __future__ import annotations

import cmath
import math
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field, model_validator

from faultloop.config.tables import Positive, Table
from faultloop.errors import InputError
from faultloop.jit import njit
from faultloop.relay.memory import size2
from faultloop.relay.quantities import Record

if TYPE_CHECKING:
    from faultloop.relay.settings import RelaySettings

PHASE, RESIDUAL, NEGATIVE = range(3)
QUANTITY = {"phase": PHASE, "residual": RESIDUAL, "negative-sequence": NEGATIVE}
QUADRATURE, ZERO_SEQUENCE, NEGATIVE_SEQUENCE = range(3)
_POLARIZATION = {
    "quadrature": QUADRATURE,
    "zero-sequence": ZERO_SEQUENCE,
    "negative-sequence": NEGATIVE_SEQUENCE,
}
_POLARIZED_BY = {
    "phase": ("quadrature",),
    "residual": ("zero-sequence", "negative-sequence"),
    "negative-sequence": ("negative-sequence",),
}
_DIRECTION = {"none": 0, "forward": 1, "reverse": -1}
QUADRATURE_ANGLE_DEG = 45.0


class Overcurrent(Table):
    """The keys that every stage of overcurrent has."""

    quantity: Literal["phase", "residual", "negative-sequence"] = "phase"
    """Each phase current by itself, 3I0, or I2."""
    pickup_a: Positive
    """Above it the stage starts."""
    dropout_ratio: Annotated[float, Field(ge=0.5, le=1)] = 0.95
    """Below this part of the pickup the start drops out."""
    direction: Literal["none", "forward", "reverse"] = "none"
    """Into the line, away from it, or both."""
    polarization: Literal["quadrature", "zero-sequence", "negative-sequence"] | None = None
    """Of a directional stage; "quadrature" of phases, of 3I0 and I2 by their own voltage where not given."""
    characteristic_angle_deg: Annotated[float, Field(ge=-90, le=90)] | None = None
    """Of quadrature: how far the current is ahead of the voltage, 45 where not given.  Of the others: how
    far it lags the turned voltage; the line's angle in that sequence where not given."""
    sector_deg: Annotated[float, Field(ge=30, le=90)] = 85.0
    """To either side of it."""
    minimum_polarizing_v: Positive | None = None
    """Below it the polarizing voltage says nothing; half of what counts as a dead phase where not given."""
    without_voltage: Literal["block", "non-directional"] = "block"
    """What a directional stage does while the voltage transformer's fuse has failed (`[tvtr]`)."""
    when: Literal["always", "fuse-failure"] = "always"
    """"fuse-failure": an emergency stage, there only while `[tvtr]` has taken the distance zones away, or
    while no phase's voltage is proven: all three were lost without load, or have never been there."""

    @model_validator(mode="after")
    def _directional(self) -> Overcurrent:
        given = self.polarization
        if self.direction == "none":
            if given is not None or self.characteristic_angle_deg is not None:
                raise ValueError(
                    'polarization and characteristic_angle_deg belong to direction = "forward" or "reverse"'
                )
        elif given is not None and given not in _POLARIZED_BY[self.quantity]:
            right = " or ".join(f'"{name}"' for name in _POLARIZED_BY[self.quantity])
            raise ValueError(f'quantity = "{self.quantity}" is polarized by {right}, not by "{given}"')
        return self


CONSTANTS = (
    ("quantity", "i8"),
    ("pickup", "f8"),
    ("dropout", "f8"),
    ("direction", "i8"),
    ("polarization", "i8"),
    ("turn", "c16"),  # of the polarizing voltage onto the current at the characteristic angle
    ("sector", "f8"),  # cosine
    ("polarizing", "f8"),  # least voltage [V]
    ("blind", "i8"),  # goes on without direction while the fuse has failed
    ("emergency", "i8"),
)
STATE = (("last", "i8", (3,)),)  # direction, of each phase


def values(settings: RelaySettings, table: Overcurrent) -> dict[str, Any]:
    """`CONSTANTS` in primary values."""
    polarization = table.polarization or _POLARIZED_BY[table.quantity][0]
    angle = table.characteristic_angle_deg
    if polarization == "quadrature":
        turn = math.radians(QUADRATURE_ANGLE_DEG if angle is None else angle)
    else:
        line = settings.z0_ohm if polarization == "zero-sequence" else settings.z1_ohm
        turn = math.pi - (cmath.phase(line) if angle is None else math.radians(angle))
    return {
        "quantity": QUANTITY[table.quantity],
        "pickup": settings.amperes(table.pickup_a, 0.0),
        "dropout": table.dropout_ratio,
        "direction": _DIRECTION[table.direction],
        "polarization": _POLARIZATION[polarization],
        "turn": cmath.rect(1.0, turn),
        "sector": math.cos(math.radians(table.sector_deg)),
        "polarizing": settings.volts(table.minimum_polarizing_v, 0.0),
        "blind": table.without_voltage == "non-directional",
        "emergency": table.when == "fuse-failure",
    }


def check(settings: RelaySettings, key: str) -> None:
    """An emergency stage needs the function that releases it."""
    for number, table in enumerate(getattr(settings, key), 1):
        if table.when == "fuse-failure" and settings.tvtr is None:
            what = 'when = "fuse-failure" needs the table [tvtr], which finds the failure'
            raise InputError(what, key=f"{key}[{number}].when")


@njit
def operating_current(q: Record, c: Record, k: int) -> complex:
    """Of phase k, or 3I0, or I2."""
    if c.quantity == PHASE:
        return q.x[3 + k]
    return 3 * q.sequence[3] if c.quantity == RESIDUAL else q.sequence[5]


@njit
def polarizing_voltage(g: Record, q: Record, c: Record, k: int) -> complex:
    """Of phase k, as it is, or from before the fault where it is too small; 0 where there is none."""
    least2 = (c.polarizing if c.polarizing > 0.0 else 0.5 * g.minimum_voltage) ** 2
    if c.polarization == ZERO_SEQUENCE:
        v = q.sequence[0]
    elif c.polarization == NEGATIVE_SEQUENCE:
        v = q.sequence[2]
    else:
        v = q.x[(k + 1) % 3] - q.x[(k + 2) % 3]
        if size2(v) < least2 and q.disturbed and q.memory.age <= g.memory:
            v = q.memory.reference[(k + 1) % 3] - q.memory.reference[(k + 2) % 3]
    return v if size2(v) >= least2 else complex(0.0, 0.0)


@njit
def is_ahead(g: Record, q: Record, c: Record, w: Record, k: int) -> int:
    """Direction of a current: 1 forward, -1 reverse, 0 on the border; the last one where no voltage is
    left."""
    i = q.x[3 + k]
    if c.polarization != QUADRATURE:  # each sequence against its own voltage, whatever is measured
        i = q.sequence[3] if c.polarization == ZERO_SEQUENCE else q.sequence[5]
    v = polarizing_voltage(g, q, c, k) * c.turn
    size = math.sqrt(size2(v) * size2(i))
    if size > 0.0:
        along = (v.real * i.real + v.imag * i.imag) / size
        w.last[k] = 1 if along > c.sector else -1 if along < -c.sector else 0
    elif c.polarization != QUADRATURE or not q.disturbed:
        w.last[k] = 0
    return w.last[k]


@njit
def multiple(g: Record, q: Record, c: Record, w: Record, k: int) -> float:
    """A current over the pickup, 0 where the stage has nothing to do with it."""
    if c.emergency and not q.fuse_failure and q.proven:
        return 0.0
    if c.quantity != PHASE and q.missing:  # a current that is missing makes a residual of its own
        return 0.0
    m = math.sqrt(size2(operating_current(q, c, k))) / c.pickup
    if c.direction == 0 or m < c.dropout:
        return m
    if q.fuse_failure:
        return m if c.blind else 0.0
    return m if is_ahead(g, q, c, w, k) == c.direction else 0.0
