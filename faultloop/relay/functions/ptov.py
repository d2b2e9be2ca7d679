"""PTOV: overvoltage, definite time; the residual voltage 3V0 for earth faults where no current flows, and
V2."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field

from faultloop.config.tables import Milliseconds, Positive, Table
from faultloop.jit import njit
from faultloop.relay.functions.function import Function
from faultloop.relay.functions.ptuv import PHASE_PHASE, QUANTITY, RESIDUAL, count_up, voltage
from faultloop.relay.quantities import Record

if TYPE_CHECKING:
    from faultloop.relay.settings import RelaySettings


class Ptov(Table):
    """``[[ptov]]``: one stage of overvoltage."""

    quantity: Literal["phase", "phase-phase", "positive-sequence", "residual", "negative-sequence"] = "phase"
    """Each phase to ground, each pair of phases, V1, 3V0, or V2."""
    start_v: Positive
    """Above it the stage starts."""
    dropout_ratio: Annotated[float, Field(ge=0.5, le=1)] = 0.97
    """Below this part of it the start drops out."""
    phases: Literal["any", "all"] = "any"
    """How many of the three must be high."""
    delay_ms: Milliseconds = 500.0
    """From start to operate."""
    trip: bool = True
    """Whether its operate trips."""


def values(settings: RelaySettings, table: Ptov) -> dict[str, Any]:
    """The stage in primary volts and samples."""
    return {
        "quantity": QUANTITY[table.quantity],
        "start": settings.volts(table.start_v, 0.0),
        "dropout": table.dropout_ratio,
        "all": table.phases == "all",
        "delay": settings.samples(table.delay_ms),
        "trips": table.trip,
    }


@njit
def is_high(c: Record, w: Record, q: Record) -> bool:
    """Whether as many voltages as must be are above the start, or, once started, above the dropout."""
    limit = c.start * c.dropout if w.started else c.start
    high, count = 0, 3 if c.quantity <= PHASE_PHASE else 1
    for k in range(count):
        if voltage(q, c.quantity, k) > limit:
            high += 1
    return high == count if c.all else high > 0


@njit
def step(g: Record, q: Record, c: Record, w: Record) -> None:
    """One sample of a stage.  A blown fuse makes a residual and a negative-sequence voltage of nothing."""
    if q.settled:
        count_up(q, c, w, not (q.fuse_failure and c.quantity >= RESIDUAL) and is_high(c, w, q))


PTOV = Function(
    name="PTOV",
    settings=Ptov,
    step=step,
    constants=(
        ("quantity", "i8"),
        ("start", "f8"),
        ("dropout", "f8"),
        ("all", "i8"),
        ("delay", "i8"),
        ("trips", "i8"),
    ),
    values=values,
    state=(("started", "i8"), ("age", "i8")),
    most=4,
)
