"""Which phases' voltages can be relied on.

A phase that carries current and has no voltage is at a bolted fault close in, or its voltage transformer is
not there: a blown fuse, an open miniature breaker, a channel that nobody wired.  Phasors cannot tell which,
but what was before can: a transformer is *proven* by a voltage, and no longer when the voltage is missing in
quiet while the closed pole carries current or the other phases have theirs.  (Where poles open one after the
other, an open one's current is estimated for longer than its voltage.)  All three without load go as those
of a line that is opened do; but that one's breaker says so, or its load goes with the voltage.
The same holds of a voltage that has just gone while every current stays as it was.
Loops with a phase that is not proven measure nothing.
One that goes while a fault is on is judged by the samples (`lost_voltages`).
"""

from __future__ import annotations

from typing import Any

from faultloop.jit import njit
from faultloop.relay.memory import size2

Record = Any

PART = 0.5
"""Of the greatest phase voltage: below it one is missing ..."""
UNBALANCE = 0.25
"""... if V2 is above this part of V1: the earthed phase of an isolated network has none, and its loops to the
others go on measuring."""
ALL_PHASES = 0b111
LOOPS_OF = (0b101001, 0b011010, 0b110100)
"""Mask of the loops AG BG CG AB BC CA that a phase is in."""


@njit
def prove(g: Record, q: Record) -> None:
    """In quiet: keep the mask of proven phases, ``q.proven``."""
    greatest = max(size2(q.x[0]), size2(q.x[1]), size2(q.x[2]))
    floor = g.minimum_voltage**2
    gone = greatest <= floor or size2(q.sequence[2]) > UNBALANCE**2 * size2(q.sequence[1])
    alone = greatest > floor
    for phase in range(3):
        if size2(q.x[phase]) > max(floor, PART**2 * greatest):
            q.proven |= 1 << phase
            q.loaded = 0
        elif gone and (q.closed >> phase) & 1 and (alone or size2(q.x[3 + phase]) > g.open_current**2):
            q.proven &= ~(1 << phase)
    if carries(g, q):
        q.loaded = 1
    lost = greatest <= floor and q.closed == ALL_PHASES and not q.loaded
    q.lost = q.lost + 1 if lost else 0
    if q.lost >= g.snapshots:  # two cycles: a breaker that closes says so before its current is seen
        q.proven = 0


@njit
def lose(g: Record, q: Record) -> None:
    """In a disturbance: a voltage that has gone while no current has changed for half a cycle, nor its pole
    opened, is its transformer's; a fault that took it away would be fed, or the load would change."""
    q.lost = q.lost + 1 if q.closed == ALL_PHASES else 0  # a breaker says that it closes before its current
    if q.memory.fed or 2 * q.memory.age < g.cycle or (0 < 2 * q.lost < g.cycle):
        return
    greatest = max(size2(q.x[0]), size2(q.x[1]), size2(q.x[2]))
    floor = g.minimum_voltage**2
    if greatest > floor and size2(q.sequence[2]) <= UNBALANCE**2 * size2(q.sequence[1]):
        return
    for phase in range(3):
        if size2(q.x[phase]) <= max(floor, PART**2 * greatest) and (q.closed >> phase) & 1:
            q.proven &= ~(1 << phase)


@njit
def carries(g: Record, q: Record) -> bool:
    """Whether any pole carries current."""
    return max(size2(q.x[3]), size2(q.x[4]), size2(q.x[5])) > g.open_current**2


@njit
def loops_of(phases: int) -> int:
    """Mask of the loops that a mask of phases is in."""
    mask = 0
    for phase in range(3):
        if (phases >> phase) & 1:
            mask |= LOOPS_OF[phase]
    return mask
