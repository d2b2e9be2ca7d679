"""TVTR: fuse failure of the voltage transformer.

A fuse or a miniature breaker takes a voltage away and leaves the currents as they are; a fault does not.  So
the voltages cannot be relied on where, for a quarter of a cycle,

- 3 V2 is high while 3 I2 and 3 I0 are low: one or two phases.  (A phase that loses a voltage dV changes all
  three sequences by dV / 3, so V2 shows whatever V0 does, and an earth fault of an isolated network, which
  has V0 alone, is none.)  This needs nothing from before, so it is found at the relay's start, too;
- or the positive sequence has fallen below a part of what it was, with no change of the currents, while
  current flows: all three.

Neither is judged with a pole open, on a dead line, and for a while after those.  While it stands
``TVTR1.FuFail`` is on and whatever needs a voltage is blocked: zones, direction, switch onto fault by
impedance, undervoltage, directional overcurrent; overcurrent stages for this case (``when = "fuse-failure"``)
are released.

It ends when all voltages are back, for ``reset_ms``.  And it ends at once where it was none: a fault, of a
source so weak that its current shows later than its voltage, brings half as much current again within a
cycle; a voltage that has only sagged, no phase being lost, makes way for an unbalanced current until
``latch_s`` have passed.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import Field

from faultloop.config.tables import Milliseconds, Positive, Seconds, Table
from faultloop.jit import njit
from faultloop.relay.events import Event, Names, poles_text
from faultloop.relay.functions.function import Function
from faultloop.relay.memory import positive_sequence, size2
from faultloop.relay.quantities import Record, indicate

if TYPE_CHECKING:
    from faultloop.relay.settings import RelaySettings

ALL_ZONES = -1
LOST = 0.7
"""Of what it was, or of the greatest phase: below it a phase has lost its voltage (through loads between
phases a phase without a fuse still has half)."""
BACK = 0.8
"""Of what it was: above it it is there again."""
FAULTS_CURRENT = 1.5
"""Of the current before."""
GROWS = 1.1
"""Of the greatest current before: below it an unbalance is none of a fault's."""
BALANCED = 0.5
"""Of the unbalance that is a failure: below it the voltages are balanced again."""
Part = Annotated[float, Field(gt=0, lt=1)]


class Tvtr(Table):
    """``[tvtr]``: fuse failure of the voltage transformer; blocks what needs a voltage."""

    unbalance_pu: Part = 0.3
    """3 V2, of the greatest phase voltage: above it voltages are missing, if the currents are balanced."""
    current_pu: Part = 0.2
    """3 I2 and 3 I0, of I1: above it the unbalance is a fault's or a load's."""
    current_a: Positive | None = None
    """The same at small loads; `open_current_a` of `[ptrc]` where not given.  The greater one holds."""
    fall_pu: Part = 0.4
    """Of V1 before: below it, with unchanged currents, all three voltages are missing."""
    after_dead_ms: Milliseconds = 200.0
    """So long after a dead line or an open pole nothing is judged."""
    reset_ms: Milliseconds = 100.0
    """So long all voltages must be back."""
    latch_s: Seconds = 5.0
    """After it an unbalanced current no longer ends a failure in which no phase is lost altogether."""


def values(settings: RelaySettings, table: Tvtr) -> dict[str, Any]:
    """Times in samples."""
    return {
        "unbalance": table.unbalance_pu,
        "current_pu": table.current_pu,
        "current": settings.amperes(table.current_a, 0.0),
        "fall": table.fall_pu,
        "after_dead": settings.samples(table.after_dead_ms),
        "reset": settings.samples(table.reset_ms),
        "latch": settings.samples(1000 * table.latch_s),
    }


@njit
def greatest2(x: Any) -> float:
    """Square of the greatest of three."""
    return max(size2(x[0]), size2(x[1]), size2(x[2]))


@njit
def is_unbalanced(g: Record, q: Record, c: Record) -> bool:
    """Whether the currents are: 3 I2 or 3 I0 above its limit."""
    least = c.current if c.current > 0.0 else g.open_current
    limit = max(c.current_pu**2 * size2(q.sequence[4]), least**2)
    return 9 * size2(q.sequence[5]) > limit or 9 * size2(q.sequence[3]) > limit


@njit
def is_lost(g: Record, q: Record, c: Record) -> bool:
    """Whether this sample's voltages and currents are a failure's."""
    if is_unbalanced(g, q, c) or q.fed:
        return False
    greatest = greatest2(q.x[:3])
    if greatest > g.minimum_voltage**2 and 9 * size2(q.sequence[2]) > c.unbalance**2 * greatest:
        return True
    before = size2(positive_sequence(q.memory.reference))
    fallen = q.disturbed and size2(q.sequence[1]) < c.fall**2 * before
    return fallen and size2(q.sequence[4]) > g.open_current**2


