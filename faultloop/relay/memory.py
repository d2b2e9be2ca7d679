"""The reference from before the fault: one memory for polarization, phase selection and fault location.

A ring keeps snapshots of the six phasors over the last two cycles.  In quiet the reference is the one of a
cycle and a quarter ago, turned forward in phase by the measured frequency; at a disturbance it is frozen and
goes on turning at the frequency from before the fault, so it stays in step with the source off nominal
frequency too.  The reference holds whatever the system did before - load, unbalance, an open pole - and the
change against it is what the fault added (superposition).
"""

from __future__ import annotations

import cmath
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from faultloop.jit import njit

Record = Any
"""One element of a structured array, in a kernel."""
Phasors = NDArray[np.complex128]
"""(6,)"""

A = complex(-0.5, math.sqrt(0.75))
A2 = A.conjugate()

SNAPSHOTS = 32
MEMORY_CYCLES = 2

ANEW = 2
"""Frozen so for one sample, in which there is no disturbance."""
JUMP = 3.0
"""Of what moved before, in as much time: more is a new fault."""
SOUND = 0.8
"""Of the voltage before: with more of it a balanced disturbance is a load, an infeed or a swing."""

MEMORY = np.dtype(
    [
        ("ring", "c16", (SNAPSHOTS, 6)),
        ("ring_frequency", "f8", (SNAPSHOTS,)),
        ("head", "i8"),  # the newest snapshot
        ("tick", "i8"),  # samples since it
        ("seen", "i8"),  # samples since the start
        ("steady", "i8"),  # snapshots in a row at which the voltage stood still
        ("ready", "i8"),
        ("moving", "i8"),  # something changed within the last cycle
        ("drift", "f8"),  # size2 of the change of all phasors within the last snapshot
        ("frozen", "i8"),  # a disturbance: the reference is kept from before it; ANEW: one begins within it
        ("fed", "i8"),  # a current has changed too, and not only a voltage
        ("age", "i8"),  # samples since
        ("calm", "i8"),  # samples in a row without a difference from the reference
        ("still", "i8"),  # samples in a row without movement, and outside every zone
        ("blind", "i8"),  # samples left after a pole opened
        ("frequency", "f8"),  # of the reference [Hz]
        ("rotor", "c16"),  # its turn per sample
        ("reference", "c16", (6,)),
        ("work", "c16", (6,)),  # of one calculation
    ],
    align=True,
)


@njit(forceinline=True)
def size2(z: complex) -> float:
    """|z|^2"""
    return z.real * z.real + z.imag * z.imag


@njit(forceinline=True)
def third(z: complex) -> complex:
    """z / 3, part by part: dividing a complex number by a real one costs three times that."""
    return complex(z.real / 3, z.imag / 3)


@njit(forceinline=True)
def positive_sequence(x: Phasors) -> complex:
    """V1 of six phasors, phase A."""
    return third(x[0] + A * x[1] + A2 * x[2])


@njit
def power(z: complex, n: int) -> complex:
    """z^n, n not negative, by squaring: ten times as fast as the general one, which takes a logarithm."""
    result = complex(1.0, 0.0)
    while n > 0:
        if n & 1:
            result *= z
        z *= z
        n >>= 1
    return result


@njit
def weight(c: Record, d: Phasors) -> float:
    """|dV|^2 + |Z1|^2 |dI|^2 of a change of six phasors: voltage and current on one scale [V^2]."""
    return size2(d[0]) + size2(d[1]) + size2(d[2]) + size2(c.z1) * (size2(d[3]) + size2(d[4]) + size2(d[5]))


@njit
def current_limit2(c: Record, reference: Phasors) -> float:
    """Square of the change of a phase current that is a disturbance."""
    i1 = third(reference[3] + A * reference[4] + A2 * reference[5])
    return max(c.pickup_current**2, c.pickup_current_pu**2 * size2(i1))


@njit
def voltage_limit2(c: Record, reference: Phasors) -> float:
    """The same of a phase voltage."""
    return max(c.pickup_voltage_pu**2 * size2(positive_sequence(reference)), 1e-2 * c.minimum_voltage**2)


@njit
def current_differs(c: Record, x: Phasors, reference: Phasors) -> bool:
    """Whether a phase current differs from the reference by more than the [phs] pickups."""
    limit = current_limit2(c, reference)
    ia, ib, ic = x[3] - reference[3], x[4] - reference[4], x[5] - reference[5]
    return size2(ia) > limit or size2(ib) > limit or size2(ic) > limit


