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
Means = tuple[int, int, int]
Sums = tuple[float, float, float, float, float, float, float, float, float]

SHORTEST, LONGEST = 4, 15
"""Tenths of a cycle: the window grows with the disturbance."""
ALIKE = 0.05
"""Three loops see one fault where each fit leaves less than this of the drop along the line, and where their
m and resistances, per unit of the line, differ by less than this and this part of m."""
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
def window(g: Record, age: int) -> int:
    """Values of the fit's, for a disturbance of this age [samples]: what still rings late is the slower the
    longer it has lasted, and wants a longer mean."""
    return min(max(10 * age, SHORTEST * g.cycle), LONGEST * g.cycle) * g.values // (10 * g.cycle)


@njit(heap=True)
def gather(g: Record, r: Record, drop: Drop, loop: int, means: Means, window: int) -> Sums:
    """Sums over the window of uu uv vv uf ff vf u v f: v the voltage, u the drop along the reach, f the
    fault's current, each averaged over ``means``, three counts of values, one after the other; ``drop``: the
    reach [ohm], and its part for the residual.

    Travelling waves are no matter of R and L: each mean takes of them what the one before lets through, and
    three of a length leave the least that so many values can.
    """
    along, residual = drop
    mean, second, last = means
    # di/dt by the trapezoidal rule, so scaled that it is exact at the nominal frequency.
    rate = 0.5 / math.tan(0.5 * g.turn_per_value)
    v = i = n = 0.0
    first = window + second + last - 2
    for j in range(first, first + mean):
        dv, di, dn = loop_values(r, j, loop)
        v, i, n = v + dv, i + di, n + dn
    kept, kept_last = np.zeros((3, second)), np.zeros((3, last))
    sum_u = sum_v = sum_f = 0.0
    last_u = last_v = last_f = 0.0
    uu = uv = vv = uf = ff = vf = 0.0
    u1 = v1 = f1 = 0.0
    for k in range(first):
        j = first - 1 - k
        new_v, new_i, new_n = loop_values(r, j, loop)
        old_v, old_i, old_n = loop_values(r, j + mean, loop)
        dv, di, dn = new_v - old_v, new_i - old_i, new_n - old_n
        y = v + 0.5 * dv
        f = n + 0.5 * dn if loop < 3 else i + 0.5 * di
        u = along.real * (i + 0.5 * di) + residual.real * (n + 0.5 * dn)
        u += rate * (along.imag * di + residual.imag * dn)
        v, i, n = v + dv, i + di, n + dn
        place = k % second
        sum_u, sum_v, sum_f = sum_u - kept[0, place], sum_v - kept[1, place], sum_f - kept[2, place]
        kept[0, place], kept[1, place], kept[2, place] = u, y, f
        sum_u, sum_v, sum_f = sum_u + u, sum_v + y, sum_f + f
        if k < second - 1:
            continue
        place = k % last
        last_u, last_v = last_u - kept_last[0, place], last_v - kept_last[1, place]
        last_f -= kept_last[2, place]
        kept_last[0, place], kept_last[1, place], kept_last[2, place] = sum_u, sum_v, sum_f
        last_u, last_v, last_f = last_u + sum_u, last_v + sum_v, last_f + sum_f
        if k >= second + last - 2:
            uu, uv, vv = uu + last_u * last_u, uv + last_u * last_v, vv + last_v * last_v
            uf, ff, vf = uf + last_u * last_f, ff + last_f * last_f, vf + last_v * last_f
            u1, v1, f1 = u1 + last_u, v1 + last_v, f1 + last_f
    return uu, uv, vv, uf, ff, vf, u1, v1, f1


@njit
def centred(sums: Sums, window: int) -> Sums:
    """The sums without the mean of u, v and f over the window: whatever has been added to one of them and
    stays as it is falls out."""
    uu, uv, vv, uf, ff, vf, u, v, f = sums
    return (
        uu - u * u / window,
        uv - u * v / window,
        vv - v * v / window,
        uf - u * f / window,
        ff - f * f / window,
        vf - v * f / window,
        0.0,
        0.0,
        0.0,
    )


@njit
def fit(sums: Sums, sign: int) -> tuple[float, float, float]:
    """m, the root mean square of what is left over that of u, and r [ohm]; infinite without a current.  r is
    not negative for a loop that looks along ``sign``."""
    uu, uv, vv, uf, ff, vf, _, _, _ = sums
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
def pairs_alike(g: Record, r: Record, age: int) -> bool:
    """Whether the three pairs see the same impedance in time: a three-phase fault, or a balanced change.

    What rings on the way to it is in no two phases alike, so that phasors show now this pair and now that.
    """
    length = window(g, age)
    mean = max(length // 8, 1)
    low = low_r = np.inf
    high = high_r = -np.inf
    for loop in range(3, 6):
        sums = gather(g, r, (g.z1, 0j), loop, (mean, mean, mean), length - 3 * mean + 2)
        m, left, resistance = fit(sums, -1 if sums[1] < 0.0 else 1)
        if not left < ALIKE:
            return False
        per_unit = resistance / abs(g.z1)
        low, high = min(low, m), max(high, m)
        low_r, high_r = min(low_r, per_unit), max(high_r, per_unit)
    most = ALIKE * (1.0 + max(high, -low))
    return high - low < most and high_r - low_r < most


@njit
def doubted(
    fitted: tuple[float, float, float], direction: int, reach: float, doubt: float, behind: float
) -> float:
    """m of a `fit` with ``doubt`` times what it leaves added; infinite for one behind a loop with a direction
    by more than a tenth, a part of the resistance, and ``behind`` times what it leaves."""
    m, left, r = fitted
    if direction == 0:
        return abs(m) + doubt * left
    least = BEHIND[0] + BEHIND[1] * abs(r) / reach + behind * left
    return m + doubt * left if m > -least else np.inf
