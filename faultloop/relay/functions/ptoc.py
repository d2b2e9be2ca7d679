"""PTOC: time overcurrent with the curves of IEC 60255-151, IEEE C37.112 and of makers.

Above the pickup, M = I / pickup > 1, the curve gives the operating time, for a constant current

    t = T (k / (M^a - 1) + c)          IEC, IEEE, US
    t = T / (0.339 - 0.236 / M)        RI
    t = T (5.8 - 1.35 ln M)            RD (logarithmic)

with T the time multiplier (the time dial).  For any current the relay adds up progress, dp = dt / t(M), and
operates at p = 1 (IEEE C37.112-2018, eq. 3).  Below the pickup an induction disc turns back,
dp = -dt / (T r / (1 - M^b)); other resets are at once, or after a time in which the progress stands.
Beyond ``maximum_multiple`` the time is that of there.  Which current, its direction, and when the stage is
there: `faultloop.relay.functions.overcurrent`.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field, model_validator

from faultloop.config.tables import Milliseconds
from faultloop.jit import njit
from faultloop.relay.functions import overcurrent
from faultloop.relay.functions.function import Function
from faultloop.relay.functions.overcurrent import PHASE, Overcurrent, multiple
from faultloop.relay.quantities import Record, publish, request_trip

if TYPE_CHECKING:
    from faultloop.relay.settings import RelaySettings

MAX_STAGES = 8
DEFINITE, POWER, RI, RD = range(4)
AT_ONCE, STANDS, DISC = range(3)
DONE = 1 - 1e-9
"""Of the progress: as many steps as make the time add up to it, but for their rounding."""

Curve = Literal[
    "definite-time",
    "iec-normal-inverse",
    "iec-very-inverse",
    "iec-extremely-inverse",
    "iec-long-time-inverse",
    "iec-short-time-inverse",
    "ieee-moderately-inverse",
    "ieee-very-inverse",
    "ieee-extremely-inverse",
    "us-moderately-inverse",
    "us-inverse",
    "us-very-inverse",
    "us-extremely-inverse",
    "us-short-time-inverse",
    "uk-rectifier",
    "ri",
    "rd",
]
NAN = math.nan
CURVES: dict[str, tuple[int, float, float, float, float, float]] = {
    # kind, k [s], a, c [s]; disc reset r [s], b
    "definite-time": (DEFINITE, 0.0, 0.0, 0.0, NAN, NAN),
    "iec-normal-inverse": (POWER, 0.14, 0.02, 0.0, 13.5, 2.0),  # IEC A
    "iec-very-inverse": (POWER, 13.5, 1.0, 0.0, 47.3, 2.0),  # IEC B
    "iec-extremely-inverse": (POWER, 80.0, 2.0, 0.0, 80.0, 2.0),  # IEC C
    "iec-long-time-inverse": (POWER, 120.0, 1.0, 0.0, 120.0, 1.0),
    "iec-short-time-inverse": (POWER, 0.05, 0.04, 0.0, 4.85, 2.0),
    "ieee-moderately-inverse": (POWER, 0.0515, 0.02, 0.114, 4.85, 2.0),  # IEC D
    "ieee-very-inverse": (POWER, 19.61, 2.0, 0.491, 21.6, 2.0),  # IEC E
    "ieee-extremely-inverse": (POWER, 28.2, 2.0, 0.1217, 29.1, 2.0),  # IEC F
    "us-moderately-inverse": (POWER, 0.0104, 0.02, 0.0226, 1.08, 2.0),  # U1
    "us-inverse": (POWER, 5.95, 2.0, 0.180, 5.95, 2.0),  # U2
    "us-very-inverse": (POWER, 3.88, 2.0, 0.0963, 3.88, 2.0),  # U3
    "us-extremely-inverse": (POWER, 5.67, 2.0, 0.0352, 5.67, 2.0),  # U4
    "us-short-time-inverse": (POWER, 0.00342, 0.02, 0.00262, 0.323, 2.0),  # U5
    "uk-rectifier": (POWER, 45900.0, 5.6, 0.0, NAN, NAN),
    "ri": (RI, 0.0, 0.0, 0.0, NAN, NAN),
    "rd": (RD, 0.0, 0.0, 0.0, NAN, NAN),
}
_RESET = {"instantaneous": AT_ONCE, "definite-time": STANDS, "disc": DISC}


class Ptoc(Overcurrent):
    """``[[ptoc]]``: one stage of time overcurrent."""

    curve: Curve = "definite-time"
    """Operating time over current; docs/relay.md has the formulas."""
    time_multiplier: Annotated[float, Field(ge=0.01, le=100)] | None = None
    """Of an inverse curve: multiplies its times (time dial); 1 where not given."""
    delay_ms: Milliseconds | None = None
    """Of definite time: from start to operate; 0 where not given."""
    minimum_time_ms: Milliseconds = 0.0
    """Not sooner than this after the start, whatever the curve says."""
    maximum_multiple: Annotated[float, Field(ge=2, le=100)] = 20.0
    """Beyond this multiple of the pickup an inverse curve is flat."""
    reset: Literal["instantaneous", "definite-time", "disc"] = "instantaneous"
    """What becomes of the progress below the pickup."""
    reset_ms: Milliseconds | None = None
    """Of reset "definite-time": how long the progress stands before it is forgotten."""
    trip: bool = True
    """Whether its operate trips."""

    @model_validator(mode="after")
    def _whole(self) -> Ptoc:
        definite = self.curve == "definite-time"
        if definite and self.time_multiplier is not None:
            raise ValueError("time_multiplier belongs to an inverse curve; definite time has delay_ms")
        if not definite and self.delay_ms is not None:
            raise ValueError(f'delay_ms belongs to curve = "definite-time", not to "{self.curve}"')
        if (self.reset == "definite-time") != (self.reset_ms is not None):
            raise ValueError('reset = "definite-time" and reset_ms go together')
        if self.reset == "disc" and math.isnan(CURVES[self.curve][4]):
            raise ValueError(
                f'curve "{self.curve}" has no disc reset; use "instantaneous" or "definite-time"'
            )
        return self


def values(settings: RelaySettings, table: Ptoc) -> dict[str, Any]:
    """The stage in primary amperes, seconds and samples."""
    kind, k, a, c, r, b = CURVES[table.curve]
    if kind == DEFINITE:
        c = (table.delay_ms or 0.0) / 1000
    return overcurrent.values(settings, table) | {
        "kind": kind,
        "k": k,
        "a": a,
        "c": c,
        "r": r,
        "b": b,
        "multiplier": table.time_multiplier or 1.0,
        "flat": table.maximum_multiple,
        "minimum": settings.samples(table.minimum_time_ms),
        "reset": _RESET[table.reset],
        "stands": settings.samples(table.reset_ms or 0.0),
        "trips": table.trip,
    }


def check(settings: RelaySettings) -> None:
    """Of every stage."""
    overcurrent.check(settings, "ptoc")


@njit
def operating_time(c: Record, m: float) -> float:
    """Seconds to operate at a constant multiple of the pickup, m > 1."""
    m = min(m, c.flat)
    if c.kind == POWER:
        return c.multiplier * (c.k / (m**c.a - 1.0) + c.c)
    if c.kind == RI:
        return c.multiplier / (0.339 - 0.236 / m)
    if c.kind == RD:
        return c.multiplier * (5.8 - 1.35 * math.log(m))
    return c.c


@njit
def reset_time(c: Record, m: float) -> float:
    """Seconds in which a disc turns back all the way at a constant multiple m < 1."""
    return c.multiplier * c.r / (1.0 - m**c.b)


@njit
def back(g: Record, c: Record, w: Record, k: int, m: float) -> None:
    """One sample below the pickup."""
    w.still[k] += 1
    if c.reset == DISC:
        if m < 1.0:
            w.progress[k] = max(w.progress[k] - 1.0 / (g.sampling * reset_time(c, m)), 0.0)
    elif w.started[k] == 0 and (c.reset == AT_ONCE or w.still[k] > c.stands):
        w.progress[k] = 0.0


@njit
def compare(g: Record, c: Record, w: Record, k: int, m: float) -> None:
    """One sample of one current, as a multiple of the pickup."""
    if m > 1.0:
        time = operating_time(c, m)
        if time <= 0.0:
            w.progress[k] = 1.0
        elif w.started[k]:
            w.progress[k] = min(w.progress[k] + 1.0 / (g.sampling * time), 1.0)
        w.age[k] = w.age[k] + 1 if w.started[k] else 0
        w.started[k] = 1
        w.still[k] = 0
    else:
        if m < c.dropout:
            w.started[k] = 0
            w.operated[k] = 0
        back(g, c, w, k, m)
    if w.started[k] and w.progress[k] >= DONE and w.age[k] >= c.minimum:
        w.operated[k] = 1


@njit
def step(g: Record, q: Record, c: Record, w: Record) -> None:
    """One sample of a stage."""
    if not q.settled:
        return
    for k in range(3 if c.quantity == PHASE else 1):
        compare(g, c, w, k, multiple(g, q, c, w, k))
    operated = w.operated[0] or w.operated[1] or w.operated[2]
    publish(q, c.bit, w.started[0] or w.started[1] or w.started[2], operated)
    if operated and c.trips:
        request_trip(q, c.bit, q.fault, 1)


PTOC = Function(
    name="PTOC",
    settings=Ptoc,
    step=step,
    constants=(
        *overcurrent.CONSTANTS,
        ("kind", "i8"),
        ("k", "f8"),
        ("a", "f8"),
        ("c", "f8"),  # of definite time the delay [s]
        ("r", "f8"),
        ("b", "f8"),
        ("multiplier", "f8"),
        ("flat", "f8"),
        ("minimum", "i8"),
        ("reset", "i8"),
        ("stands", "i8"),
        ("trips", "i8"),
    ),
    values=values,
    state=(
        *overcurrent.STATE,
        ("progress", "f8", (3,)),
        ("started", "i8", (3,)),
        ("operated", "i8", (3,)),
        ("age", "i8", (3,)),  # samples above the pickup since the start
        ("still", "i8", (3,)),  # samples since it was above the pickup
    ),
    most=MAX_STAGES,
    check=check,
)
