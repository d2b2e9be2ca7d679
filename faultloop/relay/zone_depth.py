"""How deep a fault is in a distance zone: by the phasors, by the samples with what their fit leaves, and by
the samples where they may stand alone."""

from __future__ import annotations

from typing import Any

from faultloop.jit import njit
from faultloop.relay.characteristics import (
    OFFSET,
    OUTSIDE,
    loop_current,
    loop_voltage,
    mho_depth,
    quad_depth,
    quad_measures,
)
from faultloop.relay.charging import charging_voltage
from faultloop.relay.line_fit import charged_fit
from faultloop.relay.loop_fit import BEHIND, Fit, centred, doubted, fit, gather, window
from faultloop.relay.memory import at_frequency, size2
from faultloop.relay.saturation import is_saturated
from faultloop.relay.standing import standing_depth
from faultloop.relay.swing import UNBALANCED
from faultloop.relay.unknown_vt import CENTRED_DOUBT, is_believed, is_believed_centred, weakness

Record = Any
ALL_POLES = 7
BARE = (0.25, 0.05)
"""From this m on, and for less resistance than this, of the reach, a phase loop is inside by the fit with the
charging alone: its phasors may swing round to where a characteristic has no m while the fit stands still (326
km, 54 Hz: for 10 ms at 0.76; bench/security.py, kind long, seed 97030, network 673).  Close to the relay a
characteristic that memory polarizes also says on which side."""
ROWS = 6
"""Equations that a fit must have to stand alone, and one with the charging at all: of two unknowns.  One to
three, as at 10 to 12 values a cycle, leave next to nothing whatever there is."""
SURE, SURE_LEFT, SURE_RESISTANCE = 6.0, 0.05, 0.25
"""Where phasors that ring show the fault outside and the fit stands alone: how much what it leaves counts,
the most of it, and the largest fault resistance, over the reach.  Once all is sinusoidal m and a resistance
fit whatever there is: with 6 alone variants of the faults of `PHASORS_BEHIND` started zone 1, at four times
the reach as resistance and m below -1."""
SURE_WHOLE = 4.5
"""In place of `SURE` from a cycle and a quarter on, less by as much as `pdis.WHOLE` is than `pdis.YOUNG`: on
lines of 370 km the phasors of two of 96,696 faults within 60 % still swung across the reach after 30 ms, with
m at 0.76 and 0.04 left (bench/security.py, kind long, seeds 97002, network 164, and 97010, network 636)."""
DOUBT = 2.0
"""How much what the fit leaves counts once the fault has been inside for a cycle.

An m behind the relay makes up for nothing of it: on the healthy one of two parallel lines of 209 km, and for
a fault beyond one of 397 km, -0.3 with 0.3 left was inside at four times (two of 151,778 faults;
bench/security.py, kind long, seed 97002, networks 1815 and 225).  And in the first cycle how far behind it is
counts as what is left does, as a fault ahead is not there: beyond a line of 306 km m came from 1.6 to -0.2
within 4 ms, with 0.1 left and a resistance (seed 97003, network 3856, one of 218,674).  Later it may be what
infeed makes of a resistance."""
SATURATED = 3.0
"""Times as much it counts while a current of the loop has collapsed (`saturation`) within the window and the
fit finds a resistance above `SURE_RESISTANCE` (with 2 one of 3,626 faults from 98 % on was inside at 0.98;
bench/ct_saturation.py, seed 4, case 3636), or with the charging leaves more than twice `SURE_LEFT`, as lines
that ring may look like a collapse.  A fault close in leaves no more than its voltage."""
BY_PHASORS, ALONE = -1.0, -2.0
"""In place of a doubt, which is not negative: by the phasors; by the samples where they may stand alone."""
CHARGING = 1.25
"""How much what the line's charging adds to m counts: it is known less well than R and X, and where it is
most of what there is the voltage along the faulted phase may pass through zero before the fault, at 0.78 for
one at the far bus (bench/security.py, kind long, seed 97002, network 893).  It takes nothing off."""
PLACES = 4
"""Up to the reach at which the voltage is asked for."""
PHASORS_BEHIND = 0.5
"""Of the reach: farther behind the relay there is no fault that lies ahead, though a mho polarized by memory
takes in all that is between relay and source.  The current of the healthy one of two parallel lines can ring
through zero, and m with it from far ahead to far behind: 2 of 62,364 faults on the other started zone 1 at m
of -0.7 to -1.3 (bench/security.py, seed 91001, networks 5555 and 10988)."""


@njit
def is_enough(q: Record, c: Record, loop: int, i: complex) -> bool:
    """Whether the loop's current, and for a ground loop 3I0, reach what the zone needs."""
    if loop < 3 and size2(q.x[3] + q.x[4] + q.x[5]) < c.minimum_residual**2:
        return False
    return size2(i) >= c.minimum_current**2


