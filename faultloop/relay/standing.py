"""Loops that stand still in a power swing.

Near a swing's centre a fault changes next to nothing: the voltage is gone without one, too.  But a loop that
is shorted is a piece of the line and a resistance, v = m (R i + L di/dt) + r if, whatever slips, while the
resistance of any other one goes on with the swing.  So what a fit of that equation to the samples of a cycle
leaves is, in a swing, the way of the impedance in that time over sqrt(12).  Of 50 drawn swings of 0.5 to 7
Hz without a fault none left less than 0.50 of that; of faults near the centre all leave less than 0.2 a cycle
after they have begun.  Noise adds to what is left, and so only makes a loop stand less.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from faultloop.jit import njit
from faultloop.relay.loop_fit import BEHIND, Drop, Sums, fit, gather
from faultloop.relay.memory import A2, A, size2, third

Record = Any
STANDS = 0.25
"""Of what a loop that swings leaves: below it, it stands still ..."""
ASIDE = 0.1
"""... where its resistance is below this part of the line with the place: a fault's and not a load's."""
LEFT = 0.01
"""Enough after a jump."""
DOUBT = 2.0
"""How much what is left counts against the depth."""
PHASE_LOOPS = 0b111000
GROUND = 0.25
"""Of I2: above it I0 is that of a fault to ground."""
TURNS = (complex(1.0, 0.0), A, A2)
"""Of the negative sequence, from phase A to each."""


@njit
def last_cycle(g: Record, q: Record, drop: Drop, loop: int) -> Sums:
    """A loop's sums over the last cycle (`gather`); ``drop``: of the reach, and its part for the residual."""
    mean = max(g.values // 12, 1)
    return gather(g, q.recent, drop, loop, (mean, 1, 1), g.values - mean)


@njit
def piece(g: Record, q: Record, drop: Drop, loop: int) -> tuple[float, float]:
    """A loop over the last cycle as a piece of the line and nothing else: how much of ``drop``, and what that
    leaves, root mean square over the drop's."""
    uu, uv, vv, _, _, _, _, _, _ = last_cycle(g, q, drop, loop)
    if not uu > 0.0:
        return np.inf, np.inf
    return uv / uu, math.sqrt(max(vv - uv * uv / uu, 0.0) / uu)


@njit
def standing(g: Record, q: Record, pace: float, jumped: bool) -> int:
    """Mask of the loops that stand still in a swing that goes by ``pace`` on the sphere in half a cycle, or
    has ``jumped`` out of it almost a cycle ago: then a slow one is no measure of what stands still."""
    drop, mask = (g.z1, third(g.z0 - g.z1)), 0
    for loop in range(6):
        sums = last_cycle(g, q, drop, loop)
        m, left, r = fit(sums, 1)
        if r == 0.0:
            m, left, r = fit(sums, -1)
        r = abs(r) / abs(g.z1)
        way = pace * (1 + m * m + r * r)  # of the impedance in a cycle, over the line's, from the sphere's
        limit = max(STANDS * way / math.sqrt(12), LEFT if jumped else 0.0)
        if left < limit and r < ASIDE * (1 + abs(m)):
            mask |= 1 << loop
    return mask


@njit
def opposite_pair(i0: complex, i2: complex) -> int:
    """Of the phase in which I2 and I0 agree: the pair beside it, as a mask; 0 with little I0.  They agree in
    the faulted phase of one, and in the healthy one of a pair to ground."""
    if size2(i0) < GROUND**2 * size2(i2):
        return 0
    pair, best = 0, -np.inf
    for k in range(3):
        along = (TURNS[k] * i2 * i0.conjugate()).real
        if along > best:
            pair, best = 8 << (k + 1) % 3, along
    return pair


@njit
def of_one_fault(standing: int, opposite: int) -> int:
    """Of the loops that stand those that are a fault's: a pair that stands without both its phases to ground,
    while one phase does, swings past; but not the pair ``opposite``, which I2 and I0 say it may be."""
    ground = standing & ~PHASE_LOOPS
    if ground == 0:
        return standing
    mask = 0
    if opposite and standing & opposite:
        return standing & opposite
    for pair in range(3):
        phases = 1 << pair | 1 << (pair + 1) % 3
        if (standing >> (3 + pair)) & 1 and ground & phases == phases:
            mask |= 8 << pair
    return mask if mask else ground


@njit
def standing_type(g: Record, q: Record) -> int:
    """1 .. 6 of a fault whose loops stand still: the pair, with ground or without, or the phase."""
    drop, found, least = (g.z1, third(g.z0 - g.z1)), 0, np.inf
    mask = of_one_fault(q.standing, opposite_pair(q.sequence[3], q.sequence[5]))
    for loop in range(6):
        if (mask >> loop) & 1:
            _, left = piece(g, q, drop, loop)
            if found == 0 or left < least:
                found, least = loop + 1, left
    return found


@njit
def standing_place(g: Record, q: Record) -> tuple[float, float]:
    """Per unit of the line from the relay, by the loop that stands still best, and what that leaves: of a
    resistance alone more than its place."""
    return piece(g, q, (g.z1, third(g.z0 - g.z1)), standing_type(g, q) - 1)


@njit
def standing_depth(g: Record, q: Record, drop: Drop, loop: int, direction: int) -> float:
    """m of a zone in a swing by a loop as a piece of the line, with what is left, and so a resistance, added:
    by the samples, as an estimator takes a fault that changes little for a part of the swing, and drifts."""
    m, left = piece(g, q, drop, loop)
    if direction == 0:
        m = abs(m)
    return m + DOUBT * left if m > -BEHIND[0] else np.inf
