"""Which phases' currents can be relied on.

A pole that is closed and carries nothing while the others carry load has lost its current transformer - a
shorted or open secondary circuit, a channel that nobody wired - or its conductor; from here the two look the
same.  Its loops measure nothing, and the residual current is wrong by what is missing: no ground loop and no
stage on 3I0 or I2 can be relied on.  It is found

- in quiet, where a phase has none and the others are not balanced without it;
- as it happens, where the current of one phase is gone and nothing else has changed;
- in a fault that nobody was warned of, as there was no load: a phase whose voltage has fallen as much as the
  others' and that carries nothing while they do.

All three that go are a load's that goes, as a rule, and nothing is missing.  But a load is switched off pole
by pole, each at its current's zero; what takes all three away in the middle of their wave, with the breaker
closed and every voltage as it was, is the way to the relay (``q.vanished``): a plug, a card, a test switch.
A converter that blocks looks the same.
"""

from __future__ import annotations

import cmath
import math
from typing import Any

from faultloop.jit import njit
from faultloop.relay.memory import current_limit2, size2, voltage_limit2
from faultloop.relay.recent import LENGTH, SQRT2

Record = Any

GROUND_LOOPS, ALL_PHASES = 0b000111, 0b111
CARRIES = 2.0
"""Of the current below which a pole is open: above it one carries load."""
UNBALANCE = 0.25
"""I2 or I0 over I1: below it nothing is missing."""
LOADED = 4.0
"""Of the current below which a pole is open: below it an end of the current is not sharp."""
GONE, ALIKE = 0.05, 0.15
"""Of a phase current's crest: a value below it is none; one that differs by less is as before."""
IN_THE_FAULT = 0.5
"""Of the greatest change of a phase voltage, and of the voltage's fall in the change."""


@njit
def carried(g: Record, x: Any) -> int:
    """Mask of the phases that carry load."""
    mask = 0
    for phase in range(3):
        if size2(x[3 + phase]) > (CARRIES * g.open_current) ** 2:
            mask |= 1 << phase
    return mask


@njit
def watch(g: Record, q: Record) -> None:
    """In quiet: keep the mask of phases whose current is missing, ``q.missing``; any ends ``q.vanished``."""
    q.vanished &= carried(g, q.x) == 0
    i0, i1, i2 = size2(q.sequence[3]), size2(q.sequence[4]), size2(q.sequence[5])
    unbalanced = carried(g, q.x) != 0 and max(i0, i2) > UNBALANCE**2 * i1
    for phase in range(3):
        if size2(q.x[3 + phase]) > g.open_current**2:
            q.missing &= ~(1 << phase)
        elif unbalanced and (q.closed >> phase) & 1:
            q.missing |= 1 << phase


@njit
def watch_change(g: Record, q: Record) -> None:
    """In a disturbance: one that has just lost it, and one that comes back."""
    for phase in range(3):
        if size2(q.x[3 + phase]) > (CARRIES * g.open_current) ** 2 and not (q.dead >> phase) & 1:
            q.missing &= ~(1 << phase)
    q.vanished &= (carried(g, q.x) & ~q.dead) == 0
    lost = q.dead & q.closed & carried(g, q.memory.reference)
    if lost == 0 or others_changed(g, q, lost):
        return
    if lost != ALL_PHASES:
        q.missing |= lost
    elif at_once(g, q):
        q.vanished = 1


@njit
def at_once(g: Record, q: Record) -> bool:
    """Whether all three currents were as before for a quarter of a cycle and then, within a twelfth, gone.

    Of a breaker's poles the last one parts a sixth of a cycle after the one before.
    """
    reference, r = q.memory.reference, q.recent
    for phase in range(3):
        if size2(reference[3 + phase]) < (LOADED * g.open_current) ** 2:
            return False
    angle = g.turn_per_value + cmath.phase(q.memory.rotor) * g.stride
    late = r.count + 0.5 * (g.stride - 1)  # of the newest value, in samples
    at = q.turn * cmath.rect(1.0, -angle / g.stride * late)
    back = cmath.rect(1.0, -angle)
    between = alike = 0
    for j in range(g.values):
        gone = as_before = True
        for phase in range(3):
            value = r.value[(r.head - j) % LENGTH, 3 + phase]
            peak = SQRT2 * math.sqrt(size2(reference[3 + phase]))
            gone &= abs(value) < max(SQRT2 * g.open_current, GONE * peak)
            as_before &= abs(value - SQRT2 * (reference[3 + phase] * at).real) < ALIKE * peak
        at *= back
        if gone and not (between or alike):
            continue
        if as_before:
            alike += 1
            if 4 * alike >= g.values:
                return True
        elif alike:
            return False
        else:
            between += 1
            if 12 * between > g.values:
                return False
    return False


@njit
def others_changed(g: Record, q: Record, lost: int) -> bool:
    """Whether a voltage has changed, or the current of a phase that has not lost it."""
    voltage, current = voltage_limit2(g, q.memory.reference), current_limit2(g, q.memory.reference)
    for phase in range(3):
        if size2(q.d[phase]) > voltage:
            return True
        if not (lost >> phase) & 1 and size2(q.d[3 + phase]) > current:
            return True
    return False


@njit
def without_current(q: Record) -> int:
    """Mask of closed poles without current whose phases are in the fault."""
    greatest = max(size2(q.d[0]), size2(q.d[1]), size2(q.d[2]))
    mask = 0
    for phase in range(3):
        change, before = q.d[phase], q.memory.reference[phase]
        fall = -(change * before.conjugate()).real
        deep = size2(change) > IN_THE_FAULT**2 * greatest
        if deep and fall > 0.0 and fall * fall > IN_THE_FAULT**2 * size2(change) * size2(before):
            mask |= 1 << phase
    return mask & q.dead & q.closed


@njit
def blocked_loops(q: Record) -> int:
    """Mask of the ground loops, where one of the three currents is missing."""
    return GROUND_LOOPS if q.missing or without_current(q) else 0
