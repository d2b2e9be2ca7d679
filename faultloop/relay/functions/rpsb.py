"""RPSB: power-swing blocking and out-of-step tripping.

A swing moves V1 / I1 steadily through the zones; a fault jumps.  Around all zones lie two boxes along the
line's angle, the inner and the outer one.  A swing is found where the currents are balanced and the
impedance is in the outer box, and either has been between the two for ``crossing_ms`` (``next_ms`` in the
swings after the first), or has moved steadily for ``steady_ms``: on the sphere of `faultloop.relay.swing`
faster than a slip of ``least_slip_hz`` and with a bend of less than its way, half cycle after half
cycle.  The second finds the fast ones, which cross in less time than an estimator needs to rise.  A zone
that has started already is only given up for a longer motion.

From then on the swing is what is normal: zones are blocked, and the memory's reference goes along with the
swing. So a fault in it is a change against that, with a type and a direction as any other.  It is a fault
where

- I2 or I0 exceeds ``unbalance_pu`` of the greatest I1 of late for an eighth of a cycle, I2 with an
  allowance for the speed: balanced currents that slip have an image in the estimate;
- the impedance jumps into the outer box, or in it: it goes a way in a quarter of a cycle for which the
  swing would have needed much longer;
- a loop stands still as a piece of the line for an eighth of a cycle (`faultloop.relay.standing`), while
  the swing goes on: near the swing's centre nothing else shows;
- it has been in the outer box for ``release_s``.

While a pole is open I2 and I0 are the open pole's, in a ratio to I1 that no slip changes, and V1 / I1 goes
along a circle as without: a swing is then found in spite of them, and they tell no fault in it.  What tells
one are the loops of the closed poles, where they stand.

Before a swing is found, a balanced state that still moves fast starts no zone, unless it began to by a leap
that no swing makes: then it is a fault, whose estimate settles or rings, and no swing is found in that.  Nor
does it wait where the estimate alone rings (`faultloop.relay.swing_motion`).

The swing is over ``hold_ms`` after the impedance has left the outer box.

Out of step: ``trip = "way-in"`` when a swing enters the inner box, ``"way-out"`` when it leaves the outer
box on the other side than it came from, which no stable one does, the ``slips``-th time.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from faultloop.jit import njit
from faultloop.relay import memory, swing
from faultloop.relay.events import Event, Names
from faultloop.relay.functions.function import Function
from faultloop.relay.memory import size2
from faultloop.relay.quantities import THREE_PHASE, Record, indicate, publish, request_trip
from faultloop.relay.standing import ASIDE, PHASE_LOOPS, standing
from faultloop.relay.swing import TRACK
from faultloop.relay.swing_motion import (
    CLEARED,
    FAULT,
    QUIET,
    RESTS,
    SWINGING,
    is_left,
    leaps,
    observe,
    place,
    slide,
)
from faultloop.relay.swing_rule import Rpsb, check, inner_ohm, polygons, reaches
from faultloop.relay.voltages import loops_of

if TYPE_CHECKING:
    from faultloop.relay.settings import RelaySettings

ALL_POLES = 7
UNBALANCED, JUMPED, STANDS, TOO_LONG = range(1, 5)
CAUSES = ("", "I2 or I0", "a jump", "a loop that stands still", "it has lasted too long")
ALL_ZONES = -1
NO_TRIP, WAY_IN, WAY_OUT = range(3)
JUMP, JUMP_LEAST = 2.5, 0.08
"""Times the swing's own way, and a way on the sphere."""
IMAGE = 0.35
"""Of the way of half a cycle: so much I2 of I1 is what an estimator makes of balanced currents that slip."""
RUSHING = 0.12
"""Way of half a cycle: a balanced state that moves faster starts no zone; a three-phase fault has stopped
by then."""
STARTED, STARTED_WAY, CLEARED_WAY = 2, 0.2, 0.05
"""Times as long a motion takes a started zone back, if it goes so far: an estimator's drift is less.  After a
fault's clearing, perhaps, so far: another fault in its place would stand still."""
OPERATED_CYCLES = 5
SLOWER, SLOWEST = 0.5, 0.01
"""Of the swing's pace, and a way of half a cycle: what has jumped and moves faster does not stand."""
FAINT = 1 / 3
"""Of ``unbalance_pu``: with less I2 and less I0 no loop stands alone, as near the centre one seems to."""


