"""Voltages that are lost while a fault is on.

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
