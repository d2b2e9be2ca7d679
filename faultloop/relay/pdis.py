"""PDIS: distance zones.

Each zone measures how deep the fault lies in it, m, as a part of its reach along the reach's angle; it is
inside where m < 1.  For a mho with polarizing voltage Vp (Schweitzer and Roberts 1993, eq. 8)

    m = Re(V Vp*) / Re(Zr I Vp*)

which is the comparator |arg((Zr I - V) / Vp)| < 90 degrees solved for the reach.  For the reactance line of
a quadrilateral, with the polarizing current Ip along the fault's own current so that the drop over the fault
resistance falls out (ibid., eq. 11), and for the fault resistance

    m = Im(V (Ip e^(-j tilt))*) / Im(Zr I (Ip e^(-j tilt))*)      R = Im(V (Zr I)*) / Im(If (Zr I)*)

Ip of a ground loop is the negative-sequence part of its current and If = 3/2 (I2 + I0); both of a phase loop
are the change of the loop current while the memory holds, then (twice) its negative-sequence part, and the
loop current itself for a balanced fault.  None of these contains the load.
"""

from __future__ import annotations

import numpy as np

from faultloop.jit import njit
from faultloop.relay.layout import CROSS, OFFSET, SELF
from faultloop.relay.memory import A2, A, size2
from faultloop.relay.phs import released

FIRST = (0, 1, 2, 0, 1, 2)
SECOND = (1, 2, 0, 1, 2, 0)
# Positive- and negative-sequence part of a loop quantity, as a factor on that of phase A.
POSITIVE = (complex(1), A2, A, 1 - A2, A2 - A, A - 1)
NEGATIVE = (complex(1), A, A2, 1 - A, A - A2, A2 - 1)
CROSS_GROUND = complex(0, 1 / 3**0.5)
CROSS_PHASE = complex(0, -(3**0.5))
SELF_OFFSET = 0.05
HYSTERESIS = 1.05
OUTSIDE = np.inf


@njit
def loop_voltage(x, loop):
    """Voltage of a loop; also its current without residual compensation, given ``x[3:]``."""
    if loop < 3:
        return x[loop]
    return x[FIRST[loop]] - x[SECOND[loop]]


@njit
def loop_current(x, loop, k0):
    """Current of a loop: compensated for ground loops."""
    if loop < 3:
        return x[3 + loop] + k0 * (x[3] + x[4] + x[5])
    return x[3 + FIRST[loop]] - x[3 + SECOND[loop]]


@njit
def mho_depth(z, s, loop, v, i):
    """m of a mho zone."""
    drop = z.reach * i
    if z.characteristic == OFFSET:
        return np.sqrt(size2(v) / size2(drop))
    if z.characteristic == SELF:
        polarizing = v + SELF_OFFSET * drop  # so that zero voltage is inside, and RDIR says on which side
    elif z.characteristic == CROSS:
        if loop < 3:
            polarizing = CROSS_GROUND * (s.x[(loop + 1) % 3] - s.x[(loop + 2) % 3])
        else:
            polarizing = CROSS_PHASE * s.x[(loop + 2) % 3]
        polarizing = polarizing + SELF_OFFSET * drop
    else:
        polarizing = POSITIVE[loop] * s.direction.polarizing
    reach = drop.real * polarizing.real + drop.imag * polarizing.imag
    if reach <= 0:
        return OUTSIDE
    return (v.real * polarizing.real + v.imag * polarizing.imag) / reach


@njit
def fault_currents(c, s, loop, i):
    """Polarizing current of the reactance line and the estimate of the fault's current."""
    i0, i1, i2 = s.sequence[3], s.sequence[4], s.sequence[5]
    negative = NEGATIVE[loop] * i2
    if loop < 3:
        if size2(i2) < c.minimum_unbalance**2 * size2(i1):
            return 3 * i0, 1.5 * i0
        return negative, 1.5 * (negative + i0)
    if s.memory.age <= c.memory:
        change = s.d[3 + FIRST[loop]] - s.d[3 + SECOND[loop]]
        return change, change
    if s.selection.fault != 7:
        return negative, 2 * negative
    return i, i


