"""The faulted loop in time: v = m (R i + L di/dt) + r i_f, fitted to the last samples.

For a fault on the line this holds for every waveform that voltage and current have - decaying offset,
resonance of the networks on both sides, any frequency - as the loop is a piece of line and a resistance.
Where the fault is elsewhere, or another loop is faulted, the waveforms of v and of R i + L di/dt differ
as soon as there is more than one frequency in them.  So the fit gives a depth m that needs no filter to
settle, and what it leaves says how far m can be trusted: its root mean square over that of the drop along
the reach is in units of m.  Through a low-pass (a mean) that is the same for v and i the equation stays
as it is.

It is the differential-equation algorithm (McInnes and Morrison, 1971; Ranjbar and Cory, IEEE Trans. PAS-94,
1975) with the trapezoidal rule, over a sliding window, with the fault resistance as a second unknown that
cannot be negative.  i_f: the residual current for a ground loop, which has no load in it; the loop's own for
a phase loop.  Samples from before the fault spoil it, so a window that still has some refuses by itself.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from faultloop.jit import njit
from faultloop.relay.recent import LENGTH

Record = Any
Drop = tuple[complex, complex]
Sums = tuple[float, float, float, float, float, float]

FIRST = (0, 1, 2, 0, 1, 2)
SECOND = (1, 2, 0, 1, 2, 0)
SINGULAR = 1e-6
BEHIND = (0.1, 0.27, 0.25)
"""How far behind the relay m may be: for any fault, for its resistance over the reach, for what is left."""


@njit
def loop_values(r: Record, back: int, loop: int) -> tuple[float, float, float]:
    """v, i and the residual current (of a ground loop), with the parallel line's part of it, ``back`` values
    ago."""
    x = r.value[(r.head - back) % LENGTH]
    if loop < 3:
        return x[loop], x[3 + loop], x[3] + x[4] + x[5] + r.mutual * x[6]
    first, second = FIRST[loop], SECOND[loop]
    return x[first] - x[second], x[3 + first] - x[3 + second], 0.0


@njit
def gather(g: Record, r: Record, drop: Drop, loop: int, mean: int, window: int) -> Sums:
    """Sums over the window of uu uv vv uf ff vf: v the voltage, u the drop along the reach, f the fault's
    current, each averaged over ``mean`` values; ``drop``: the reach [ohm], and its part for the residual."""
    along, residual = drop
    # di/dt by the trapezoidal rule, so scaled that it is exact at the nominal frequency.
    rate = 0.5 / math.tan(0.5 * g.turn_per_value)
    v = i = n = 0.0
    for j in range(window, window + mean):
        dv, di, dn = loop_values(r, j, loop)
        v, i, n = v + dv, i + di, n + dn
    uu = uv = vv = uf = ff = vf = 0.0
    for j in range(window - 1, -1, -1):
        new_v, new_i, new_n = loop_values(r, j, loop)
        old_v, old_i, old_n = loop_values(r, j + mean, loop)
        dv, di, dn = new_v - old_v, new_i - old_i, new_n - old_n
        y = v + 0.5 * dv
        f = n + 0.5 * dn if loop < 3 else i + 0.5 * di
        u = along.real * (i + 0.5 * di) + residual.real * (n + 0.5 * dn)
        u += rate * (along.imag * di + residual.imag * dn)
        v, i, n = v + dv, i + di, n + dn
        uu, uv, vv = uu + u * u, uv + u * y, vv + y * y
        uf, ff, vf = uf + u * f, ff + f * f, vf + y * f
    return uu, uv, vv, uf, ff, vf


@njit
def fit(sums: Sums, sign: int) -> tuple[float, float, float]:
    """m, the root mean square of what is left over that of u, and r [ohm]; infinite without a current.  r is
    not negative for a loop that looks along ``sign``."""
    uu, uv, vv, uf, ff, vf = sums
    if not uu > 0.0:
        return np.inf, np.inf, 0.0
    m, left, r = uv / uu, vv - uv * uv / uu, 0.0
    determinant = uu * ff - uf * uf
    if determinant > SINGULAR * uu * ff:
        along = (vf * uu - uv * uf) / determinant
        if along * sign > 0.0:
            r = along
            m = (uv * ff - vf * uf) / determinant
            left = vv - m * uv - r * vf
    return m, math.sqrt(max(left, 0.0) / uu), r


@njit
def doubted(sums: Sums, direction: int, reach: float, doubt: float) -> float:
    """m with ``doubt`` times what the fit leaves added; infinite for one behind a loop with a direction."""
    m, left, r = fit(sums, -1 if direction < 0 else 1)
    if direction == 0:
        return abs(m) + doubt * left
    behind = BEHIND[0] + BEHIND[1] * abs(r) / reach + BEHIND[2] * left
    return m + doubt * left if m > -behind else np.inf
