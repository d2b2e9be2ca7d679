"""Which phases' voltages can be relied on.

A phase that carries current and has no voltage is at a bolted fault close in, or its voltage transformer is
not there: a blown fuse, an open miniature breaker, a channel that nobody wired.  Phasors cannot tell which,
but what was before can: a transformer is *proven* by a voltage, and no longer when the voltage is missing in
quiet while the closed pole carries current or the other phases have theirs.  (Where poles open one after the
other, an open one's current is estimated for longer than its voltage.)  All three without load go as those
of a line that is opened do; but that one's breaker says so, or its load goes with the voltage.
The same holds of a voltage that has just gone while every current stays as it was.
Loops with a phase that is not proven measure nothing.

In a fault the currents are no longer as they were, and one that goes on at another place measures none at all
once the voltage is lost.  There the samples tell: where a phase has had no voltage for a sixth of a cycle,
its transformer is suspected and measures nothing until the phase's current has changed as well; if that is as
it was after half a cycle, the transformer is not proven any more.  A fault that takes the voltage from V to
nothing, ahead or behind, changes the current that flows by V / (E - V) of it, E the sources'.
"""

from __future__ import annotations

import math
from typing import Any

from numpy.typing import NDArray

from faultloop.jit import njit
from faultloop.relay.memory import current_limit2, positive_sequence, size2, voltage_limit2
from faultloop.relay.recent import SQRT2, largest_current

Record = Any

PART = 0.5
"""Of the greatest phase voltage: below it one is missing ..."""
UNBALANCE = 0.25
"""... if V2 is above this part of V1: the earthed phase of an isolated network has none, and its loops to the
others go on measuring."""
ALL_PHASES = 0b111
NOTHING = (0.05, 0.003)
"""Of what it was, and of the voltage before the disturbance: below the greater a sample is none."""
HAD = (0.02, 0.2)
"""Of the voltage before the disturbance: what is lost must have been more; and more than the second part
behind a transformer that is not ideal, and where it has gone with the current before: a transient, or a line
that rings beside a fault close in, comes and goes (bench/ct_saturation.py, seed 2, case 2090)."""
SUSPECTED = 6
"""Part of a cycle without voltage; a sinusoid of `HAD` is below `NOTHING` for a tenth."""
CHANGES, LEAST_CHANGE = 0.35, 0.1
"""Of the least change of a fault, and of the current: where its samples differ by more, as standard
deviation, from what it was, it has changed.  A fault makes it 0.44 of that and more over half a cycle,
whatever its angle; an offset that decays makes it 0.09 of the current."""
MOST = 1.4
"""V / (E - V) where V is all of E, and the current a load's: of that a fault is more than this, with sources
up to 40 degrees apart."""
RINGS = 3.0
"""How much what the samples left of the phasor before, as variance, counts against a change: lines ring, with
half of the fundamental 50 ms after a fault."""
CURRENT_GONE = 0.1
"""Of what it was: with less in a twelfth of a cycle, in which a sinusoid has 0.26, it is none."""
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
def follow(g: Record, q: Record, phase: int) -> None:
    """Of a phase's current in a disturbance what its samples leave of its phasor, over half a cycle."""
    if not q.disturbed:
        q.left[phase] = q.left2[phase] = 0.0
        return
    left = q.sample[3 + phase] - SQRT2 * (q.x[3 + phase] * q.turn).real
    q.left[phase] += 2.0 * (left - q.left[phase]) / g.cycle
    q.left2[phase] += 2.0 * (left * left - q.left2[phase]) / g.cycle


@njit
def watch(g: Record, q: Record, sample: NDArray) -> None:
    """One sample, from the transformer: ``q.suspected``, the mask of phases whose voltage has gone and their
    current is as it was; after half a cycle they are not proven."""
    before2 = size2(positive_sequence(q.memory.reference))
    q.gone_with *= q.disturbed
    for phase in range(3):
        bit, count = 1 << phase, q.voltageless[phase]
        q.current_then[phase] *= q.memory.rotor
        had2 = q.voltage2_then[phase] if 0 < 2 * count <= g.cycle else size2(q.x[phase])
        limit2 = 2.0 * max(NOTHING[0] ** 2 * had2, NOTHING[1] ** 2 * before2)
        if not sample[phase] * sample[phase] <= limit2 or not (q.closed >> phase) & 1:
            q.voltageless[phase] = 0
            q.suspected &= ~bit
            follow(g, q, phase)
            continue
        if count == 0:
            q.current_then[phase], q.voltage2_then[phase] = q.x[3 + phase], had2
            q.quiet_then[phase] = 1 - q.disturbed
            q.moving_then[phase] = is_moving(g, q, phase)
            q.residual[phase] = q.residual2[phase] = 0.0
        q.voltageless[phase] = count = count + 1
        if 2 * count > g.cycle + 1:
            follow(g, q, phase)
            continue
        residual = q.sample[3 + phase] - SQRT2 * (q.current_then[phase] * q.turn).real
        q.residual[phase] += residual
        q.residual2[phase] += residual * residual
        if SUSPECTED * count < g.cycle:
            continue
        if has_changed(g, q, phase, before2):
            q.voltageless[phase] = g.cycle
            q.suspected &= ~bit
            q.gone_with |= bit * q.disturbed
        elif 2 * count >= g.cycle:
            q.proven &= ~bit
        else:
            q.suspected |= bit


@njit
def is_moving(g: Record, q: Record, phase: int) -> bool:
    """Whether the phase's voltage or current has changed in a disturbance so young that its phasors are on
    their way, and tell nothing of what a voltage was that goes then."""
    if not q.disturbed or q.memory.age >= max(g.settled, 3 * g.cycle // 4):
        return False
    reference = q.memory.reference
    if size2(q.d[phase]) > voltage_limit2(g, reference):
        return True
    return size2(q.d[3 + phase]) > current_limit2(g, reference)


@njit
def has_changed(g: Record, q: Record, phase: int, before2: float) -> bool:
    """Whether the phase's current has, since its voltage went; or there was too little of that to tell."""
    had2, then2, count = q.voltage2_then[phase], size2(q.current_then[phase]), q.voltageless[phase]
    least = HAD[1] if g.in_front or not g.ideal_vt or (q.gone_with >> phase) & 1 else HAD[0]
    if q.moving_then[phase] or not had2 > least**2 * before2 > 0.0:
        return True
    size = largest_current(q.recent, phase, max(g.values // 12, 1))
    if size * size < 2.0 * CURRENT_GONE**2 * then2:
        return not (q.suspected >> phase) & 1  # with it, as a line that is opened; later, lost as well
    limit2 = current_limit2(g, q.memory.reference)
    if q.quiet_then[phase] and q.disturbed and 4 * count <= g.cycle and size2(q.d[3 + phase]) > limit2:
        return True  # as soon as zones can see it
    rings = q.left2[phase] - q.left[phase] ** 2
    variance = q.residual2[phase] / count - (q.residual[phase] / count) ** 2 - RINGS * rings
    part = math.sqrt(had2 / before2)
    part = min(part / (1.0 - part), MOST) if part < 1.0 else MOST
    least2 = max((CHANGES * part) ** 2, LEAST_CHANGE**2) * then2
    return variance > max(least2, CHANGES**2 * limit2)


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
