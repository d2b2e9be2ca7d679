"""RDIR: the direction of a fault, for every type and position, with the voltage gone too.

Unbalanced faults: the negative-sequence impedance z2 = Re(V2 conj(I2 e^(j arg Z1))) / |I2|^2 is minus that
of the source behind for a forward fault, and plus that of the line and the source ahead for a reverse one;
half the line's impedance lies between the two however strong the sources are (Roberts and Guzman 1993).
It needs no memory, load does not enter it, and it is greatest where the loop's own voltage is zero.  Where
negative sequence is too small beside load, zero sequence decides in the same way.

Balanced faults have neither.  There the positive-sequence voltage, with a fifth of the remembered one mixed
in so that it never vanishes, is compared with the current: forward within -15 .. 115 degrees, reverse
opposite.  When the memory has faded and no voltage is left, the last direction stands.

Why not the loop voltage with memory for everything: with load and fault resistance its angle wanders, and
it depends on the memory; sequence quantities are the safer evidence where they exist.
"""

from __future__ import annotations

from faultloop.jit import njit
from faultloop.relay.memory import positive_sequence, size2

MEMORY_SHARE = 0.2


@njit
def polarizing_voltage(c, s):
    """Positive-sequence polarizing voltage: the memory while it holds, fading into the present one."""
    m = s.memory
    v1 = s.sequence[1]
    remembered = positive_sequence(m.reference)
    if m.age <= c.memory:
        return remembered
    if m.age >= c.memory + c.fade:
        return v1
    part = (m.age - c.memory) / c.fade
    return (1 - part) * remembered + part * v1


@njit
def by_impedance(v, i, line, c):
    """1 forward, -1 reverse, 0 between, from a sequence voltage and current and the line's impedance."""
    size = size2(i)
    line_size = abs(line)
    axis = i * line
    z = (v.real * axis.real + v.imag * axis.imag) / (size * line_size)
    if z < c.z2_forward * line_size:
        return 1
    return -1 if z > c.z2_reverse * line_size else 0


@njit
def by_sector(v, i, c):
    """1 where v leads i by an angle within the forward sector, -1 within the opposite one, else 0."""
    z = v * i.conjugate()
    low = z.imag * c.sector_low.real - z.real * c.sector_low.imag
    high = z.imag * c.sector_high.real - z.real * c.sector_high.imag
    if low >= 0 and high <= 0:
        return 1
    return -1 if low < 0 and high > 0 else 0


@njit
def decide(c, s):
    """One sample of the directional element, during a disturbance; sets ``s.direction``."""
    r = s.direction
    r.polarizing = polarizing_voltage(c, s)
    v0, v1, v2, i0, i1, i2 = s.sequence
    if s.closed != 7:  # with a pole open only what the fault added tells
        v0, i0, v2, i2 = s.change[0], s.change[3], s.change[2], s.change[5]
    least = max(c.minimum_unbalance**2 * size2(i1), (0.1 * c.minimum_current) ** 2)
    if s.selection.fault != 7 and size2(i2) > least:
        r.direction = by_impedance(v2, i2, c.z1, c)
    elif s.selection.fault <= 3 and size2(i0) > least:
        r.direction = by_impedance(v0, i0, c.z0, c)
    elif size2(i1) > c.minimum_current**2 / 4:
        v = (1 - MEMORY_SHARE) * v1 + MEMORY_SHARE * r.polarizing
        if size2(v) > 0.01**2 * size2(positive_sequence(s.memory.reference)):
            r.direction = by_sector(v, i1, c)
    else:
        r.direction = 0
