"""PSOF: switch onto fault.

A line whose voltage is measured on its own side has no voltage before it is energised, so nothing that
needs the memory works: no direction, no selection.  But a line that was dead and now carries current at
an impedance shorter than the line can only have been switched onto a fault.  So: after ``dead_ms``
without current and voltage the function is armed for ``armed_ms`` from the first current on; a loop of
the six whose impedance lies within a circle of ``reach_pu`` of the line about the origin for ``delay_ms``
trips three poles.  Once there is a healthy voltage in every phase the memory is ready, and the zones take
over; a phase that has none, as beside a fault close in, has no zones.

What else comes with an energised line must not be taken for a fault:

- a load, behind a long line: beyond half the reach an impedance counts only at the line's angle;
- the inrush of a transformer: a loop whose current has a second harmonic waits;
- no voltage transformer, or one phase of it: a loop counts only if the voltages of its phases were there
  before the line was dead (`faultloop.relay.voltages`), or are there now; one phase that has none beside
  others that do must show in the residual current, and none at all goes with the balanced currents of a
  three-phase fault.  Where no voltage was ever seen, an impedance of zero is none; ``current_a`` then is the
  only way to trip, set above load and inrush.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from pydantic import model_validator

from faultloop.config.tables import Milliseconds, Positive, Table
from faultloop.jit import njit
from faultloop.relay.functions.function import Function
from faultloop.relay.loop_fit import loop_values
from faultloop.relay.memory import size2
from faultloop.relay.quantities import (
    ALL_POLES,
    AT_ITS_ANGLE,
    THREE_PHASE,
    Record,
    dead_poles,
    publish,
    request_trip,
)
from faultloop.relay.voltages import loops_of

if TYPE_CHECKING:
    from faultloop.relay.settings import RelaySettings

ALL_PROVEN = 7
WHATEVER_ANGLE = 0.5
"""Of the reach: shorter than this no load is."""
THERE = 0.1
"""Of the greatest phase voltage: above it a phase has a voltage now, ..."""
OVER_NOTHING = (0.1, 0.01)
"""... if it is above these parts of the minimum voltage and of the drop along the line."""
BALANCED = 0.25
"""I0 and I2 over I1: no voltage in all phases goes with a three-phase fault alone, and its currents."""
RESIDUAL = 0.5
"""Of the greatest phase current: 3I0 above it is an earth fault's."""
INRUSH = 0.15
"""Second harmonic, of the fundamental."""


class Psof(Table):
    """``[psof]``: switch onto fault."""

    reach_pu: Positive = 1.2
    """Of the line's impedance, in every direction."""
    dead_ms: Milliseconds = 200.0
    """So long without current and voltage is a dead line."""
    armed_ms: Milliseconds = 500.0
    """From the first current on; above ``delay_ms``."""
    delay_ms: Milliseconds = 25.0
    """So long the impedance must stay inside: longer than the estimator's window and an inrush's first
    peak."""
    current_a: Positive | None = None
    """A phase current that trips without any voltage; above load and inrush.  Left out: none does."""
    trip: bool = True
    """Whether it trips, or only starts and operates."""

    @model_validator(mode="after")
    def _within_its_time(self) -> Psof:
        if self.delay_ms >= self.armed_ms:
            what = f"delay_ms must be below armed_ms, {self.armed_ms:g}, not {self.delay_ms:g}"
            raise ValueError(f"{what}: it would never operate")
        return self


def values(settings: RelaySettings, table: Psof) -> dict[str, Any]:
    """Reach in ohm, times in samples."""
    return {
        "reach": table.reach_pu * abs(settings.z1_ohm),
        "dead": max(settings.samples(table.dead_ms), 1),
        "armed": settings.samples(table.armed_ms),
        "delay": settings.samples(table.delay_ms),
        "current": settings.amperes(table.current_a, math.inf),
        "trips": table.trip,
    }


@njit
def fundamental2(g: Record, q: Record, phase: int) -> float:
    """|V|^2 of a phase by the Fourier transform of the last cycle: a charge that stays on an open line stands
    still, and an estimator makes a phasor of it."""
    v = complex(0.0, 0.0)
    for k in range(g.values):
        turn = complex(math.cos(k * g.turn_per_value), math.sin(k * g.turn_per_value))
        v += loop_values(q.recent, k, phase)[0] * turn
    return 2.0 * size2(v) / g.values**2