def values(settings: RelaySettings, table: Rpsb) -> dict[str, Any]:
    """Boxes in primary ohm, times in samples, speeds in ways on the sphere in half a cycle."""
    forward, reverse = reaches(settings, table)
    return {
        "inner": inner_ohm(settings, table) * settings.ohm_ratio,
        "outer": table.outer_resistance_ohm * settings.ohm_ratio,
        "forward": forward,
        "reverse": reverse,
        "crossing": settings.samples(table.crossing_ms),
        "next": settings.samples(table.next_ms),
        "steady": settings.samples(table.steady_ms),
        "least": math.pi * table.least_slip_hz / settings.relay.frequency_hz,
        "unbalance": table.unbalance_pu,
        "minimum": settings.amperes(table.minimum_current_a, 20.0),
        "hold": settings.samples(table.hold_ms),
        "release": settings.samples(1000 * table.release_s),
        "trip": ("none", "way-in", "way-out").index(table.trip),
        "slips": table.slips,
    }


@njit
def is_swing(c: Record, q: Record, w: Record) -> bool:
    """Whether what moves is a swing."""
    if w.dwell > c.release or not q.ready:
        return False
    if q.was_started:
        return w.steady >= STARTED * c.steady and w.way >= (CLEARED_WAY if w.cleared else STARTED_WAY)
    crossing = c.next if w.recent > 0 else c.crossing
    return w.steady >= c.steady or w.between >= max(crossing, 1)


@njit
def fault_sign(g: Record, q: Record, c: Record, w: Record, fresh: bool) -> int:
    """What says that there is a fault in the swing; 0: nothing."""
    if 8 * w.unbalanced >= g.cycle:
        return UNBALANCED
    if w.dwell > c.release:
        return TOO_LONG
    if not fresh:
        return 0
    if w.in_outer and 2 * w.quick > JUMP * max(w.pace, w.past) + JUMP_LEAST:
        return JUMPED
    w.stood = w.stood + g.snapshot if w.in_outer and q.standing else 0
    if 8 * w.stood >= g.cycle:
        return STANDS
    return 0


@njit
def out_of_step(g: Record, q: Record, c: Record, w: Record) -> None:
    """Entry and exit of the boxes: slips, and the trip for them."""
    side = 1 if w.beside > 0.0 else -1
    if w.in_outer and not w.was_outer:
        w.side = side
        w.passed = 0
    wanted = 0
    if w.in_inner and not w.passed:
        w.passed = 1
        wanted = w.state == SWINGING and c.trip == WAY_IN
    if w.was_outer and not w.in_outer and w.passed and w.state == SWINGING and side != w.side:
        w.slips += 1
        q.notices += 1
        wanted = c.trip == WAY_OUT and w.slips >= c.slips
    w.was_outer = w.in_outer
    if wanted:
        w.operated = OPERATED_CYCLES * g.cycle
    w.operated = max(w.operated - 1, 0)


@njit
def is_slower(w: Record, way: float) -> bool:
    """Whether what goes such a way in half a cycle is slower than the swing."""
    return way < max(SLOWER * w.pace, SLOWEST)


@njit
def stands(g: Record, q: Record, c: Record, w: Record) -> int:
    """Mask of the loops that stand still; none of an open pole's, and one alone only with I2 or I0.  Of a
    fault that has been found it goes on standing without: at the swing's centre it draws no current."""
    jumped = w.state == FAULT and w.cause == JUMPED and 4 * w.age >= 3 * g.cycle and is_slower(w, w.speed)
    mask = standing(g, q, w.pace, jumped) & ~loops_of(7 & ~q.closed)
    if mask & PHASE_LOOPS == PHASE_LOOPS:
        return mask
    faint = (FAINT * c.unbalance) ** 2 * w.current2
    if max(size2(q.sequence[3]), size2(q.sequence[5])) >= faint:
        return mask
    return mask & q.standing if w.state == FAULT else 0


@njit
def is_on_line(g: Record, w: Record) -> bool:
    """Whether the impedance has jumped on the line, currents balanced, and stays there: what rings on a long
    line may keep its loops from standing still."""
    beside = abs(w.beside) < ASIDE * (abs(g.z1) + abs(w.along))
    still = w.unbalanced == 0 and 2 * w.quick < RESTS
    return w.cause == JUMPED and not w.told and w.in_inner and w.age > g.cycle and beside and still


@njit
def is_over(g: Record, q: Record, c: Record, w: Record) -> bool:
    """Whether a fault in the swing has gone: for three quarters of a cycle nothing says that it is there."""
    says = w.unbalanced > 0 or q.standing != 0 or w.dwell > c.release or is_on_line(g, w)
    w.silent = 0 if says else w.silent + 1
    return 4 * w.silent >= 3 * g.cycle and 4 * w.age >= 5 * g.cycle


@njit
def resume(g: Record, w: Record) -> None:
    """What moves is a swing, again or for the first time."""
    w.state = SWINGING
    w.stood = w.rest = 0
    w.off = g.cycle  # in another cycle the ring holds nothing but the swing