@njit
def differs(c: Record, x: Phasors, reference: Phasors) -> bool:
    """Whether a phase current or voltage differs from the reference by more than the [phs] pickups."""
    limit = voltage_limit2(c, reference)
    va, vb, vc = x[0] - reference[0], x[1] - reference[1], x[2] - reference[2]
    if size2(va) > limit or size2(vb) > limit or size2(vc) > limit:
        return True
    return current_differs(c, x, reference)


@njit
def fill(c: Record, m: Record, x: Phasors) -> None:
    """Restart the memory: as if the system had been as it is now, and its frequency the reference's, for two
    cycles."""
    back = power(m.rotor.conjugate(), c.snapshot)
    turn = complex(1.0, 0.0)
    for j in range(c.snapshots):
        slot = (m.head - j) % c.snapshots
        for k in range(6):
            m.ring[slot, k] = x[k] * turn
        m.ring_frequency[slot] = m.frequency
        turn *= back
    m.tick = 0
    m.frozen = 0
    m.moving = 0
    for k in range(6):
        m.reference[k] = x[k]


@njit
def is_frequency(c: Record, f: float) -> bool:
    """Whether ``f`` can be the system's; False for NaN."""
    return abs(f - c.frequency) < 0.1 * c.frequency


@njit
def at_frequency(c: Record, m: Record, z: complex) -> complex:
    """An impedance that is given at the nominal frequency, at the reference's."""
    return complex(z.real, z.imag * (m.frequency / c.frequency))


@njit
def turn_with(c: Record, m: Record, frequency: float) -> None:
    """Let the reference turn with this frequency [Hz]."""
    m.frequency = frequency
    m.rotor = cmath.rect(1.0, 2 * math.pi * (frequency - c.frequency) / c.sampling)


