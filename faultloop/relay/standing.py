"""Loops that stand still in a power swing.

Near a swing's centre a fault changes next to nothing: the voltage is gone without one, too.  But a loop that
is shorted is a piece of the line, v = m (R i + L di/dt), whatever slips, while the resistance of any other
one goes on with the swing.  `piece` fits that equation over a cycle.  What it leaves is a loop's resistance,
in mean and way: of a swing that passes zero in the window's middle still way / sqrt(12).  Of 60 drawn swings
of 0.5 to 7 Hz without a fault none left less than 0.59 of that; of bolted faults near the centre all leave
less than 0.2 a cycle after they have begun.  Noise adds to what is left, and so only makes a loop stand less.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from faultloop.jit import njit
from faultloop.relay.loop_fit import BEHIND, Drop, gather
from faultloop.relay.memory import third

Record = Any
STANDS = 0.25
"""Of what a loop that swings leaves at least: below it, it stands still."""
DOUBT = 2.0
"""How much what is left counts against the depth."""
PHASE_LOOPS = 0b111000


@njit
def piece(g: Record, q: Record, drop: Drop, loop: int) -> tuple[float, float]:
    """A loop over the last cycle as a piece of the line and nothing else: how much of ``drop`` [ohm, and its
    part for the residual current], and what that leaves, root mean square over the drop's."""
    mean = max(g.values // 12, 1)
    uu, uv, vv, _, _, _, _, _, _ = gather(g, q.recent, drop, loop, (mean, 1), g.values - mean)
    if not uu > 0.0:
        return np.inf, np.inf
    return uv / uu, math.sqrt(max(vv - uv * uv / uu, 0.0) / uu)


@njit
def standing(g: Record, q: Record, pace: float) -> int:
    """Mask of the loops that stand still in a swing that goes by ``pace`` on the sphere in half a cycle."""
    drop, mask = (g.z1, third(g.z0 - g.z1)), 0
    for loop in range(6):
        m, left = piece(g, q, drop, loop)
        way = pace * (1 + m * m)  # of the impedance in a cycle, over the line's, by the projection's scale
        if left < STANDS * way / math.sqrt(12):
            mask |= 1 << loop
    return mask


@njit
def standing_type(g: Record, q: Record) -> int:
    """1 .. 6 of a fault whose loops stand still: the pair, with ground or without, or the phase."""
    drop, found, least = (g.z1, third(g.z0 - g.z1)), 0, np.inf
    mask = q.standing & PHASE_LOOPS if q.standing & PHASE_LOOPS else q.standing
    for loop in range(6):
        if (mask >> loop) & 1:
            _, left = piece(g, q, drop, loop)
            if found == 0 or left < least:
                found, least = loop + 1, left
    return found


@njit
def standing_depth(g: Record, q: Record, drop: Drop, loop: int, direction: int) -> float:
    """m of a zone in a swing by a loop as a piece of the line, with what is left, and so a resistance, added:
    by the samples, as an estimator takes a fault that changes little for a part of the swing, and drifts."""
    m, left = piece(g, q, drop, loop)
    if direction == 0:
        m = abs(m)
    return m + DOUBT * left if m > -BEHIND[0] else np.inf