@njit
def along(g: Record, q: Record, c: Record, loop: int, v: complex, i: complex) -> float:
    """m of a loop's voltage and current along the reach, whatever the resistance."""
    if c.characteristic <= OFFSET:
        return mho_depth(q, c, loop, v, at_frequency(g, q.memory, c.reach) * i)
    return quad_measures(g, q, c, loop, v, i, c.tilt)[0]


@njit
def charged_depth(g: Record, q: Record, c: Record, loop: int, v: complex, i: complex) -> float:
    """m along the reach with what the line's charging adds to it, the least of some places up to the reach.

    At the reach alone the voltage says where a fault beyond it is.  With one close in, what is left of the
    sequences' voltages at the fault is on the other side: past it they go apart again.
    """
    plain, least = along(g, q, c, loop, v, i), OUTSIDE
    for k in range(1, PLACES + 1):
        share = k / PLACES
        added = along(g, q, c, loop, v + charging_voltage(g, q, share * c.charged, loop), i) - plain
        least = min(least, (plain + CHARGING * max(added, 0.0)) / share)
    return least


@njit
def uncharged_depth(g: Record, q: Record, c: Record, loop: int, v: complex, i: complex) -> float:
    """m of a loop's voltage and current by R and X alone."""
    if c.characteristic <= OFFSET:
        return mho_depth(q, c, loop, v, at_frequency(g, q.memory, c.reach) * i)
    return quad_depth(g, q, c, loop, v, i)


@njit
def by_characteristic(g: Record, q: Record, c: Record, loop: int, v: complex, i: complex) -> float:
    """m of a loop's voltage and current; in a zone that ends on the line, whose charging is told, with what
    that adds."""
    m = uncharged_depth(g, q, c, loop, v, i)
    if c.charged > 0.0 and m < 1:
        return max(m, charged_depth(g, q, c, loop, v, i))
    return m


@njit
def depth(g: Record, q: Record, c: Record, loop: int) -> float:
    """How deep the fault is in the zone by one loop: m, or OUTSIDE."""
    v = loop_voltage(q.x, loop)
    i = loop_current(q.x, loop, c.k0) + (q.mutual if loop < 3 else 0.0)
    if not is_enough(q, c, loop, i):
        return OUTSIDE
    m = by_characteristic(g, q, c, loop, v, i)
    if q.swing_fault:
        m = min(m, standing_depth(g, q, (c.reach, c.k0 * c.reach), loop, c.direction))
        if q.swing_fault == UNBALANCED and c.characteristic < OFFSET and q.closed == ALL_POLES:
            # the sources are far apart, and with them V and I: a resistance does not look like one
            m = max(m, quad_measures(g, q, c, loop, v, i, complex(1.0, 0.0))[0])
    return m if m == m else OUTSIDE


@njit
def fitted_depth(
    g: Record, q: Record, c: Record, loop: int, fitted: Fit, doubt: float, charged: bool
) -> float:
    """m of the samples' fit, with ``doubt`` times what it leaves added; no less than by the zone's
    characteristic for the impedance that was fitted, as phasors on their way cross it.  One with the line's
    charging (``charged``) is the place itself: the characteristic must let it in (or `BARE`), and no more."""
    behind = BEHIND[2] if weakness(g, q) == 0.0 else doubt
    doubtful = abs(fitted[2]) > SURE_RESISTANCE * abs(c.reach)
    doubtful |= charged and fitted[1] > 2.0 * SURE_LEFT
    matters = fitted[0] + SATURATED * doubt * fitted[1] >= 1.0
    if doubtful and matters and is_saturated(g, q.recent, loop, window(g, q.memory.age)):
        doubt *= SATURATED
    m = doubted(fitted, c.direction, abs(c.reach), doubt, behind)
    if g.ideal_vt and c.direction != 0 and fitted[0] < 0.0:  # behind others it looks so by what they add
        m -= fitted[0] * (1.0 + doubt if doubt > DOUBT else 1.0)
    if m >= 1 or q.swing_fault:
        return m
    if charged and loop >= 3 and m >= BARE[0] and abs(fitted[2]) < BARE[1] * abs(c.reach):
        return m
    i = loop_current(q.x, loop, c.k0) + (q.mutual if loop < 3 else 0.0)
    drop = at_frequency(g, q.memory, c.reach) * i
    residual = q.x[3] + q.x[4] + q.x[5]
    v = fitted[0] * drop + fitted[2] * (residual if loop < 3 else i)
    if charged:
        v -= charging_voltage(g, q, max(fitted[0], 0.0) * c.charged, loop)
    border = by_characteristic(g, q, c, loop, v, i)
    return m if charged and border < 1 else max(m, border)


