"""How a power swing moves, and where it would be now without a fault.

The state of the positive sequence is a point on a sphere: with a = V1 and b = |Z1| I1 its three coordinates
are

    2 Re(a b*),  2 Im(a b*),  |a|^2 - |b|^2,        over |a|^2 + |b|^2

which is the impedance V1 / I1 seen from a pole (stereographic projection): the poles are an open line and no
voltage at all, the equator is |Z| = |Z1|.  It does not turn with the frequency, it has no infinity, and the
locus of two sources that slip is a circle on it, along which the point goes by about 2 pi of slip a second
wherever it is.  (In the R-X plane the same swing is a hundred times faster at no load than at 180 degrees.)
A fault is a jump across the sphere within the estimator's rise.

Voltages and currents themselves are x = c + b e^(j W t) behind two sources of constant slip W.  Three
snapshots at equal distances give W, b and c, and so what a fault is a change against.
"""

from __future__ import annotations

import cmath
import math
from typing import Any

import numpy as np

from faultloop.jit import njit
from faultloop.relay import energy
from faultloop.relay.memory import A2, A, positive_sequence, size2, third, weight
from faultloop.relay.quantities import sequences
from faultloop.relay.standing import GROUND, TURNS, standing_type

Record = Any
STRAIGHT = 0.01
"""Turn of a step of the swing [rad]: less is taken for so much, which is a straight line."""

OFF = 0.1
"""Of voltage and current together."""
VOLTAGE = 0.02
"""Of the swing's."""

APART, CLEAR = 3.0, 0.3
"""Of the least resistance, and of the line: above both a second loop's is none of a fault."""
YOUNG, UNBALANCED, BALANCED = 1, 2, 3
"""Faults in a swing (``q.swing_fault``): one whose change is still known, then one without."""

TRACK = np.dtype(
    [
        ("centre", "c16", (6,)),  # the phasors that stay ...
        ("radius", "c16", (6,)),  # ... and those that slip, turned into the present
        ("turn", "c16"),  # of those since the newest snapshot of the fit
        ("per_sample", "c16"),
        ("frame", "c16"),  # turn of all by the frequency, since the fit
    ],
    align=True,
)


@njit
def point(g: Record, v: complex, i: complex) -> tuple[float, float, float]:
    """On the sphere."""
    b = i * abs(g.z1)
    total = size2(v) + size2(b)
    if total == 0.0:
        return 0.0, 0.0, 0.0
    cross = 2 * v * b.conjugate()
    return cross.real / total, cross.imag / total, (size2(v) - size2(b)) / total


@njit
def point_ago(g: Record, m: Record, lag: int) -> tuple[float, float, float]:
    """That of the snapshot as many snapshots ago."""
    x = m.ring[(m.head - lag) % g.snapshots]
    v = third(x[0] + A * x[1] + A2 * x[2])
    i = third(x[3] + A * x[4] + A2 * x[5])
    return point(g, v, i)


@njit
def distance(a: tuple, b: tuple) -> float:
    """Between two points."""
    return math.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)


@njit
def bend(a: tuple, b: tuple, c: tuple) -> float:
    """Second difference of three points at equal times."""
    x, y, z = a[0] - 2 * b[0] + c[0], a[1] - 2 * b[1] + c[1], a[2] - 2 * b[2] + c[2]
    return math.sqrt(x * x + y * y + z * z)


@njit
def fit(g: Record, m: Record, t: Record, lag: int) -> None:
    """Take `TRACK` from the snapshots one, two and three times ``lag`` snapshots ago."""
    newest, middle, oldest = (
        m.ring[(m.head - lag) % g.snapshots],
        m.ring[(m.head - 2 * lag) % g.snapshots],
        m.ring[(m.head - 3 * lag) % g.snapshots],
    )
    samples = lag * g.snapshot
    once = m.rotor**samples
    product, weight = complex(0.0, 0.0), 0.0
    for k in range(6):
        scale = 1.0 if k < 3 else size2(g.z1)
        later = (newest[k] - middle[k] * once) * once
        earlier = (middle[k] - oldest[k] * once) * once * once
        product += scale * later * earlier.conjugate()
        weight += scale * size2(earlier)
    angle = cmath.phase(product) if weight > 0.0 else 0.0
    if abs(angle) < STRAIGHT:
        angle = STRAIGHT if angle >= 0.0 else -STRAIGHT
    turn = cmath.rect(1.0, angle)
    for k in range(6):
        here = newest[k] * once
        step = (newest[k] - middle[k] * once) * once
        t.radius[k] = -step * turn / (1.0 - turn)
        t.centre[k] = here - t.radius[k]
    t.turn = turn
    t.per_sample = cmath.rect(1.0, angle / samples)
    t.frame = complex(1.0, 0.0)