@njit
def lost_phases(q: Record, before: float) -> int:
    """Mask of the phases without voltage; ``before`` is the square of what it was."""
    limit = LOST**2 * max(greatest2(q.x[:3]), before)
    mask = 0
    for phase in range(3):
        if size2(q.x[phase]) < limit:
            mask |= 1 << phase
    return mask


@njit
def judge(g: Record, q: Record, c: Record, w: Record) -> None:
    """One sample without a failure."""
    dead = greatest2(q.x[:3]) < g.minimum_voltage**2 and greatest2(q.x[3:]) < g.open_current**2
    if dead or q.closed != 7:
        w.hold = c.after_dead
    w.count = w.count + 1 if w.hold == 0 and is_lost(g, q, c) else 0
    w.hold = max(w.hold - 1, 0)
    if 4 * w.count < g.cycle:
        return
    before = size2(positive_sequence(q.memory.reference)) if q.disturbed else 0.0
    w.before = max(before, greatest2(q.x[:3]))
    w.lost = lost_phases(q, w.before)
    w.on = 1
    w.age = w.well = 0


@njit
def is_back(q: Record, c: Record, w: Record) -> bool:
    """Whether all voltages are there, balanced, and taken for what is normal."""
    for phase in range(3):
        if size2(q.x[phase]) < BACK**2 * w.before:
            return False
    limit = (BALANCED * c.unbalance) ** 2 * greatest2(q.x[:3])
    return q.ready and q.disturbed == 0 and 9 * size2(q.sequence[2]) < limit


@njit
def is_fed_by_a_fault(g: Record, q: Record) -> bool:
    """Whether a current has grown by more than a load does at a time."""
    limit = max(FAULTS_CURRENT**2 * greatest2(q.memory.reference[3:]), g.open_current**2)
    return q.fed != 0 and greatest2(q.x[3:]) > limit


@njit
def has_grown(q: Record) -> bool:
    """Whether a current is greater than before: while a load comes or goes an estimator's currents are
    unbalanced, too."""
    return greatest2(q.x[3:]) > GROWS**2 * greatest2(q.memory.reference[3:])


@njit
def follow(g: Record, q: Record, c: Record, w: Record) -> None:
    """One sample of a failure."""
    w.age += 1
    young = w.age <= g.cycle
    w.lost |= lost_phases(q, w.before)
    unbalanced = is_unbalanced(g, q, c)
    w.well = w.well + 1 if is_back(q, c, w) else 0
    fault_after_all = young and (is_fed_by_a_fault(g, q) or (unbalanced and has_grown(q)))
    sag = unbalanced and w.lost == 0 and w.age <= c.latch
    if fault_after_all or sag or w.well > c.reset:
        w.on = w.count = 0


@njit
def step(g: Record, q: Record, c: Record, w: Record) -> None:
    """One sample; publishes ``q.fuse_failure`` and blocks the zones."""
    if not q.settled:
        return
    was = w.on
    if w.on:
        follow(g, q, c, w)
    else:
        judge(g, q, c, w)
    if w.on != was:
        q.notices += 1
    q.fuse_failure = w.on
    if w.on:
        q.blocked_zones = ALL_ZONES
    indicate(q, c.bit, w.on)


def tell(names: Names, was: np.void, now: np.void) -> Iterator[Event]:
    """A failure with its phases; its end."""
    if now["on"] and not was["on"]:
        lost = int(now["lost"])
        phases = f"of phase {poles_text(lost)}" if lost else "unbalanced"
        text = f"TVTR1 FuFail: voltage {phases} without a fault's current; what needs it is blocked"
        yield Event(names.sample, "warning", text)
    elif was["on"] and not now["on"]:
        yield Event(names.sample, "info", "TVTR1 FuFail reset")


TVTR = Function(
    name="TVTR",
    settings=Tvtr,
    step=step,
    constants=(
        ("unbalance", "f8"),
        ("current_pu", "f8"),
        ("current", "f8"),  # 0: the open current
        ("fall", "f8"),
        ("after_dead", "i8"),
        ("reset", "i8"),
        ("latch", "i8"),
    ),
    values=values,
    state=(
        ("on", "i8"),
        ("count", "i8"),  # samples in a row that look like a failure
        ("hold", "i8"),  # samples for which nothing is judged
        ("age", "i8"),  # samples of the failure
        ("lost", "i8"),  # mask of phases
        ("before", "f8"),  # square of the voltage that was there
        ("well", "i8"),  # samples in a row with all voltages back
    ),
    bits=("FuFail",),
    told=False,
    tell=tell,
)
