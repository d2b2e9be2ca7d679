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
Charge = tuple[float, float, float]
Sums = tuple[float, float, float, float, float, float, float, float, float]
Fit = tuple[float, float, float]
"""m, what it leaves, r [ohm]."""

SHORTEST, LONGEST = 4, 15
"""Tenths of a cycle: the window grows with the disturbance."""
FIRST = (0, 1, 2, 0, 1, 2)
SECOND = (1, 2, 0, 1, 2, 0)
SINGULAR = 1e-6
UNCHARGED = (0.0, 0.0, 0.0)
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
def charged_values(r: Record, back: int, loop: int, charge: Charge) -> tuple[float, float, float]:
    """`loop_values` with what the line's charging changes in them (`charging.charge_in_time`), but one value
    earlier: a second difference wants one on either side."""
    if charge[0] == 0.0:
        return loop_values(r, back, loop)
    v, i, n = loop_values(r, back + 1, loop)
    of_loop, of_zero, of_drop = charge
    head = r.head - back
    new, now, old = (
        r.value[head % LENGTH],
        r.value[(head - 1) % LENGTH],
        r.value[(head - 2) % LENGTH],
    )
    if loop < 3:
        v0 = new[0] + new[1] + new[2] + old[0] + old[1] + old[2] - 2.0 * (now[0] + now[1] + now[2])
        i0 = new[3] + new[4] + new[5] + old[3] + old[4] + old[5] - 2.0 * (now[3] + now[4] + now[5])
        v += of_loop * (new[loop] + old[loop] - 2.0 * now[loop]) + of_zero * v0 / 3.0
        return v, i + of_drop * i0 / 3.0, n + of_drop * i0
    first, second = FIRST[loop], SECOND[loop]
    bend = new[first] + old[first] - 2.0 * now[first] - new[second] - old[second] + 2.0 * now[second]
    return v + of_loop * bend, i, n


@njit
def window(g: Record, age: int) -> int:
    """Values of the fit's, for a disturbance of this age [samples]: what still rings late is the slower the
    longer it has lasted, and wants a longer mean."""
    return min(max(10 * age, SHORTEST * g.cycle), LONGEST * g.cycle) * g.values // (10 * g.cycle)


@njit(heap=True)
def gather(
    g: Record, r: Record, drop: Drop, loop: int, means: Means, window: int, charge: Charge = UNCHARGED
) -> Sums:
    """Sums over the window of uu uv vv uf ff vf u v f: v the voltage, u the drop along the reach, f the
    fault's current, each averaged over ``means``, three counts of values, one after the other; ``drop``: the
    reach [ohm], and its part for the residual; with a ``charge`` two values more are looked at.

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
        dv, di, dn = charged_values(r, j, loop, charge)
        v, i, n = v + dv, i + di, n + dn
    kept, kept_last = np.zeros((3, second)), np.zeros((3, last))
    sum_u = sum_v = sum_f = 0.0
    last_u = last_v = last_f = 0.0
    uu = uv = vv = uf = ff = vf = 0.0
    u1 = v1 = f1 = 0.0
    for k in range(first):
        j = first - 1 - k
        new_v, new_i, new_n = charged_values(r, j, loop, charge)
        old_v, old_i, old_n = charged_values(r, j + mean, loop, charge)
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
def fit(sums: Sums, sign: int) -> Fit:
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
def doubted(fitted: Fit, direction: int, reach: float, doubt: float, behind: float) -> float:
    """m of a `fit` with ``doubt`` times what it leaves added; infinite for one behind a loop with a direction
    by more than a tenth, a part of the resistance, and ``behind`` times what it leaves."""
    m, left, r = fitted
    if direction == 0:
        return abs(m) + doubt * left
    least = BEHIND[0] + BEHIND[1] * abs(r) / reach + behind * left
    return m + doubt * left if m > -least else np.inf
