"""PSOF: switch onto fault.

A line whose voltage is measured on its own side has no voltage before it is energised, so nothing that
needs the memory works: no direction, no selection.  But a line that was dead and now carries current at
an impedance shorter than the line can only have been switched onto a fault.  So: after ``dead_ms``
without current and voltage the function is armed for ``armed_ms`` from the first current on; a loop of
the six whose impedance lies within a circle of ``reach_pu`` of the line about the origin for ``delay_ms``
trips three poles.  Once there is a healthy voltage the memory is ready, and the zones take over.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from faultloop.config.tables import Milliseconds, Positive, Table
from faultloop.jit import njit
from faultloop.relay.functions.function import Function
from faultloop.relay.memory import size2
from faultloop.relay.quantities import THREE_PHASE, Record, publish, request_trip

if TYPE_CHECKING:
    from faultloop.relay.settings import RelaySettings


class Psof(Table):
    """``[psof]``: switch onto fault."""

    reach_pu: Positive = 1.2
    """Of the line's impedance, in every direction."""
    dead_ms: Milliseconds = 200.0
    """So long without current and voltage is a dead line."""
    armed_ms: Milliseconds = 500.0
    """From the first current on."""
    delay_ms: Milliseconds = 25.0
    """So long the impedance must stay inside: longer than the estimator's window and an inrush's first
    peak."""
    trip: bool = True
    """Whether it trips, or only starts and operates."""


def values(settings: RelaySettings, table: Psof) -> dict[str, Any]:
    """Reach in ohm, times in samples."""
    return {
        "reach": table.reach_pu * abs(settings.z1_ohm),
        "dead": max(settings.samples(table.dead_ms), 1),
        "armed": settings.samples(table.armed_ms),
        "delay": settings.samples(table.delay_ms),
        "trips": table.trip,
    }


@njit
def is_dead(g: Record, q: Record) -> bool:
    """No current in any pole, and no voltage."""
    for k in range(3):
        if size2(q.x[k]) >= g.minimum_voltage**2 or size2(q.x[3 + k]) >= g.open_current**2:
            return False
    return True


@njit
def arm(g: Record, q: Record, c: Record, w: Record) -> bool:
    """Whether the line was dead until at most ``armed_ms`` ago, and carries something now."""
    if is_dead(g, q):
        w.dead += 1
        w.age = 0
        return False
    if w.dead >= c.dead and w.age < c.armed and not q.ready:
        w.age += 1
        return True
    w.dead = 0
    return False


@njit
def within(q: Record, reach: float) -> bool:
    """Whether a loop's impedance is shorter than the reach."""
    for loop in range(6):
        r, x = q.loops[2 * loop], q.loops[2 * loop + 1]
        if r * r + x * x < reach * reach:  # false for NaN
            return True
    return False


@njit
def step(g: Record, q: Record, c: Record, w: Record) -> None:
    """One sample."""
    if not q.settled:
        return
    if w.operated:  # until the current has gone
        w.operated = q.dead != THREE_PHASE and not is_dead(g, q)
    else:
        w.count = w.count + 1 if arm(g, q, c, w) and within(q, c.reach) else 0
        w.operated = w.count > c.delay
    publish(q, c.bit, w.count > 0, w.operated)
    if w.operated and c.trips:
        request_trip(q, c.bit, THREE_PHASE, 1)


PSOF = Function(
    name="PSOF",
    settings=Psof,
    step=step,
    constants=(("reach", "f8"), ("dead", "i8"), ("armed", "i8"), ("delay", "i8"), ("trips", "i8")),
    values=values,
    state=(
        ("dead", "i8"),  # samples of a dead line in a row
        ("age", "i8"),  # samples since it is not
        ("count", "i8"),  # samples inside in a row
        ("operated", "i8"),
    ),
    always=True,
)