@njit
def stay(q: Record, t: Record) -> None:
    """A reference that is what there is now, and does not slip."""
    for k in range(6):
        t.centre[k] = q.x[k]
        t.radius[k] = 0.0
    t.turn = t.per_sample = t.frame = complex(1.0, 0.0)


@njit
def follow(m: Record, t: Record) -> None:
    """One sample on: the reference is where the swing would be.  (The fit's snapshot is the sample's own.)"""
    for k in range(6):
        m.reference[k] = (t.centre[k] + t.radius[k] * t.turn) * t.frame
    t.turn *= t.per_sample
    t.frame *= m.rotor


@njit
def is_off(g: Record, q: Record) -> bool:
    """Whether the phasors are not where the swing would be: perhaps a fault, from which nothing is
    learned."""
    m = q.memory
    for k in range(6):
        m.work[k] = q.x[k] - m.reference[k]
    return weight(g, m.work) > OFF**2 * weight(g, m.reference)


@njit
def without_swing(q: Record, balanced: bool) -> None:
    """Let the change be what the fault alone has: negative and zero sequence; of a ``balanced`` one the
    voltages against the swing's, and no change of the currents."""
    m = q.memory
    v, i = q.sequence[1], q.sequence[4]
    for k in range(3):
        if not balanced:
            m.reference[k] = v
            m.reference[3 + k] = i
            v, i = v * A2, i * A2
        else:
            m.reference[3 + k] = q.x[3 + k]
    for k in range(6):
        q.d[k] = q.x[k] - m.reference[k]
    sequences(q.d, q.change)


@njit
def feed(q: Record) -> None:
    """A fault that nobody saw begin has its current; without a voltage it may be the transformer's."""
    if size2(q.sequence[1]) > VOLTAGE**2 * size2(positive_sequence(q.memory.reference)):
        q.memory.fed = q.fed = 1


@njit
def resistance(g: Record, q: Record, loop: int) -> float:
    """Size of the fault's resistance by a loop [ohm], with the negative- and zero-sequence part of its
    current for the fault's; none of it is the swing's."""
    i0, i2 = q.sequence[3], q.sequence[5]
    if loop < 3:
        k0 = (g.z0 - g.z1) / (3 * g.z1)
        v, i = q.x[loop], q.x[3 + loop] + 3 * k0 * i0
        fault = 1.5 * (TURNS[loop] * i2 + i0)
    else:
        first, second = loop - 3, (loop - 2) % 3
        v, i = q.x[first] - q.x[second], q.x[3 + first] - q.x[3 + second]
        fault = 2 * (TURNS[first] - TURNS[second]) * i2
    axis = (g.z1 * i).conjugate()
    size = abs((v * axis).imag / (fault * axis).imag)
    return size if size == size else np.inf


@njit
def by_resistance(g: Record, q: Record) -> tuple[int, bool]:
    """1 .. 6 of a fault with negative or zero sequence, and whether no other loop may be it.

    The angle of I2 against I0 tells the phase of a fault to ground, or the two others'; of what is left the
    loop counts in which no resistance is to be explained.  (The change of negative and zero sequence alone is
    that of a pair as much as of the next one.)  Near the centre of the swing there is none in any loop.
    """
    i0, i2 = q.sequence[3], q.sequence[5]
    loops = 0b111000
    if size2(i0) > GROUND**2 * size2(i2):
        phase, best = 0, -np.inf
        for k in range(3):
            along = (TURNS[k] * i2 * i0.conjugate()).real
            if along > best:
                phase, best = k, along
        loops = 1 << phase | 8 << (phase + 1) % 3
    found, least, second = 0, np.inf, np.inf
    for loop in range(6):
        if (loops >> loop) & 1:
            r = resistance(g, q, loop)
            if r < least or found == 0:
                found, least, second = loop + 1, r, least
            else:
                second = min(second, r)
    return found, second > max(APART * least, CLEAR * abs(g.z1))


@njit
def is_clear(g: Record, q: Record) -> bool:
    """Whether the currents and voltages of now tell one loop from the others."""
    return q.sequence[5] != 0.0 and by_resistance(g, q)[1]


@njit
def fault_type(g: Record, q: Record) -> int:
    """1 .. 7 of a fault in a swing, without anything from before it: by the loops that stand still, else
    `by_resistance`."""
    if q.swing_fault == BALANCED:
        return 7
    return standing_type(g, q) if q.standing else by_resistance(g, q)[0]


@njit
def is_normal(g: Record, q: Record) -> None:
    """The swing is what is normal at this sample: no disturbance, the energy of the change begins anew."""
    m = q.memory
    m.frozen = 1  # nobody else moves the reference
    m.fed = m.age = m.calm = m.still = 0
    q.disturbed = q.fed = 0
    q.dead = 7 & ~q.closed
    q.energy.following = q.energy.moving = q.energy.given = 0
    energy.rest(g, q.energy, True)
