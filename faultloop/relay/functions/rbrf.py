"""RBRF: breaker failure.

A trip of the relay's own starts it, pole by pole.  After ``retrip_ms`` all three poles are tripped once more
(``RBRF1.OpIn``); after ``backup_ms``, if current still flows, the breakers around must open
(``RBRF1.OpEx``): those that the relay's ``back_trip`` names are told so over the bus.

What counts is how soon the detector sees that the current is gone.  A phasor keeps it for a filter's
length; and when a saturated current transformer's primary current is cut its flux drives on a current that
decays for 100 ms (subsidence).  So the current is judged by samples: what flows is what goes up and
down.  An eighth of a cycle of difference, i(t) - i(t - T/8), leaves the offset of a fault's current and a
subsidence as something small and of one sign; current flows where the difference has been above the limit
and below its negative within the last five eighths of a cycle (a third of it once it flows).  That is over
three quarters of a cycle after the current's last zero at the latest.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import model_validator

from faultloop.config.tables import Milliseconds, Positive, Table
from faultloop.jit import njit
from faultloop.relay.events import Event, Names, poles_text
from faultloop.relay.functions.function import Function
from faultloop.relay.quantities import Record, indicate, request_trip
from faultloop.relay.recent import LENGTH, SQRT2

if TYPE_CHECKING:
    from faultloop.relay.settings import RelaySettings

GAIN = 2 * math.sin(math.pi / 8)
"""Of a difference over an eighth of a cycle, for the fundamental."""
DROPOUT = 0.35
"""Of the limit, once current flows: a sinusoid of the limit's size is out of that for 221 degrees at a
time."""


class Rbrf(Table):
    """``[rbrf]``: breaker failure."""

    current_a: Positive
    """A phase current that flows; below the least fault, above what a load or a cable charges."""
    retrip_ms: Milliseconds = 20.0
    """From the trip to the second trip, three-pole."""
    backup_ms: Milliseconds = 150.0
    """From the trip to that of the breakers around: the breaker's time, 15 ms for the detector, a margin."""
    pulse_ms: Milliseconds = 150.0
    """So long the command to the breakers around lasts at least."""

    @model_validator(mode="after")
    def _order(self) -> Rbrf:
        if self.backup_ms <= self.retrip_ms:
            raise ValueError(f"backup_ms must be above retrip_ms, {self.retrip_ms:g} ms")
        return self


def values(settings: RelaySettings, table: Rbrf) -> dict[str, Any]:
    """Current of the difference, peak; times in samples."""
    return {
        "limit": settings.amperes(table.current_a, 0.0) * SQRT2 * GAIN,
        "retrip": settings.samples(table.retrip_ms),
        "backup": settings.samples(table.backup_ms),
        "pulse": settings.samples(table.pulse_ms),
    }


@njit
def watch(g: Record, q: Record, c: Record, w: Record, phase: int) -> bool:
    """Whether the current of a pole flows, at this sample."""
    r = q.recent
    apart = max(g.values // 8, 1)
    now = r.value[r.head, 3 + phase]
    before = r.value[(r.head - apart) % LENGTH, 3 + phase]
    limit = DROPOUT * c.limit if w.flows[phase] else c.limit
    w.above[phase] = 0 if now - before > limit else w.above[phase] + 1
    w.below[phase] = 0 if before - now > limit else w.below[phase] + 1
    w.flows[phase] = 8 * max(w.above[phase], w.below[phase]) < 5 * g.cycle
    return w.flows[phase] != 0


@njit
def step(g: Record, q: Record, c: Record, w: Record) -> None:
    """One sample.  It comes before the trip logic, and so sees the poles of the sample before."""
    flows = 0
    for phase in range(3):
        pole = 1 << phase
        if watch(g, q, c, w, phase):
            flows |= pole
        started = q.poles & pole or w.age[phase] > 0
        w.age[phase] = w.age[phase] + 1 if started and flows & pole else 0
    oldest = max(w.age[0], w.age[1], w.age[2])
    retrip = oldest > c.retrip
    failed = 0
    for phase in range(3):
        if w.age[phase] > c.backup:
            failed |= 1 << phase
    if failed and not w.pulse:
        w.failed = failed
        w.count += 1
        q.notices += 1
    w.pulse = c.pulse if failed else max(w.pulse - 1, 0)
    told = q.back_trip
    q.back_trip = 7 if w.pulse else 0
    if told and not q.back_trip:
        q.notices += 1
    indicate(q, c.bit, oldest > 0)
    indicate(q, c.bit + 1, retrip)
    indicate(q, c.bit + 2, w.pulse > 0 or failed != 0)
    if retrip:
        request_trip(q, c.bit, q.fault, 1)


def tell(names: Names, was: np.void, now: np.void) -> Iterator[Event]:
    """The command to the breakers around."""
    if now["count"] != was["count"]:
        text = f"RBRF1 OpEx: current of pole {poles_text(int(now['failed']))} still flows: breaker failure"
        yield Event(names.sample, "error", text)


RBRF = Function(
    name="RBRF",
    settings=Rbrf,
    step=step,
    constants=(("limit", "f8"), ("retrip", "i8"), ("backup", "i8"), ("pulse", "i8")),
    values=values,
    state=(
        ("flows", "i8", (3,)),
        ("above", "i8", (3,)),  # samples since the difference was above the limit ...
        ("below", "i8", (3,)),  # ... and below its negative
        ("age", "i8", (3,)),  # samples since the trip, while current flows
        ("pulse", "i8"),
        ("failed", "i8"),  # mask of poles
        ("count", "i8"),
    ),
    start={"above": 1 << 30, "below": 1 << 30},
    bits=("", "OpIn", "OpEx"),
    tell=tell,
)