@njit
def snapshot(c: Record, m: Record, x: Phasors, frequency: float) -> None:
    """Take a snapshot; in quiet, move the reference on to a later one."""
    m.tick = 0
    latest = m.head
    m.head = (m.head + 1) % c.snapshots
    turn = power(m.rotor, c.snapshot)
    for k in range(6):
        m.work[k] = x[k] - turn * m.ring[latest, k]
        m.ring[m.head, k] = x[k]
    m.drift = weight(c, m.work)
    m.ring_frequency[m.head] = frequency
    cycle_ago = (m.head - c.snapshots // 2) % c.snapshots
    turn = power(m.rotor, c.snapshot * (c.snapshots // 2))
    for k in range(6):
        m.work[k] = m.ring[cycle_ago, k] * turn
    m.moving = differs(c, x, m.work)
    if m.frozen:
        return
    slot = (m.head - c.lag) % c.snapshots
    f = m.ring_frequency[slot]
    if is_frequency(c, f):
        turn_with(c, m, m.frequency + 0.1 * (f - m.frequency))
    turn = power(m.rotor, c.snapshot * c.lag)
    for k in range(6):
        m.reference[k] = m.ring[slot, k] * turn


@njit
def establish(c: Record, m: Record, x: Phasors, frequency: float, sound: bool) -> None:
    """Before the memory is ready: wait for a voltage of known frequency that is still for half a cycle, in a
    system that is ``sound``: a fault must not be learned as what is normal."""
    v1 = positive_sequence(x)
    alive = sound and is_frequency(c, frequency) and size2(v1) > c.minimum_voltage**2
    if alive:
        turn_with(c, m, frequency)
    if alive and size2(v1 - positive_sequence(m.reference)) < 0.05**2 * size2(v1):
        m.steady += 1
    else:
        m.steady = 0
        fill(c, m, x)
    m.ready = m.steady >= c.snapshots // 4
    if m.ready:  # what stands in the ring is from before it was known
        m.ring_frequency[:] = m.frequency


@njit
def remember(c: Record, m: Record, x: Phasors, frequency: float, sound: bool) -> bool:
    """One sample of the memory.  Returns True while it can be relied on."""
    m.seen += 1
    if m.seen <= c.settling:
        if m.seen == 1:
            turn_with(c, m, c.frequency)
        if m.seen == c.settling:
            fill(c, m, x)
        return False
    m.tick += 1
    for k in range(6):
        m.reference[k] *= m.rotor
    if m.tick == c.snapshot:
        snapshot(c, m, x, frequency)
        if not m.ready:
            establish(c, m, x, frequency, sound)
        elif not m.frozen and size2(positive_sequence(m.reference)) < c.minimum_voltage**2:
            m.ready = 0
            m.steady = 0
    if m.frozen:
        m.age += 1
    return m.ready == 1


@njit
def freeze(m: Record) -> None:
    """A disturbance: keep the reference from before it."""
    m.frozen = 1
    m.fed = 0
    m.drift = np.inf  # unknown until the next snapshot
    m.age = 0
    m.calm = 0
    m.still = 0


@njit
def is_unbalanced(c: Record, x: Phasors, reference: Phasors) -> bool:
    """Whether a change has negative or zero sequence: a part of the positive, and more than the pickups."""
    positive = negative = zero = 0.0
    seen = False
    for k in range(0, 6, 3):
        one, two, three = x[k] - reference[k], x[k + 1] - reference[k + 1], x[k + 2] - reference[k + 2]
        scale = 1.0 if k == 0 else size2(c.z1)
        limit = voltage_limit2(c, reference) if k == 0 else current_limit2(c, reference)
        zeros, negatives = size2(one + two + three), size2(one + A2 * two + A * three)
        seen |= max(zeros, negatives) > 9 * limit
        zero += scale * zeros
        positive += scale * size2(one + A * two + A2 * three)
        negative += scale * negatives
    return seen and max(negative, zero) > c.three_phase**2 * positive


@njit
def jumps(c: Record, m: Record, x: Phasors) -> bool:
    """Whether the phasors have moved more since five eighths of a cycle ago than in as much time before it.
    ``m.work`` is then that state.  What settles or rings moves less and less."""
    back = 5 * c.snapshots // 16
    middle, first = (m.head - back) % c.snapshots, (m.head - 2 * back) % c.snapshots
    once = power(m.rotor, c.snapshot * back)
    turn = once * power(m.rotor, m.tick)
    moved = before = 0.0
    for k in range(6):
        scale = 1.0 if k < 3 else size2(c.z1)
        m.work[k] = turn * m.ring[middle, k]
        moved += scale * size2(x[k] - m.work[k])
        before += scale * size2(m.ring[middle, k] - once * m.ring[first, k])
    return moved > JUMP**2 * before


@njit
def begins_anew(c: Record, m: Record, x: Phasors) -> bool:
    """Whether a fault begins within a disturbance that is none: unbalanced, and a jump, while what there was
    before it (``m.work``) was balanced and had its voltage.

    The first one's change says nothing about the fault: neither its type, nor on which side it is.
    """
    if m.tick != min(1, c.snapshot - 1) or 2 * m.age < 3 * c.cycle or not jumps(c, m, x):
        return False
    had2, has2 = size2(positive_sequence(m.reference)), size2(positive_sequence(m.work))
    if has2 < SOUND**2 * had2 or not differs(c, m.work, m.reference):
        return False
    new = is_unbalanced(c, x, m.work) and differs(c, x, m.work)
    return new and not is_unbalanced(c, m.work, m.reference)


@njit
def begin_anew(m: Record) -> None:
    """Let that state be the reference; for one sample there is no disturbance."""
    for k in range(6):
        m.reference[k] = m.work[k]
    m.frozen = ANEW


@njit
def thaw(c: Record, m: Record, x: Phasors, frequency: float, selected: int, inside: bool) -> None:
    """End a disturbance that no element needs any more.

    Either it went away, for half a cycle, or the new state is not ``inside`` any zone and has stood still:
    for two cycles where it is balanced (a change of load or frequency), for ten where it is not.
    """
    balanced = selected == 0 or selected == 7
    m.calm = 0 if differs(c, x, m.reference) else m.calm + 1
    m.still = 0 if m.moving or inside else m.still + 1
    ends = m.calm * 2 >= c.cycle or m.still >= (2 if balanced else 10) * c.cycle
    if ends and not differs(c, x, m.ring[m.head]):  # or a fault of this very moment would be what is normal
        if is_frequency(c, frequency):
            turn_with(c, m, frequency)
        fill(c, m, x)
        if size2(positive_sequence(x)) < c.minimum_voltage**2:  # at once: the next change may come first
            m.ready = m.steady = 0