@njit
def end(g: Record, q: Record, w: Record) -> None:
    """The swing is over: what is now is what is normal."""
    w.state = QUIET
    w.slips = 0
    q.notices += 1
    memory.fill(g, q.memory, q.x)


@njit
def next_state(g: Record, q: Record, c: Record, w: Record, fresh: bool) -> None:
    """One sample of the state: quiet, swing, fault in a swing."""
    if w.state == SWINGING:
        w.cause = fault_sign(g, q, c, w, fresh)
        if w.cause:
            w.state = FAULT
            w.age = w.steady = w.between = w.silent = w.apart = w.told = 0
            q.notices += 1
        elif w.outside > c.hold and w.rest > c.hold:
            end(g, q, w)
    elif w.state == QUIET and is_left(g, w, fresh):
        w.state, w.cause = FAULT, UNBALANCED  # perhaps: it is looked at anew
        w.age = w.steady = w.between = w.silent = w.apart = w.told = w.slides = 0
        swing.stay(q, w.track)
        q.notices += 1
    elif fresh and not (w.state == QUIET and leaps(g, q, w)) and is_swing(c, q, w):
        resume(g, w)
        w.pace = w.speed
        w.recent = c.hold
        q.notices += 1
    elif w.state == FAULT and fresh and w.age > g.cycle and w.quick > CLEARED:
        w.cause = UNBALANCED  # another fault, or none any more: nothing of the first one counts
        w.age = w.apart = w.silent = w.told = 0
    elif w.state == FAULT and not q.disturbed:
        w.state = QUIET
        q.notices += 1
    elif w.state == FAULT and is_over(g, q, c, w):
        resume(g, w)
        q.notices += 1


@njit
def hold_back(g: Record, q: Record, w: Record) -> None:
    """Zones that have not started wait while a balanced state moves as fast as a swing that has not been
    found yet."""
    if not w.in_outer or w.unbalanced or w.rings:
        return
    rushes = 2 * w.quick > RUSHING and not q.was_started and not leaps(g, q, w)
    if rushes or (w.after and 2 * w.quick > RESTS):
        q.blocked_zones |= ALL_ZONES & ~q.last_zones


@njit
def lead_fault(g: Record, q: Record, w: Record) -> None:
    """One sample of a fault in a swing, judged by what a swing has none of: negative and zero sequence, and
    loops that stand still.  Until these are there no zone starts: the change against the swing is that of an
    estimator that lags, and its energy, in the samples, is of no side."""
    swing.follow(q.memory, w.track)
    q.memory.calm = q.memory.still = 0
    q.energy.direction = 0
    still = q.standing & PHASE_LOOPS
    one = q.standing != 0 and still != PHASE_LOOPS
    w.apart = g.cycle // 2 if w.unbalanced or one else max(w.apart - 1, 0)
    w.told |= w.unbalanced > g.cycle
    all_still = still == PHASE_LOOPS and w.unbalanced <= g.cycle
    on_line = is_on_line(g, w)
    waits = 4 * w.age < g.cycle and w.cause != STANDS
    waits |= q.standing == 0 and 2 * w.age < 3 * g.cycle and not swing.is_clear(g, q)
    told = w.apart or still == PHASE_LOOPS or on_line or w.cause == TOO_LONG
    gone = w.told and 8 * w.silent >= g.cycle
    if (waits and not on_line) or not told or gone:
        q.swing_fault = swing.YOUNG
        q.blocked_zones = ALL_ZONES
        return
    swing.feed(q)
    q.swing_fault = swing.UNBALANCED if w.apart and not (all_still or on_line) else swing.BALANCED
    swing.without_swing(q, q.fault == THREE_PHASE)
    q.memory.drift = np.inf
    q.memory.age = max(q.memory.age, g.cycle + 1)


