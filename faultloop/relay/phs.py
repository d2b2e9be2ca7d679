"""PHS: which loop the fault is in, from what the fault added.

Phase-phase changes contain no zero sequence; with equal positive- and negative-sequence networks they
depend on r = dI2 / dI1 alone, and so not on load, fault resistance or infeed:

    A-G     r = 1                    |d_bc| = 0, |d_ab| = |d_ca|
    B-C     r = -1                   |d_bc| = 2 |d_ab| = 2 |d_ca|
    B-C-G   r = -Z0 / (Z0 + Z2)      |d_bc| greatest, the others more than half of it
    A-B-C   r = 0                    all equal, no negative or zero sequence

The measure is |dV|^2 + |Z1|^2 |dI|^2: behind a strong source the current carries it, behind a weak one the
voltage does, for a forward or reverse fault alike.  The changes are against the memory's reference, so an
open pole or a load is not taken for a fault.  Ge Yaozhong (1996) and Benmouyal and Mahseredjian (2001)
select by superimposed phase-phase currents; the voltage term is ours, for weak infeed.
"""

from __future__ import annotations

from faultloop.jit import njit
from faultloop.relay.memory import A2, A, size2, weight

STILL = 0.08
"""Of the whole change, within a sixteenth of a cycle."""
LOOP_MASK = (0, 1, 2, 4, 8, 16, 32, 56)
"""Loops released by fault type."""


@njit
def sequences(x, out):
    """v0 v1 v2 i0 i1 i2 of six phasors, phase A (Fortescue)."""
    for k in (0, 3):
        a, b, c = x[k], x[k + 1], x[k + 2]
        out[k] = (a + b + c) / 3
        out[k + 1] = (a + A * b + A2 * c) / 3
        out[k + 2] = (a + A2 * b + A * c) / 3


@njit
def classify(c, d, change):
    """Fault type 1 .. 7 from the change of the phasors."""
    z2 = size2(c.z1)
    ab = size2(d[0] - d[1]) + z2 * size2(d[3] - d[4])
    bc = size2(d[1] - d[2]) + z2 * size2(d[4] - d[5])
    ca = size2(d[2] - d[0]) + z2 * size2(d[5] - d[3])
    zero = size2(change[0]) + z2 * size2(change[3])
    positive = size2(change[1]) + z2 * size2(change[4])
    negative = size2(change[2]) + z2 * size2(change[5])
    limit = c.three_phase**2 * positive
    if negative < limit and zero < limit:
        return 7
    if zero > 0.01 * positive:  # a tenth: there is ground in it, so it may be one phase
        limit = c.single_phase**2
        if bc < limit * min(ab, ca):
            return 1
        if ca < limit * min(ab, bc):
            return 2
        if ab < limit * min(bc, ca):
            return 3
    if ab >= bc and ab >= ca:
        return 4
    return 5 if bc >= ca else 6


@njit
def classify_without_load(c, s):
    """The type if the load had gone: the currents as they are, the voltages' change."""
    d = s.d.copy()
    change = s.change.copy()
    for k in range(3, 6):
        d[k] = s.x[k]
        change[k] = s.sequence[k]
    return classify(c, d, change)


@njit
def select(c, s):
    """One sample of the phase selection, during a disturbance.

    A type must stand for a sixteenth of a cycle while the phasors stand still, or for a cycle while
    the estimator is still on its way to the fault's state: on the way each phase has its own transient,
    and a three-phase fault can look like a two-phase one.  Once settled, the type is changed only while
    something moves - a slow swing during a long fault is no new fault - and not where the far end's opening
    explains it, which takes the load away from the healthy phases.
    """
    p = s.selection
    candidate = classify(c, s.d, s.change)
    settled = p.fault != 0 and s.memory.age >= 2 * c.cycle
    if settled and candidate != p.fault and classify_without_load(c, s) == p.fault:
        candidate = p.fault
    if candidate != p.candidate:
        p.candidate = candidate
        p.count = 0
    still = s.memory.drift < STILL**2 * weight(c, s.d)
    p.count += 16 if still or candidate == 7 else 1
    if p.count >= c.cycle and (s.memory.moving or not settled):
        p.fault = candidate


@njit
def released(c, s):
    """Mask of the loops that may start: those of the fault type, without dead poles.

    A pole is dead where the breaker says so or it carries no current: in the dead time of a single-pole trip
    its loops see what the other phases induce.
    """
    mask = LOOP_MASK[s.selection.fault]
    if mask == 0:
        return mask
    for phase in range(3):
        if not (s.closed >> phase) & 1 or size2(s.x[3 + phase]) < c.open_current**2:
            mask &= ~((1 << phase) | (8 << phase) | (8 << ((phase + 2) % 3)))
    return mask
