"""How V1 / I1 moves, snapshot by snapshot: what a swing, a fault's leap and an estimate that rings do to it.

A swing goes on steadily, a fault leaps and its clearing leaps again.  What rings on long lines after a
three-phase fault leaps in the estimate as well, for 50 ms and more, but not in the samples: three pairs that
are a piece of the line stay one.  So an estimate that moves by more than these allow rings, and its motion
is neither a clearing's nor a swing's.
"""

from __future__ import annotations

import math
from typing import Any

from faultloop.jit import njit
from faultloop.relay import swing
from faultloop.relay.loop_fit import fit, gather, window
from faultloop.relay.memory import size2
from faultloop.relay.standing import ASIDE

Record = Any
QUIET, SWINGING, FAULT = range(3)
"""Of `faultloop.relay.functions.rpsb`."""
STEADY = 0.6
"""Bend over way of half a cycle: above it the motion is none of a swing's (of 7 Hz it is 0.45)."""
CLEARED, CLEARED_CYCLES, RESTS = 0.2, 3, 0.04
"""Way of a quarter of a cycle in a disturbance older than a cycle: perhaps its clearing, which a swing
follows.  For so long, and while a balanced state moves so far in half a cycle, it starts no further zone."""
LEAP, LEAP_CYCLES = 0.5, 2.5
"""Way of a quarter of a cycle in the first half cycle of a disturbance that is a fault's; so long from its
beginning its motion is none of a swing's.  Later one may have begun, by the fault's clearing."""
FAR, FAR_CYCLES = 0.05, 8
"""Way of half a cycle outside the outer box in the first cycles of all: an estimator that settles to a
frequency 5 Hz off makes 0.02, which would be a swing of 0.3 Hz."""
SLIDES, SLIDES_CYCLES = 0.02, 1
"""Way of half a cycle, and for so long steadily, later than a leap's: sources that slip in a fault."""
FASTER = 1.2
"""Times its pace: no swing gains more within a cycle."""
RINGS = 0.5
"""Of what a swing with the estimate's motion leaves in the samples: where all pairs leave less, it rings.  At
320 relays in drawn swings on Bergeron lines all left more from 10 ms after the fault's clearing on."""


@njit
def place(g: Record, q: Record, c: Record, w: Record) -> None:
    """Where V1 / I1 is: beside the line's angle, along it; in the outer and the inner box."""
    v, i = q.sequence[1], q.sequence[4]
    w.in_outer = w.in_inner = 0
    if size2(i) < c.minimum**2:
        return
    z = v / i * g.z1.conjugate() / abs(g.z1)
    w.along, w.beside = z.real, z.imag
    apart = c.outer - c.inner
    if abs(z.imag) < c.outer and -c.reverse - apart < z.real < c.forward + apart:
        w.in_outer = 1
        w.in_inner = 1 if abs(z.imag) < c.inner and -c.reverse < z.real < c.forward else 0


@njit
def rings(g: Record, q: Record, w: Record) -> bool:
    """Whether the estimate moves while the samples do not: each pair is a piece of the line all along, no
    more resistance with it than a fault's."""
    way = max(2 * w.quick, w.speed)
    length = window(g, q.memory.age)
    mean = max(length // 8, 1)
    for pair in range(3, 6):
        sums = gather(g, q.recent, (g.z1, 0j), pair, (mean, mean, mean), length - 3 * mean + 2)
        m, left, r = fit(sums, -1 if sums[1] < 0.0 else 1)
        r = abs(r) / abs(g.z1)
        limit = RINGS * way * (1 + m * m + r * r) / math.sqrt(12)
        if not left < limit or r > ASIDE * (1 + abs(m)):
            return False
    return True


@njit
def observe(g: Record, q: Record, c: Record, w: Record) -> None:
    """At a snapshot: how fast and how steadily the impedance moves."""
    lag = g.snapshots // 4
    m = q.memory
    now, before, earlier = (
        swing.point_ago(g, m, 0),
        swing.point_ago(g, m, lag),
        swing.point_ago(g, m, 2 * lag),
    )
    w.speed = swing.distance(now, before)
    w.past = swing.distance(before, earlier)
    w.quick = swing.distance(now, swing.point_ago(g, m, lag // 2))
    may_ring = w.state == QUIET and q.disturbed and 2 * w.quick > RESTS
    w.rings = 1 if may_ring and rings(g, q, w) else 0
    if not q.disturbed:
        w.leapt = w.cleared = 0
    elif 2 * q.memory.age <= g.cycle and w.quick > LEAP:
        w.leapt = 1
    elif q.memory.age > g.cycle and w.quick > CLEARED and not w.rings:
        w.cleared, w.after = 1, CLEARED_CYCLES * g.cycle
    bent = swing.bend(now, before, earlier)
    balanced = w.unbalanced == 0 and size2(q.sequence[4]) >= c.minimum**2
    settles = q.memory.seen <= FAR_CYCLES * g.cycle and not w.in_outer
    least = max(c.least, FAR) if settles else c.least
    moves = balanced and w.speed >= least
    steady = moves and bent <= STEADY * w.speed
    w.steady = w.steady + g.snapshot if steady else 0
    w.way = w.way + w.speed / lag if steady else 0.0
    slides = w.speed >= SLIDES and bent <= STEADY * w.speed and q.memory.age > LEAP_CYCLES * g.cycle
    w.slid = w.slid + g.snapshot if slides and q.disturbed else 0
    w.rest = 0 if 4 * w.steady >= g.cycle else w.rest + g.snapshot
    between = moves and w.in_outer and not w.in_inner
    w.between = w.between + g.snapshot if between else 0
    older = swing.distance(earlier, swing.point_ago(g, m, 3 * lag))
    if w.state == QUIET:
        w.pace = older
    elif w.state == SWINGING and w.off == 0 and q.standing == 0:
        w.pace += 0.1 * (min(older, FASTER * w.pace + c.least) - w.pace)  # no fault's end is in it


@njit
def leaps(g: Record, q: Record, w: Record) -> bool:
    """Whether what moves is a fault's: it began with a leap, and not long ago."""
    return w.leapt and q.disturbed and q.memory.age <= LEAP_CYCLES * g.cycle


@njit
def slide(g: Record, q: Record, w: Record) -> None:
    """One sample of a disturbance in which no swing has been found: whether sources slip in it."""
    if w.state != QUIET:  # ``told`` is then that of a fault in the swing
        w.slides = 0
        return
    if not q.disturbed:
        w.slides = w.told = 0
        return
    w.slides |= w.slid >= SLIDES_CYCLES * g.cycle
    w.told |= w.unbalanced > g.cycle
    w.silent = 0 if w.unbalanced else w.silent + 1


@njit
def is_left(g: Record, w: Record, fresh: bool) -> bool:
    """Whether a fault in which sources slip has gone, or has become another one."""
    return w.slides and ((fresh and w.quick > CLEARED) or (w.told and 8 * w.silent >= g.cycle))