@njit
def depth_in_time(g: Record, q: Record, c: Record, loop: int, doubt: float) -> float:
    """m by the samples of the loop, with ``doubt`` times what the fit leaves added; OUTSIDE behind it."""
    length = window(g, q.memory.age)
    drop = c.reach, c.k0 * c.reach
    ratio, m = weakness(g, q), OUTSIDE
    if is_believed(g, q, ratio):
        mean = max(length // 8, 1)
        sums = gather(g, q.recent, drop, loop, (mean, mean, mean), length - 3 * mean + 2)
        fitted = fit(sums, -1 if c.direction < 0 else 1)
        m = fitted_depth(g, q, c, loop, fitted, doubt, False)
        if m >= 1 and is_charged(g, q, c, fitted):
            fitted = charged_fit(g, q.recent, drop, c.charged, loop, q.memory.age, fitted)
            if abs(fitted[2]) <= SURE_RESISTANCE * abs(c.reach):
                m = fitted_depth(g, q, c, loop, fitted, doubt, True)
    if is_believed_centred(g, q, ratio):
        mean = length // 3
        sums = centred(gather(g, q.recent, drop, loop, (mean, 1, 1), length - mean), length - mean)
        fitted = fit(sums, -1 if c.direction < 0 else 1)
        m = min(m, fitted_depth(g, q, c, loop, fitted, CENTRED_DOUBT, False))
    return m


@njit
def is_sure(g: Record, q: Record, c: Record, fitted: Fit) -> bool:
    """Whether a fit may stand alone."""
    m, left, r = fitted
    sure = SURE_WHOLE if 4 * q.memory.age >= 5 * g.cycle else SURE
    if not (left < SURE_LEFT and m > -BEHIND[0] and abs(m) + sure * left < 1):
        return False
    return abs(r) <= SURE_RESISTANCE * abs(c.reach)


@njit
def is_charged(g: Record, q: Record, c: Record, plain: Fit) -> bool:
    """Whether the line's charging can be taken into the fit: ahead, by enough samples, and not where the fit
    without leaves next to nothing and is outside.  Then nothing rings, and charging takes nothing off."""
    length = window(g, q.memory.age)
    if not (c.charged > 0.0 and g.ideal_vt and not q.swing_fault and plain[0] > 0.0):
        return False
    return length - 3 * max(length // 8, 1) >= ROWS and not (plain[0] >= 1.0 and plain[1] < SURE_LEFT)


@njit
def depth_alone(g: Record, q: Record, c: Record, loop: int) -> float:
    """m by the samples where they may stand alone, OUTSIDE where they may not.

    Phasors of a line that rings swing about the depth, and cross the reach again and again, long after the
    fit has found it: one in 10,000 faults within 60 % of a line of up to 150 km waited for more than 20 ms.
    """
    i = loop_current(q.x, loop, c.k0) + (q.mutual if loop < 3 else 0.0)
    if not is_enough(q, c, loop, i) or depth(g, q, c, loop) < -PHASORS_BEHIND:
        return OUTSIDE
    length = window(g, q.memory.age)
    mean, drop = max(length // 8, 1), (c.reach, c.k0 * c.reach)
    if length - 3 * mean < ROWS:
        return OUTSIDE
    sums = gather(g, q.recent, drop, loop, (mean, mean, mean), length - 3 * mean + 2)
    fitted = fit(sums, -1 if c.direction < 0 else 1)
    if is_charged(g, q, c, fitted):
        charged = charged_fit(g, q.recent, drop, c.charged, loop, q.memory.age, fitted)
        if is_sure(g, q, c, charged):
            return fitted_depth(g, q, c, loop, charged, 0.0, True)
    return fitted_depth(g, q, c, loop, fitted, 0.0, False) if is_sure(g, q, c, fitted) else OUTSIDE


@njit
def zone_depth(g: Record, q: Record, c: Record, mask: int, doubt: float, least: float) -> float:
    """m of the released loops: by `depth`, where none is below ``least``, by `depth_alone`, or, with a
    ``doubt``, by `depth_in_time`; of three the middle one (two of three must be inside), unless there are
    two faults."""
    if c.direction != 0 and q.direction != c.direction:
        return OUTSIDE
    low, middle, high, count = OUTSIDE, OUTSIDE, OUTSIDE, 0
    for loop in range(6):
        if not (mask >> loop) & 1:
            continue
        count += 1
        if doubt == BY_PHASORS:
            m = depth(g, q, c, loop)
            if m < least:
                m = OUTSIDE
        elif doubt == ALONE:
            m = depth_alone(g, q, c, loop)
        else:
            m = depth_in_time(g, q, c, loop, doubt)
        if m < low:
            low, middle, high = m, low, middle
        elif m < middle:
            middle, high = m, middle
        elif m < high:
            high = m
    return middle if count == 3 and not q.both else low
