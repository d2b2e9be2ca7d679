"""Characteristics of distance zones: how deep a loop's impedance lies in one.

m is the depth as a part of the zone's reach along the reach's angle; inside is m < 1.  For a mho with
polarizing voltage Vp (Schweitzer and Roberts 1993, eq. 8)

    m = Re(V Vp*) / Re(Zr I Vp*)

which is the comparator |arg((Zr I - V) / Vp)| < 90 degrees solved for the reach.  For the reactance line of
a quadrilateral, with the polarizing current Ip along the fault's own current so that the drop over the fault
resistance falls out (ibid., eq. 11), and for the fault resistance

    m = Im(V (Ip e^(-j tilt))*) / Im(Zr I (Ip e^(-j tilt))*)      R = Im(V (Zr I)*) / Im(If (Zr I)*)

Ip of a ground loop is the negative-sequence part of its current and If = 3/2 (I2 + I0); both of a phase loop
are the change of the loop current while the memory holds, then (twice) its negative-sequence part, and the
loop current itself for a balanced fault.  None of these but the last contains the load; it is then turned to
both sides by as much as load and infeed may turn it, and the greatest m counts.

Where inverters feed the fault the angles of change and negative sequence are those of their control, and of
no network.  ``polarization = "loop"`` takes the loop's own current for both (over 1 + k0 for a ground loop,
as the fault's): the plain impedance, which holds whatever the source is (Kasztenny 2022, MIPSYCON).
"""

from __future__ import annotations

import cmath
import math

import numpy as np
from numpy.typing import NDArray

from faultloop.jit import njit
from faultloop.relay.loop_fit import FIRST, SECOND
from faultloop.relay.memory import A2, A, at_frequency, size2
from faultloop.relay.quantities import THREE_PHASE, Record

SELF, CROSS, MEMORY_POLARIZED, OFFSET, QUAD, OWN = range(6)
"""A mho by its polarizing voltage, a circle about the origin, a quadrilateral by the fault's current or the
loop's."""
# Positive- and negative-sequence part of a loop quantity, as a factor on that of phase A.
POSITIVE = (complex(1), A2, A, 1 - A2, A2 - A, A - 1)
NEGATIVE = (complex(1), A, A2, 1 - A, A - A2, A2 - 1)
CROSS_GROUND = complex(0, 1 / 3**0.5)
CROSS_PHASE = complex(0, -(3**0.5))
SELF_OFFSET = 0.05
TURNED = cmath.rect(1.0, math.radians(20))
"""How far the current of a balanced fault, which is also the load's, may be from the fault's own."""
OUTSIDE = np.inf


@njit
def loop_voltage(x: NDArray, loop: int) -> complex:
    """Voltage of a loop; also its current without residual compensation, given ``x[3:]``."""
    if loop < 3:
        return x[loop]
    return x[FIRST[loop]] - x[SECOND[loop]]


@njit
def loop_current(x: NDArray, loop: int, k0: complex) -> complex:
    """Current of a loop: compensated for ground loops."""
    if loop < 3:
        return x[3 + loop] + k0 * (x[3] + x[4] + x[5])
    return x[3 + FIRST[loop]] - x[3 + SECOND[loop]]


@njit
def mho_depth(q: Record, c: Record, loop: int, v: complex, drop: complex) -> float:
    """m of a mho zone; ``drop`` is that of the loop's current along the reach."""
    if c.characteristic == OFFSET:
        return np.sqrt(size2(v) / size2(drop))
    if c.characteristic == SELF:
        polarizing = v + SELF_OFFSET * drop  # so that zero voltage is inside, and RDIR says on which side
    elif c.characteristic == CROSS:
        if loop < 3:
            polarizing = CROSS_GROUND * (q.x[(loop + 1) % 3] - q.x[(loop + 2) % 3])
        else:
            polarizing = CROSS_PHASE * q.x[(loop + 2) % 3]
        polarizing = polarizing + SELF_OFFSET * drop
    else:
        polarizing = POSITIVE[loop] * q.polarizing
    reach = drop.real * polarizing.real + drop.imag * polarizing.imag
    if reach <= 0:
        return OUTSIDE
    return (v.real * polarizing.real + v.imag * polarizing.imag) / reach


@njit
def fault_currents(g: Record, q: Record, loop: int, i: complex) -> tuple[complex, complex]:
    """Polarizing current of the reactance line and the estimate of the fault's current."""
    i0, i1, i2 = q.sequence[3], q.sequence[4], q.sequence[5]
    negative = NEGATIVE[loop] * i2
    if loop < 3:
        if size2(i2) < g.minimum_unbalance**2 * size2(i1):
            return 3 * i0, 1.5 * i0
        return negative, 1.5 * (negative + i0)
    if q.memory.age <= g.memory and not q.slides:
        change = q.d[3 + FIRST[loop]] - q.d[3 + SECOND[loop]]
        return change, change
    if q.fault != 7:
        return negative, 2 * negative
    return i, i


@njit
def quad_measures(
    g: Record, q: Record, c: Record, loop: int, v: complex, i: complex, tilt: complex
) -> tuple[float, float]:
    """m along the reactance line, and the fault resistance R [ohm], positive ahead of the zone."""
    drop = at_frequency(g, q.memory, c.reach) * i
    if c.characteristic == OWN:
        polarizing, fault = i, i / (1.0 + c.k0) if loop < 3 else i
    else:
        polarizing, fault = fault_currents(g, q, loop, i)
    polarizing = polarizing * tilt.conjugate()
    m = (v * polarizing.conjugate()).imag / (drop * polarizing.conjugate()).imag
    axis = drop.conjugate()
    r = (v * axis).imag / (fault * axis).imag
    return m, -r if c.direction < 0 else r


@njit
def quad_depth(g: Record, q: Record, c: Record, loop: int, v: complex, i: complex) -> float:
    """m of a quadrilateral zone, or the part of its resistive reach, whichever is nearer to its border."""
    m, r = quad_measures(g, q, c, loop, v, i, c.tilt)
    if loop >= 3 and q.fault == THREE_PHASE and q.memory.age > g.memory and c.characteristic != OWN:
        for tilt in (c.tilt * TURNED, c.tilt * TURNED.conjugate()):
            m = max(m, quad_measures(g, q, c, loop, v, i, tilt)[0])
    beside = abs(r) / (c.resistive_ground if loop < 3 else c.resistive_phase)
    if not beside < OUTSIDE:
        return OUTSIDE
    if c.direction == 0:
        return max(abs(m), beside)
    return max(m, beside) if m > -0.15 - 0.27 * abs(r) / abs(c.reach) else OUTSIDE
