"""What a line's capacitance adds to the voltage at a place along it, for zones that end on it: in phasors,
and in the samples.

A loop's impedance takes the line for R and X in series.  On a long line that is not so: a sequence has

    V(x) = cosh(theta) V - Z sinh(theta) / theta I        theta^2 = Z Y

at a part of the line with the series impedance Z and the admittance Y (the exact equations of a long line;
Kundur 1994, section 6.1).  In the phases of a bolted fault there the sum of V(x) is nothing, whatever is
ahead and behind, where that of V - Z I is not: each sequence's voltage at the fault is there, and each has a
theta of its own.  Behind a weak source, or near a resonance of the network, a fault at the far bus may so
measure a third of the line (`bench/long_line_reach.py`).

cosh and sinh as their series, to theta^8: a line of 400 km has theta^2 of -0.3 to -0.5 at 60 Hz, and what is
left out is below 1e-9.
"""

from __future__ import annotations

import math
from typing import Any

from numpy.typing import NDArray

from faultloop.jit import njit
from faultloop.relay.loop_fit import FIRST, SECOND, Charge
from faultloop.relay.memory import at_frequency

Record = Any


@njit
def more(z: complex, y: complex, v: complex, i: complex) -> complex:
    """V(x) of a sequence less what it would be without ``y``, V - Z I."""
    square = z * y
    cosh = square / 2 * (1 + square / 12 * (1 + square / 30 * (1 + square / 56)))
    sinh = square / 6 * (1 + square / 20 * (1 + square / 42 * (1 + square / 72)))
    return cosh * v - z * sinh * i


@njit
def charging_voltage(g: Record, q: Record, part: float, loop: int) -> complex:
    """To be added to a loop's voltage [V]: less the drop along R and X it then is that at ``part`` of the
    line."""
    x: NDArray = q.x
    turn = q.memory.frequency / g.frequency
    z1, y1 = part * at_frequency(g, q.memory, g.z1), complex(0.0, part * turn * g.b1)
    if loop >= 3:
        first, second = FIRST[loop], SECOND[loop]
        return more(z1, y1, x[first] - x[second], x[3 + first] - x[3 + second])
    z0, y0 = part * at_frequency(g, q.memory, g.z0), complex(0.0, part * turn * g.b0)
    v0, i0 = (x[0] + x[1] + x[2]) / 3, (x[3] + x[4] + x[5]) / 3
    return more(z1, y1, x[loop] - v0, x[3 + loop] - i0) + more(z0, y0, v0, i0)


@njit
def charge_in_time(g: Record, part: float, loop: int) -> Charge:
    """How much second differences of the loop's voltage, of v0 and of 3 i0 count in the samples
    (`loop_fit.charged_values`), for a fault at ``part`` of the line.

    There, with theta^2 = -Z Y, (1 - theta^2 / 2) V = (1 - theta^2 / 6) Z I in every sequence, but for
    theta^4.  Over the positive one's 1 - theta^2 / 6: (1 - theta^2 / 3) of the loop's voltage (theta^4 / 45
    is left, as tan theta / theta is 1 + theta^2 / 3 + 2 theta^4 / 15), and of v0 half the difference of the
    theta^2, of its drop a sixth.
    Without losses -theta^2 is x b / w0^2 times a second derivative, whatever the frequency.
    """
    per_difference = 2.0 - 2.0 * math.cos(g.turn_per_value)  # the size of a second one at w0
    square = part * part / per_difference
    of_loop = square * g.z1.imag * g.b1
    if loop >= 3:
        return of_loop / 3.0, 0.0, 0.0
    more_in_zero = square * g.z0.imag * g.b0 - of_loop
    return of_loop / 3.0, more_in_zero / 2.0, more_in_zero / 6.0
