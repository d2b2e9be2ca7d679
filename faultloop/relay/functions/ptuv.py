"""PTUV: undervoltage, definite time.

A voltage that has gone altogether is a dead line or a transformer without one, not an undervoltage: below
``minimum_v`` a stage does not start, unless it is set to ``trip_without_voltage``.  On its way there a
voltage passes through the range of the stage, so its delay must be longer than an estimator takes to fall:
two cycles.  A fuse that `[tvtr]` has found blown blocks the stage.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator

from faultloop.config.tables import Milliseconds, Positive, Table
from faultloop.errors import InputError
from faultloop.jit import njit
from faultloop.relay.functions.function import Function
from faultloop.relay.memory import size2
from faultloop.relay.quantities import Record, publish, request_trip

if TYPE_CHECKING:
    from faultloop.relay.settings import RelaySettings

PHASE, PHASE_PHASE, POSITIVE_SEQUENCE, RESIDUAL, NEGATIVE_SEQUENCE = range(5)
QUANTITY = {
    "phase": PHASE,
    "phase-phase": PHASE_PHASE,
    "positive-sequence": POSITIVE_SEQUENCE,
    "residual": RESIDUAL,
    "negative-sequence": NEGATIVE_SEQUENCE,
}
LEAST_CYCLES = 2


class Ptuv(Table):
    """``[[ptuv]]``: one stage of undervoltage."""

    quantity: Literal["phase", "phase-phase", "positive-sequence"] = "phase"
    """Each phase to ground, each pair of phases, or V1 (a phase-to-ground value)."""
    start_v: Positive
    """Below it the stage starts."""
    dropout_ratio: Annotated[float, Field(ge=1, le=1.5)] = 1.03
    """Above this part of it the start drops out."""
    phases: Literal["any", "all"] = "any"
    """How many of the three must be low."""
    delay_ms: Milliseconds = 500.0
    """From start to operate; two cycles at least, unless `trip_without_voltage`."""
    minimum_v: Positive | None = None
    """Below it there is no voltage; what counts as a dead phase where not given."""
    trip_without_voltage: bool = False
    """No voltage is an undervoltage, too."""
    trip: bool = True
    """Whether its operate trips."""

    @model_validator(mode="after")
    def _order(self) -> Ptuv:
        if self.minimum_v is not None and self.minimum_v >= self.start_v:
            raise ValueError(f"minimum_v must be below start_v, {self.start_v:g} V")
        return self


def values(settings: RelaySettings, table: Ptuv) -> dict[str, Any]:
    """The stage in primary volts and samples."""
    return {
        "quantity": QUANTITY[table.quantity],
        "start": settings.volts(table.start_v, 0.0),
        "dropout": table.dropout_ratio,
        "all": table.phases == "all",
        "delay": settings.samples(table.delay_ms),
        "minimum": settings.volts(table.minimum_v, 0.0),
        "dead_too": table.trip_without_voltage,
        "trips": table.trip,
    }


def check(settings: RelaySettings) -> None:
    """A delay that a vanishing voltage does not outlast."""
    least = 1000 * LEAST_CYCLES / settings.relay.frequency_hz
    for number, table in enumerate(settings.ptuv, 1):
        if table.delay_ms < least and not table.trip_without_voltage:
            what = (
                f"must be at least {least:.3g} ms, two cycles: a voltage that vanishes passes "
                "through the stage; or say trip_without_voltage = true"
            )
            raise InputError(what, key=f"ptuv[{number}].delay_ms")


@njit
def voltage(q: Record, quantity: int, k: int) -> float:
    """Size of a measured voltage [V]."""
    if quantity == PHASE:
        v = q.x[k]
    elif quantity == PHASE_PHASE:
        v = q.x[k] - q.x[(k + 1) % 3]
    elif quantity == POSITIVE_SEQUENCE:
        v = q.sequence[1]
    elif quantity == RESIDUAL:
        v = 3 * q.sequence[0]
    else:
        v = q.sequence[2]
    return np.sqrt(size2(v))


@njit
def is_low(g: Record, q: Record, c: Record, w: Record) -> bool:
    """Whether as many voltages as must be are below the start, or, once started, below the dropout."""
    least = c.minimum if c.minimum > 0.0 else g.minimum_voltage
    limit = c.start * c.dropout if w.started else c.start
    low, count = 0, 3 if c.quantity <= PHASE_PHASE else 1
    for k in range(count):
        v = voltage(q, c.quantity, k)
        if v < limit and (v >= least or c.dead_too):
            low += 1
    return low == count if c.all else low > 0


@njit
def count_up(q: Record, c: Record, w: Record, started: bool) -> None:
    """Start, timer, operate of a stage of definite time."""
    w.age = w.age + 1 if started and w.started else 0
    w.started = 1 if started else 0
    operated = started and w.age >= c.delay
    publish(q, c.bit, started, operated)
    if operated and c.trips:
        request_trip(q, c.bit, q.fault, 1)


@njit
def step(g: Record, q: Record, c: Record, w: Record) -> None:
    """One sample of a stage."""
    if q.settled:
        count_up(q, c, w, not q.fuse_failure and is_low(g, q, c, w))


PTUV = Function(
    name="PTUV",
    settings=Ptuv,
    step=step,
    constants=(
        ("quantity", "i8"),
        ("start", "f8"),
        ("dropout", "f8"),
        ("all", "i8"),
        ("delay", "i8"),
        ("minimum", "f8"),  # 0: the relay's minimum voltage
        ("dead_too", "i8"),
        ("trips", "i8"),
    ),
    values=values,
    state=(("started", "i8"), ("age", "i8")),
    most=4,
    check=check,
)