@njit
def is_dead(g: Record, q: Record) -> bool:
    """No current in any pole, and no voltage but a charge's."""
    for k in range(3):
        if size2(q.x[3 + k]) >= g.open_current**2:
            return False
    for k in range(3):
        has = size2(q.x[k]) >= g.minimum_voltage**2
        if has and fundamental2(g, q, k) >= g.minimum_voltage**2:
            return False
    return True


@njit
def arm(g: Record, q: Record, c: Record, w: Record) -> bool:
    """Whether the line was dead until at most ``armed_ms`` ago, and carries something now."""
    if is_dead(g, q):
        w.dead += 1
        w.age = 0
        w.proven = q.proven
        return False
    if w.dead >= c.dead and w.age < c.armed and not (q.ready and q.proven == ALL_PROVEN):
        w.age += 1
        return True
    w.dead = 0
    return False


@njit
def measured_loops(g: Record, q: Record, proven: int) -> int:
    """Mask of the loops whose voltages are measured now, or whose lack is that of an earth fault."""
    voltage = max(size2(q.x[0]), size2(q.x[1]), size2(q.x[2]))
    current = max(size2(q.x[3]), size2(q.x[4]), size2(q.x[5]))
    floor = max(OVER_NOTHING[0] ** 2 * g.minimum_voltage**2, OVER_NOTHING[1] ** 2 * size2(g.z1) * current)
    there = 0
    for phase in range(3):
        if size2(q.x[phase]) > max(THERE**2 * voltage, floor):
            there |= 1 << phase
    if there == 0 and max(size2(q.sequence[3]), size2(q.sequence[5])) > BALANCED**2 * size2(q.sequence[4]):
        return 0
    mask = ~loops_of(7 & ~(proven | there))
    if voltage > floor and size2(q.x[3] + q.x[4] + q.x[5]) > RESIDUAL**2 * current:
        mask |= 0b000111
    return mask


@njit
def is_inrush(g: Record, q: Record, loop: int) -> bool:
    """Whether the loop's current has a second harmonic, over the last cycle."""
    first = second = complex(0.0, 0.0)
    for k in range(g.values):
        i = loop_values(q.recent, k, loop)[1]
        turn = complex(math.cos(k * g.turn_per_value), math.sin(k * g.turn_per_value))
        first += i * turn
        second += i * turn * turn
    return size2(second) > INRUSH**2 * size2(first)


@njit
def within(g: Record, q: Record, c: Record, proven: int) -> bool:
    """Whether a loop that measures is inside the reach, or a current above all that is healthy."""
    for phase in range(3):
        if size2(q.x[3 + phase]) > c.current**2:
            return True
    mask = 0 if q.fuse_failure else measured_loops(g, q, proven)
    for loop in range(6):
        r, x = q.loops[2 * loop], q.loops[2 * loop + 1]
        size = math.sqrt(r * r + x * x)
        along = abs(r * g.z1.real + x * g.z1.imag)
        at_angle = along >= AT_ITS_ANGLE * size * abs(g.z1) or size < WHATEVER_ANGLE * c.reach
        if (mask >> loop) & 1 and size < c.reach and at_angle and not is_inrush(g, q, loop):  # false for NaN
            return True
    return False


@njit
def flows(g: Record, q: Record) -> bool:
    """Whether any pole carries current, by the samples."""
    return (q.dead | dead_poles(g, q)) != ALL_POLES


@njit
def step(g: Record, q: Record, c: Record, w: Record) -> None:
    """One sample."""
    if not q.settled:
        return
    if w.operated:  # until the current has gone, and then not again: phasors decay through the reach
        w.operated = flows(g, q) and not is_dead(g, q)
        if not w.operated:
            w.count = w.dead = 0
    else:
        inside = arm(g, q, c, w) and flows(g, q) and within(g, q, c, w.proven)
        w.count = w.count + 1 if inside else 0
        w.operated = w.count > c.delay
    publish(q, c.bit, w.count > 0, w.operated)
    if w.operated and c.trips:
        request_trip(q, c.bit, THREE_PHASE, 1)


PSOF = Function(
    name="PSOF",
    settings=Psof,
    step=step,
    constants=(
        ("reach", "f8"),
        ("dead", "i8"),
        ("armed", "i8"),
        ("delay", "i8"),
        ("current", "f8"),
        ("trips", "i8"),
    ),
    values=values,
    state=(
        ("dead", "i8"),  # samples of a dead line in a row
        ("age", "i8"),  # samples since it is not
        ("proven", "i8"),  # mask of phases whose voltage was there before
        ("count", "i8"),  # samples inside in a row
        ("operated", "i8"),
    ),
    always=True,
)
