"""LPHD: whether the relay is ready, and why not.

Zones, direction and phase selection need the memory of a healthy system.  Until there is one, and while there
is none any more, they are blocked, ``LPHD1.PhyHealth`` is on, and an event says the cause.  So it is with a
phase whose voltage or current is missing: its loops are blocked, and without a current the ground loops, too.
All three currents that go at one moment are told as well (`faultloop.relay.currents`).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from faultloop.config.tables import Milliseconds, Table
from faultloop.jit import njit
from faultloop.relay.events import Event, Names, poles_text
from faultloop.relay.functions.function import Function
from faultloop.relay.memory import is_frequency, positive_sequence, size2
from faultloop.relay.quantities import Record, indicate
from faultloop.relay.voltages import carries

if TYPE_CHECKING:
    from faultloop.relay.settings import RelaySettings

READY, SETTLING, OPENED, VOLTAGE, FREQUENCY, UNSOUND, MOVING, FLOWING = range(8)
MISSING, CURRENT, VANISHED = range(8, 11)
ALL_PHASES = 7
CAUSES = (
    "",
    "the estimator settles",
    "a pole has opened; what is normal now is learned",
    "no voltage",
    "no voltage of known frequency",
    "the line carries what looks like a fault, and there is nothing from before it",
    "the voltage does not stand still",
    "current flows, and there is no voltage",
)


class Lphd(Table):
    """``[lphd]``: whether the relay is ready."""

    start_ms: Milliseconds = 100.0
    """At the start not being ready is told after this time: longer than it takes with a healthy line."""


def values(settings: RelaySettings, table: Lphd) -> dict[str, Any]:
    """In samples."""
    return {"start": settings.samples(table.start_ms)}


@njit
def cause(g: Record, q: Record) -> int:
    """Why the zones, or some loops, cannot work at this sample."""
    if q.ready:
        if q.proven != ALL_PHASES:
            return MISSING
        if q.missing:
            return CURRENT
        return VANISHED if q.vanished else READY
    if q.memory.seen <= g.settling:
        return SETTLING
    if q.memory.blind > 0:
        return OPENED
    if size2(positive_sequence(q.x)) <= g.minimum_voltage**2:
        return FLOWING if carries(g, q) else VOLTAGE
    if not is_frequency(g, q.frequency):
        return FREQUENCY
    return MOVING if q.sound else UNSOUND


@njit
def step(g: Record, q: Record, c: Record, w: Record) -> None:
    """One sample; a cause is told once the relay has not been ready for a quarter of a cycle, at the start
    for ``start_ms``; readiness at once."""
    now = cause(g, q)
    w.was_ready |= q.ready
    w.count = 0 if now == READY else w.count + 1
    late = 4 * w.count >= g.cycle if w.was_ready else w.count >= c.start
    # one cause is enough, but for these two
    told = now == SETTLING or (w.cause != READY and now != UNSOUND and now != FLOWING)
    if now != w.cause and (now in (READY, MISSING) or (late and not told)):
        w.cause = now
        w.missing = q.missing if now == CURRENT else ALL_PHASES & ~q.proven
        q.notices += 1
    indicate(q, c.bit, now != READY)


def tell(names: Names, was: np.void, now: np.void) -> Iterator[Event]:
    """Ready, or not and why."""
    if now["cause"] == was["cause"]:
        return
    if now["cause"] == READY:
        yield Event(names.sample, "info", "LPHD1 ready")
    elif now["cause"] == MISSING:
        phases = poles_text(int(now["missing"]))
        text = f"LPHD1 the voltage of phase {phases} cannot be relied on: its loops are blocked"
        yield Event(names.sample, "warning", text)
    elif now["cause"] == CURRENT:
        phases = poles_text(int(now["missing"]))
        text = f"LPHD1 no current of phase {phases} beside the others': its loops, and to ground, are blocked"
        yield Event(names.sample, "warning", text)
    elif now["cause"] == VANISHED:
        text = "LPHD1 the currents of all phases went at one moment, as no load does: nothing is measured"
        yield Event(names.sample, "warning", text)
    else:
        level = "info" if now["cause"] == OPENED else "warning"  # it follows every trip
        yield Event(names.sample, level, f"LPHD1 not ready, zones blocked: {CAUSES[int(now['cause'])]}")


LPHD = Function(
    name="LPHD",
    settings=Lphd,
    step=step,
    constants=(("start", "i8"),),
    values=values,
    state=(("cause", "i8"), ("count", "i8"), ("was_ready", "i8"), ("missing", "i8")),
    always=True,
    bits=("PhyHealth",),
    told=False,
    tell=tell,
)
