"""RDIR: the direction of a fault, for every type and position, with the voltage gone too.

What a fault adds to a sequence network has V / I = -Zs of the source behind for a forward fault, and
plus the impedance of the line and the source ahead for a reverse one; half the line's impedance lies between
the two however strong the sources are (Roberts and Guzman 1993, for the negative sequence).  Load does not
enter it, and it is greatest where the loop's own voltage is zero.  So the measure is

    z = Re(sum V (I e^(j arg Z1))*) / sum |I|^2

- in the first two cycles over the change of positive and of negative sequence: every fault has the first,
  and each is weighted by its current, so that a transient's share of negative sequence does not decide;
- then over the negative sequence alone, which needs no memory; where it is too small beside load, over the
  zero sequence with the line's Z0;
- for a balanced fault that lasts longer, the positive-sequence voltage, with a fifth of the remembered one
  mixed in so that it never vanishes, against the current: forward within -15 .. 115 degrees, reverse
  opposite.  When the memory has faded and no voltage is left, the last direction stands.

Why not the loop voltage with memory for everything: with load and fault resistance its angle wanders, and
during the estimator's transient it starts from the load's direction; sequence changes are the safer evidence
where they exist.
"""

from __future__ import annotations

from faultloop.jit import njit
from faultloop.relay.memory import positive_sequence, size2

MEMORY_SHARE = 0.2
AS_BEFORE = 2


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
def projection(v, i, line):
    """Re(V (I e^(j arg Z))*) |Z|, and so |I|^2 |Z| times the part of V / I along the line's angle."""
    axis = i * line
    return v.real * axis.real + v.imag * axis.imag


@njit
def by_impedance(power, current2, line, c):
    """1 forward, -1 reverse, 0 between, from the sums of `projection` and of |I|^2, and the line."""
    z = power / (current2 * size2(line))
    if z < c.z2_forward:
        return 1
    return -1 if z > c.z2_reverse else 0


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
def indication(c, s):
    """What this sample says: 1 forward, -1 reverse, 0 nothing, 2 as before."""
    d = s.change
    first = projection(d[1], d[4], c.z1) + projection(d[2], d[5], c.z1)
    current2 = size2(d[4]) + size2(d[5])
    floor = (0.1 * c.minimum_current) ** 2
    if s.memory.age <= 2 * c.cycle and current2 > floor:
        return by_impedance(first, current2, c.z1, c)
    v0, v1, v2, i0, i1, i2 = s.sequence
    if s.closed != 7:  # with a pole open only what the fault added tells
        v0, i0, v2, i2 = d[0], d[3], d[2], d[5]
    least = max(c.minimum_unbalance**2 * size2(i1), floor)
    if s.selection.fault != 7 and size2(i2) > least:
        return by_impedance(projection(v2, i2, c.z1), size2(i2), c.z1, c)
    if s.selection.fault <= 3 and size2(i0) > least:
        return by_impedance(projection(v0, i0, c.z0), size2(i0), c.z0, c)
    if size2(i1) < c.minimum_current**2 / 4:
        return 0
    v = (1 - MEMORY_SHARE) * v1 + MEMORY_SHARE * s.direction.polarizing
    if size2(v) > 0.01**2 * size2(positive_sequence(s.memory.reference)):
        return by_sector(v, i1, c)
    return AS_BEFORE


@njit
def dead(c, s):
    """Whether no phase carries current: an open line has no direction."""
    least = c.open_current**2
    return size2(s.x[3]) < least and size2(s.x[4]) < least and size2(s.x[5]) < least


@njit
def decide(c, s):
    """One sample of the directional element, during a disturbance; sets ``s.direction``.

    A direction must stand for a sixteenth of a cycle, and is given once the fault's type is known.
    """
    r = s.direction
    r.polarizing = polarizing_voltage(c, s)
    if dead(c, s):
        r.direction = r.candidate = r.count = 0
        return
    candidate = indication(c, s)
    if candidate == AS_BEFORE:
        return
    r.count = r.count + 1 if candidate == r.candidate else 1
    r.candidate = candidate
    if s.selection.fault != 0 and r.count * 16 >= c.cycle:
        r.direction = candidate
