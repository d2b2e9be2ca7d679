"""What has changed between two sets of line differential a cycle apart, at every end of the line.

A fault outside changes the currents of all ends, and their sum stays.  A fault inside changes the current of
every end that carries any, and the sum.  A current transformer's circuit that opens takes one current of one
end away, or all three, and changes nothing else.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from faultloop.jit import njit
from faultloop.relay.memory import size2

Record = Any

JUMP = 0.5
"""Of the pickup of a phase: a change of half the ends' currents that is a fault's, beside ..."""
OFF_NOMINAL = 0.5
"""... so much of what flowed before: 4 Hz off 50 Hz a phasor turns by 29 degrees in a cycle."""
LESS = 0.6
"""Of what flowed before: a fault outside takes no more than this away."""
QUIET, LOUD = 0.1, 0.5
"""Of that change: the sum's is below the first for a fault outside, above the second for one inside."""
CARRIES = 0.1
"""Of the pickup: what a phase carries whose circuit can be seen to open, and below which it is open."""
FALLS = 0.2
"""Of what flowed before: the full-cycle filter shows a circuit that opens as a fall by an eighth a set."""
STRAIGHT = 0.25
"""Of the fall: what is across the current of before, which an open circuit does not turn."""
ALONE = 0.1
"""Of the fall: the change of any other current of the line."""
THROUGH = 0.5
"""Of what flowed before: what the other ends did not carry on; nothing is known of a line open at one end."""
FILTER = 9
"""Sets that the full-cycle filter takes to show all of a current that is there again, and one."""


@njit
def jump_of(c: Record, w: Record, phase: int, ends: int) -> int:
    """1: the currents of a phase have changed as by a fault outside, 2: as by one inside, 0: neither."""
    total, size, before, now = 0j, 0.0, 0.0, 0.0
    for k in range(ends):
        total += w.change[phase, k]
        size += abs(w.change[phase, k]) / 2
        before += abs(w.before[phase, k]) / 2
        now += abs(w.before[phase, k] + w.change[phase, k]) / 2
    if now < LESS * before or size < JUMP * c.rule[0].pickup + OFF_NOMINAL * before:
        return 0  # something was switched off, or nothing happened
    if w.jump[phase] == 0:
        if abs(total) < QUIET * size:
            return 1
        if abs(total) > LOUD * size:
            return 2
    return int(w.jump[phase])


@njit
def watch_outside(c: Record, w: Record, ends: int) -> None:
    """Keeps ``w.jump`` and ``w.external``.

    Of complex changes, as a fault may turn the load around and leave sizes alone.  A transformer that
    saturates after some milliseconds makes the sum grow then; what was found before counts."""
    outside = inside = 0
    for phase in range(3):
        w.jump[phase] = jump_of(c, w, phase, ends)
        # every phase that has changed says so: a fault inside beside one outside is not hidden
        outside += w.jump[phase] == 1
        inside += w.jump[phase] == 2
    if outside and not inside and not w.declared:
        w.external = c.external
        w.declared = 1
    if not outside:
        w.declared = 0


@njit
def falls(c: Record, w: Record, phase: int, end: int, ends: int) -> bool:
    """Whether this current falls straight towards zero."""
    before, change = w.before[phase, end], w.change[phase, end]
    had2 = size2(before)
    if had2 < (CARRIES * c.rule[0].pickup) ** 2 or size2(change) < FALLS**2 * had2:
        return False
    total = 0j
    for k in range(ends):
        total += w.before[phase, k]
    if size2(total) > THROUGH**2 * had2:
        return False
    part = change * before.conjugate()
    return part.real < 0.0 and abs(part.imag) <= -STRAIGHT * part.real and -part.real <= 1.1 * had2


@njit
def opening(c: Record, w: Record, end: int, ends: int) -> int:
    """Mask of the phases whose current falls by itself at an end: no other current of the line changes."""
    found, least2 = 0, np.inf
    for phase in range(3):
        if falls(c, w, phase, end, ends):
            found |= 1 << phase
            least2 = min(least2, size2(w.change[phase, end]))
    for phase in range(3):
        for k in range(ends):
            own = k == end and ((found | w.opened[end]) >> phase) & 1
            if not own and size2(w.change[phase, k]) > ALONE**2 * least2:
                return 0
    return found


@njit
def watch_circuits(c: Record, w: Record, ends: int) -> None:
    """Keeps ``w.opened``, the phases whose current an end has lost: until all of a cycle has one again."""
    least2 = (CARRIES * c.rule[0].pickup) ** 2
    for end in range(ends):
        found = opening(c, w, end, ends)
        for phase in range(3):
            has = size2(w.before[phase, end] + w.change[phase, end]) >= least2
            w.back[end, phase] = w.back[end, phase] + 1 if has else 0
            stays = (w.opened[end] >> phase) & 1 and w.back[end, phase] <= FILTER
            if stays or (found >> phase) & 1:
                w.opened[end] |= 1 << phase
            else:
                w.opened[end] &= ~(1 << phase)