@njit
def step(g: Record, q: Record, c: Record, w: Record) -> None:
    """One sample; blocks the zones and lets the memory go along while the swing is on."""
    if q.memory.seen <= g.settling:
        return
    q.swing_fault = 0
    fresh = q.memory.tick == 0
    if w.state == QUIET:
        q.standing = 0
    elif fresh:
        q.standing = stands(g, q, c, w)
    place(g, q, c, w)
    w.dwell = w.dwell + 1 if w.in_outer else 0
    w.outside = 0 if w.in_outer else w.outside + 1
    w.recent = max(w.recent - 1, 0)
    w.after = max(w.after - 1, 0)
    w.current2 = max(size2(q.sequence[4]), w.current2 * (1.0 - 0.25 / g.cycle))
    image = c.unbalance + IMAGE * max(w.pace, w.speed)
    unbalanced = size2(q.sequence[5]) > image**2 * w.current2
    least = 0.5 * c.unbalance if w.state == FAULT and w.cause == JUMPED else c.unbalance
    unbalanced |= size2(q.sequence[3]) > least**2 * w.current2
    w.unbalanced = w.unbalanced + 1 if unbalanced and q.closed == ALL_POLES else 0
    if fresh:
        observe(g, q, c, w)
    slide(g, q, w)
    next_state(g, q, c, w, fresh)
    q.slides = w.slides
    out_of_step(g, q, c, w)
    if w.state == SWINGING:
        w.recent = c.hold
        if fresh:
            w.off = w.off + g.snapshot if swing.is_off(g, q) else 0
            if (w.off == 0 and q.standing == 0) or w.off > 2 * g.cycle:
                swing.fit(g, q.memory, w.track, g.snapshots // 4)
        swing.follow(q.memory, w.track)
        swing.is_normal(g, q)
        q.blocked_zones = ALL_ZONES
    elif w.state == FAULT:
        w.age += 1
        lead_fault(g, q, w)
    else:
        hold_back(g, q, w)
    indicate(q, c.bit + 1, w.state == SWINGING)
    indicate(q, c.bit + 2, w.state == FAULT)
    if w.operated:
        publish(q, c.bit, True, True)
        request_trip(q, c.bit, THREE_PHASE, 1)


def tell(names: Names, was: np.void, now: np.void) -> Iterator[Event]:
    """A swing, a fault in it, a slip, the end."""
    if now["slips"] > was["slips"]:
        yield Event(names.sample, "warning", f"RPSB1 pole slip {int(now['slips'])}")
    if now["state"] == was["state"]:
        return
    if now["state"] == SWINGING:
        yield Event(names.sample, "warning", "RPSB1 power swing: zones blocked")
    elif now["state"] == FAULT:
        text = f"RPSB1 fault in the power swing, by {CAUSES[int(now['cause'])]}: zones released"
        yield Event(names.sample, "warning", text)
    else:
        yield Event(names.sample, "info", "RPSB1 power swing over")


RPSB = Function(
    name="RPSB",
    settings=Rpsb,
    step=step,
    constants=(
        ("inner", "f8"),
        ("outer", "f8"),
        ("forward", "f8"),
        ("reverse", "f8"),
        ("crossing", "i8"),
        ("next", "i8"),
        ("steady", "i8"),
        ("least", "f8"),  # way on the sphere in half a cycle
        ("unbalance", "f8"),
        ("minimum", "f8"),
        ("hold", "i8"),
        ("release", "i8"),
        ("trip", "i8"),
        ("slips", "i8"),
    ),
    values=values,
    state=(
        ("state", "i8"),
        ("cause", "i8"),
        ("age", "i8"),  # samples of the fault in the swing
        ("along", "f8"),  # the impedance along the line's angle [ohm] ...
        ("beside", "f8"),  # ... and beside it
        ("in_outer", "i8"),
        ("in_inner", "i8"),
        ("was_outer", "i8"),
        ("side", "i8"),  # from which it came into the outer box
        ("passed", "i8"),  # it has been in the inner one since
        ("slips", "i8"),
        ("operated", "i8"),  # samples that the trip is asked for
        ("dwell", "i8"),  # samples in the outer box
        ("outside", "i8"),
        ("recent", "i8"),  # samples for which the next swing is no first one
        ("current2", "f8"),  # square of the greatest I1 of late
        ("unbalanced", "i8"),  # samples in a row
        ("speed", "f8"),  # way on the sphere in the last half cycle, ...
        ("past", "f8"),  # ... in the one before, ...
        ("quick", "f8"),  # ... in the last quarter
        ("leapt", "i8"),  # the disturbance began with a leap that no swing makes
        ("cleared", "i8"),  # a later leap in it, perhaps its clearing
        ("rings", "i8"),  # the estimate moves, the samples do not
        ("after", "i8"),  # samples left for which a swing may follow that
        ("pace", "f8"),  # the swing's own
        ("steady", "i8"),  # samples of steady motion
        ("way", "f8"),  # on the sphere, meanwhile
        ("slid", "i8"),  # samples of steady motion in a disturbance, balanced or not ...
        ("slides", "i8"),  # ... which has been one of sources that slip
        ("rest", "i8"),  # samples since it last moved steadily
        ("between", "i8"),  # samples between the boxes
        ("stood", "i8"),  # samples that a loop stands still
        ("apart", "i8"),  # samples left for which a fault in the swing is no balanced one
        ("silent", "i8"),  # samples for which nothing has said that the fault is there
        ("told", "i8"),  # I2 or I0 has lasted for a cycle: when it goes, so has the fault
        ("off", "i8"),  # samples that the phasors are not where the swing would be
        ("track", TRACK),
    ),
    bits=("", "BlkZn", "UnBlk"),
    told=False,
    tell=tell,
    polygons=polygons,
    check=check,
)