@njit
def quad_depth(c, z, s, loop, v, i):
    """m of a quadrilateral zone; OUTSIDE beyond its resistive reach."""
    drop = z.reach * i
    polarizing, fault = fault_currents(c, s, loop, i)
    polarizing = polarizing * z.tilt.conjugate()
    m = (v * polarizing.conjugate()).imag / (drop * polarizing.conjugate()).imag
    axis = drop.conjugate()
    r = (v * axis).imag / (fault * axis).imag
    if z.direction < 0:
        r = -r
    reach = z.resistive_ground if loop < 3 else z.resistive_phase
    if not abs(r) < reach:
        return OUTSIDE
    if z.direction == 0:
        return abs(m)
    return m if m > -0.15 - 0.27 * abs(r) / abs(z.reach) else OUTSIDE


@njit
def depth(c, z, s, loop):
    """How deep the fault is in zone ``z`` by one loop: m, or OUTSIDE."""
    v = loop_voltage(s.x, loop)
    i = loop_current(s.x, loop, z.k0)
    if size2(i) < z.minimum_current**2:
        return OUTSIDE
    if loop < 3 and size2(s.x[3] + s.x[4] + s.x[5]) < z.minimum_residual**2:
        return OUTSIDE
    if z.characteristic <= OFFSET:
        m = mho_depth(z, s, loop, v, i)
    else:
        m = quad_depth(c, z, s, loop, v, i)
    return m if m == m else OUTSIDE


@njit
def zone_depth(c, z, s, mask):
    """m of the released loops; of three, the middle one (two of three must be inside)."""
    if z.direction != 0 and s.direction.direction != z.direction:
        return OUTSIDE
    low, middle, high, count = OUTSIDE, OUTSIDE, OUTSIDE, 0
    for loop in range(6):
        if not (mask >> loop) & 1:
            continue
        count += 1
        m = depth(c, z, s, loop)
        if m < low:
            low, middle, high = m, low, middle
        elif m < middle:
            middle, high = m, middle
        elif m < high:
            high = m
    return middle if count == 3 else low


@njit
def security_step(m):
    """How much one sample inside counts.

    A zone starts when the count has reached ``security`` (one cycle by default): a fault in the last tenth
    of the reach must stay inside for a cycle, which outlasts the swing that a decaying offset gives the
    impedance; deep inside, an eighth or a twelfth of that is enough.
    """
    if m < 0.5:
        return 12.0
    if m < 0.75:
        return 8.0
    return 2.0 if m < 0.9 else 1.0


@njit
def reset_zone(w):
    """Back to rest."""
    w.counter = 0.0
    w.fault = 0
    w.outside = 0
    w.pickup = 0
    w.operate = 0
    w.timer = 0


@njit
def step_zone(c, z, w, s, mask):
    """One sample of one zone: start, timer, operate."""
    m = zone_depth(c, z, s, mask & z.loops)
    fault = s.selection.fault
    if w.pickup:
        w.outside = w.outside + 1 if m > HYSTERESIS else 0
        if w.outside * 8 >= c.cycle:
            reset_zone(w)
            return
        w.timer += 1
        if fault != 0:
            w.fault = fault
    else:
        if fault != w.fault or m >= 1:
            w.counter = 0.0
            w.fault = fault
        if m < 1:
            w.counter += security_step(m)
        if m >= 1 or w.counter < z.security:
            return
        w.pickup = 1
        w.outside = 0
        w.timer = 0
    w.operate = w.timer >= (z.delay_ground if w.fault <= 3 else z.delay_phase)


@njit
def inside(s, count):
    """Whether the fault is inside any zone that has not started yet."""
    found = False
    for k in range(count):
        found |= s.zone[k].counter > 0
    return found


@njit
def step_zones(c, zones, s):
    """One sample of all zones.  Returns True while any has started."""
    mask = released(c, s)
    any_pickup = False
    for k in range(zones.shape[0]):
        step_zone(c, zones[k], s.zone[k], s, mask)
        any_pickup |= s.zone[k].pickup == 1
    return any_pickup
