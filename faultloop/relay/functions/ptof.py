"""PTOF: overfrequency; and what it shares with PTUF (underfrequency).

The frequency is that of the positive-sequence voltage's turn (`faultloop.relay.loops`), or the estimator's
own.  A jump of the phase, as every fault and switching makes, is a frequency of several hertz for a cycle
and for as long as the estimator takes: so three cycles beyond the limit are what it takes to operate,
whatever the delay.  Without a voltage there is no frequency: below ``minimum_v``, and while the fuse has
failed, the stage rests.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field

from faultloop.config.tables import Milliseconds, Positive, Table
from faultloop.errors import InputError
from faultloop.jit import njit
from faultloop.relay.functions.function import Function
from faultloop.relay.memory import size2
from faultloop.relay.quantities import Record, publish, request_trip

if TYPE_CHECKING:
    from faultloop.relay.settings import RelaySettings

JUMP_CYCLES = 3
FARTHEST = 0.1
"""Of the nominal frequency: beyond it no phasor is one."""


class FrequencyStage(Table):
    """The keys of both."""

    start_hz: Positive
    """The limit."""
    dropout_hz: Annotated[float, Field(ge=0, le=1)] = 0.05
    """How far back the frequency must be for the start to drop out."""
    delay_ms: Milliseconds = 200.0
    """From start to operate; three cycles at least."""
    minimum_v: Positive | None = None
    """Of V1 (phase to ground): below it there is no frequency; what counts as a dead phase where not
    given."""
    trip: bool = True
    """Whether its operate trips."""


class Ptof(FrequencyStage):
    """``[[ptof]]``: one stage of overfrequency."""


def values(settings: RelaySettings, table: FrequencyStage) -> dict[str, Any]:
    """The stage in samples."""
    least = JUMP_CYCLES * settings.relay.sampling_hz / settings.relay.frequency_hz
    return {
        "start": table.start_hz,
        "dropout": table.dropout_hz,
        "delay": max(settings.samples(table.delay_ms), round(least)),
        "minimum": settings.volts(table.minimum_v, 0.0),
        "trips": table.trip,
    }


def check_side(settings: RelaySettings, key: str, side: int) -> None:
    """The limit of each stage is on its side of the nominal frequency, and not out of reach."""
    nominal = settings.relay.frequency_hz
    for number, table in enumerate(getattr(settings, key), 1):
        beyond = side * (table.start_hz - nominal)
        if not 0 < beyond <= FARTHEST * nominal:
            low, high = sorted((nominal, nominal * (1 + side * FARTHEST)))
            what = f"must be between {low:g} and {high:g} Hz, not {table.start_hz:g}"
            raise InputError(what, key=f"{key}[{number}].start_hz")


def check(settings: RelaySettings) -> None:
    """Of every stage."""
    check_side(settings, "ptof", 1)


@njit
def is_measured(g: Record, q: Record, minimum: float) -> bool:
    """Whether there is a voltage that has a frequency."""
    least = minimum if minimum > 0.0 else g.minimum_voltage
    there = q.settled and not q.fuse_failure and size2(q.sequence[1]) >= least**2
    return there and q.frequency == q.frequency


@njit
def beyond(g: Record, q: Record, c: Record, w: Record, side: int) -> None:
    """One sample of a stage that starts above (side 1) or below (-1) its limit."""
    limit = c.start - side * c.dropout if w.started else c.start
    started = is_measured(g, q, c.minimum) and side * (q.frequency - limit) > 0.0
    w.age = w.age + 1 if started and w.started else 0
    w.started = 1 if started else 0
    operated = started and w.age >= c.delay
    publish(q, c.bit, started, operated)
    if operated and c.trips:
        request_trip(q, c.bit, q.fault, 1)


@njit
def step(g: Record, q: Record, c: Record, w: Record) -> None:
    """One sample of a stage."""
    beyond(g, q, c, w, 1)


CONSTANTS = (("start", "f8"), ("dropout", "f8"), ("delay", "i8"), ("minimum", "f8"), ("trips", "i8"))
STATE = (("started", "i8"), ("age", "i8"))

PTOF = Function(
    name="PTOF",
    settings=Ptof,
    step=step,
    constants=CONSTANTS,
    values=values,
    state=STATE,
    most=4,
    check=check,
)
