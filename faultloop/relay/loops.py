"""Six loop impedances, and the frequency where the estimator does not give it.

Ground loops: Z = V / (I + k0 (Ia + Ib + Ic)), k0 = (Z0 - Z1) / (3 Z1).
Phase loops: Z = (Vx - Vy) / (Ix - Iy).
For a fault without resistance at a part m of the line both give m Z1 (Ziegler, Numerical Distance
Protection, 2011, section 3.1).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from faultloop.jit import njit

RING = 32

MEASURE_CONSTANTS = np.dtype(
    [
        ("k0", "c16"),
        ("minimum_current", "f8"),
        ("minimum_voltage", "f8"),
        ("frequency", "f8"),
        ("interval", "f8"),  # between two snapshots [s]
        ("snapshot", "i8"),  # the same in samples
        ("snapshots", "i8"),  # in one cycle
        ("settling", "i8"),
    ],
    align=True,
)

MEASURE_STATE = np.dtype(
    [
        ("v1", "c16", (RING,)),
        ("f", "f8", (RING,)),
        ("head", "i8"),
        ("tick", "i8"),
        ("seen", "i8"),
        ("frequency", "f8"),
        ("rocof", "f8"),
    ],
    align=True,
)

Record = Any
"""A structured array, or one element of it in a kernel."""
Array = NDArray[np.float64]

A = complex(-0.5, math.sqrt(0.75))
A2 = A.conjugate()


@njit(forceinline=True)
def impedance(v: complex, i: complex, minimum2: float, out: Array, place: int) -> None:
    """V / I as (r, x); NaN where |I|^2 is below ``minimum2``."""
    size = i.real * i.real + i.imag * i.imag
    if size < minimum2 or size == 0.0:
        out[place] = np.nan
        out[place + 1] = np.nan
    else:
        out[place] = (v.real * i.real + v.imag * i.imag) / size
        out[place + 1] = (v.imag * i.real - v.real * i.imag) / size


@njit
def frequency(c: Record, s: Record, v1: complex) -> None:
    """Frequency and its rate of change from the turn of the positive-sequence voltage over one cycle.

    The negative-frequency image that a one-cycle window leaves off nominal frequency cancels in a balanced
    set (Phadke, Thorp and Adamiak 1983).  Evaluated at 16 snapshots a cycle and held between them: an arc
    tangent per sample would cost 20 ns more.
    """
    s.seen += 1
    s.tick += 1
    if s.tick < c.snapshot:
        return
    s.tick = 0
    s.head = (s.head + 1) % c.snapshots
    before = s.v1[s.head]
    f_before = s.f[s.head]
    s.v1[s.head] = v1
    floor = c.minimum_voltage * c.minimum_voltage
    turn = v1 * before.conjugate()
    size = turn.real * turn.real + turn.imag * turn.imag
    if s.seen <= c.settling + c.snapshots * c.snapshot or size < floor * floor:
        s.frequency = np.nan
        s.rocof = np.nan
    else:
        cycle = c.interval * c.snapshots
        s.frequency = c.frequency + math.atan2(turn.imag, turn.real) / (2 * math.pi * cycle)
        s.rocof = (s.frequency - f_before) / cycle
    s.f[s.head] = s.frequency


@njit
def measure(constants: Record, state: Record, phasors: Array, loops: Array) -> None:
    """Fill a block of loop rows (n, 12) from phasor rows (n, 14), and the frequency columns where NaN.

    The frequency columns of all but the rows that the estimator filled are written too, so that the log and
    the memory see the same number.
    """
    c, s = constants[0], state[0]
    minimum2 = c.minimum_current * c.minimum_current
    k0 = c.k0
    for n in range(phasors.shape[0]):
        row, out = phasors[n], loops[n]
        va, vb, vc = complex(row[0], row[1]), complex(row[2], row[3]), complex(row[4], row[5])
        ia, ib, ic = complex(row[6], row[7]), complex(row[8], row[9]), complex(row[10], row[11])
        if np.isnan(row[12]):
            frequency(c, s, (va + A * vb + A2 * vc) / 3)
            row[12] = s.frequency
            row[13] = s.rocof
        residual = k0 * (ia + ib + ic)
        impedance(va, ia + residual, minimum2, out, 0)
        impedance(vb, ib + residual, minimum2, out, 2)
        impedance(vc, ic + residual, minimum2, out, 4)
        impedance(va - vb, ia - ib, minimum2, out, 6)
        impedance(vb - vc, ib - ic, minimum2, out, 8)
        impedance(vc - va, ic - ia, minimum2, out, 10)
