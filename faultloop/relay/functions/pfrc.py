"""PFRC: rate of change of frequency.

The rate is the difference of two frequencies `window_ms` apart, over that time.  A jump of the phase is in
one of the two for a cycle and as long as the estimator takes, so the rate must stand for three cycles.  For
fifteen cycles after a voltage has come nothing is measured: an estimator that adapts and begins off the
nominal frequency swings about the right one, by a tenth of the distance, until then.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field

from faultloop.config.tables import Milliseconds, Positive, Table
from faultloop.jit import njit
from faultloop.relay.functions.function import Function
from faultloop.relay.functions.ptof import JUMP_CYCLES, is_measured
from faultloop.relay.quantities import Record, publish, request_trip

if TYPE_CHECKING:
    from faultloop.relay.settings import RelaySettings

SETTLING_CYCLES = 15
"""Of a frequency, from when there is a voltage."""
VALUES = 64
"""Frequencies in a window."""
_SIDE = {"falling": -1, "rising": 1, "both": 0}


class Pfrc(Table):
    """``[[pfrc]]``: one stage of rate of change of frequency."""

    start_hz_per_s: Annotated[float, Field(gt=0, le=20)]
    """Above it the stage starts."""
    side: Literal["falling", "rising", "both"] = "both"
    """Which way the frequency must go."""
    window_ms: Annotated[float, Field(ge=60, le=1000)] = 150.0
    """Over which the rate is measured; a longer one is steadier, and later."""
    delay_ms: Milliseconds = 100.0
    """From start to operate; three cycles at least."""
    minimum_v: Positive | None = None
    """Of V1 (phase to ground): below it there is no frequency; what counts as a dead phase where not
    given."""
    trip: bool = True
    """Whether its operate trips."""


def values(settings: RelaySettings, table: Pfrc) -> dict[str, Any]:
    """The stage in samples."""
    cycle = settings.relay.sampling_hz / settings.relay.frequency_hz
    every = max(-(-settings.samples(table.window_ms) // (VALUES - 1)), 1)
    return {
        "start": table.start_hz_per_s,
        "side": _SIDE[table.side],
        "every": every,
        "window": max(round(settings.samples(table.window_ms) / every), 1),
        "settling": round(SETTLING_CYCLES * cycle),
        "delay": max(settings.samples(table.delay_ms), round(JUMP_CYCLES * cycle)),
        "minimum": settings.volts(table.minimum_v, 0.0),
        "trips": table.trip,
    }


@njit
def measure(g: Record, q: Record, c: Record, w: Record) -> None:
    """The rate now and then; without a whole window none."""
    w.tick += 1
    if w.tick < c.every:
        return
    w.tick = 0
    before = w.ring[(w.head + VALUES - c.window + 1) % VALUES]
    w.head = (w.head + 1) % VALUES
    w.ring[w.head] = q.frequency
    w.filled = min(w.filled + 1, VALUES)
    w.rate = 0.0
    if w.filled > c.window:
        w.rate = (q.frequency - before) * g.sampling / (c.window * c.every)


@njit
def step(g: Record, q: Record, c: Record, w: Record) -> None:
    """One sample of a stage."""
    w.there = w.there + 1 if is_measured(g, q, c.minimum) else 0
    if w.there > c.settling:
        measure(g, q, c, w)
    else:
        w.filled = w.tick = 0
        w.rate = 0.0
    rate = abs(w.rate) if c.side == 0 else c.side * w.rate
    started = rate > c.start
    w.age = w.age + 1 if started else 0
    operated = w.age > c.delay
    publish(q, c.bit, started, operated)
    if operated and c.trips:
        request_trip(q, c.bit, q.fault, 1)


PFRC = Function(
    name="PFRC",
    settings=Pfrc,
    step=step,
    constants=(
        ("start", "f8"),
        ("side", "i8"),
        ("every", "i8"),  # samples between two values
        ("window", "i8"),  # values in the window
        ("settling", "i8"),  # samples
        ("delay", "i8"),
        ("minimum", "f8"),
        ("trips", "i8"),
    ),
    values=values,
    state=(
        ("there", "i8"),  # samples with a voltage
        ("ring", "f8", (VALUES,)),
        ("head", "i8"),
        ("tick", "i8"),
        ("filled", "i8"),
        ("rate", "f8"),  # [Hz/s]
        ("age", "i8"),
    ),
    most=4,
)
