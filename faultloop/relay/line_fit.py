"""The loop's fit in time on a line that has capacitance (`loop_fit`, `charging`)."""

from __future__ import annotations

from typing import Any

import numpy as np

from faultloop.jit import njit
from faultloop.relay.charging import charge_in_time
from faultloop.relay.loop_fit import Drop, Fit, fit, gather, window

Record = Any

PASSES = 2
"""Fits with the line's charging, the first for a fault where the one without says, the next for one halfway
from there to what the first finds, as what is too far in comes out too near by some six tenths of that."""
ALIKE = 0.05
"""Three loops see one fault where each fit leaves less than this of the drop along the line, and where their
m and resistances, per unit of the line, differ by less than this and this part of m."""


@njit
def charged_fit(g: Record, r: Record, drop: Drop, reach: float, loop: int, age: int, fitted: Fit) -> Fit:
    """The fit ahead with what charges the line up to the fault; ``drop`` is that of ``reach`` of the line,
    ``fitted`` the one without.

    What rings on a long line, at two to four times the nominal frequency, is charged by four to sixteen times
    as much: of five faults that took 21 to 44 ms on 113 to 388 km the fit left 0.05 to 0.25 of the drop
    without, 0.005 to 0.04 with it, and m is the place to 0.002 (bench/security.py, seed 97030).
    """
    length = window(g, age)
    mean, at = max(length // 8, 1), fitted[0]
    for _ in range(PASSES):
        charge = charge_in_time(g, min(max(at, 0.0), 1.0) * reach, loop)
        sums = gather(g, r, drop, loop, (mean, mean, mean), length - 3 * mean, charge)
        fitted = fit(sums, 1)
        at = 0.5 * (at + fitted[0])
    return fitted


@njit
def pairs_alike(g: Record, r: Record, age: int) -> bool:
    """Whether the three pairs see the same impedance in time: a three-phase fault, or a balanced change.

    What rings on the way to it is in no two phases alike, so that phasors show now this pair and now that.
    With the charging two of 4,364 faults within 60 % of 200 to 400 km start zone 1 within 16 ms, which
    took 24 and 28 without (bench/security.py, kind long, seed 97030, networks 195 and 473).
    """
    length = window(g, age)
    mean = max(length // 8, 1)
    low = low_r = np.inf
    high = high_r = -np.inf
    for loop in range(3, 6):
        drop = g.z1, 0j
        sums = gather(g, r, drop, loop, (mean, mean, mean), length - 3 * mean + 2)
        fitted = fit(sums, -1 if sums[1] < 0.0 else 1)
        if fitted[1] >= ALIKE and sums[1] > 0.0 and g.b1 > 0.0 and g.ideal_vt:
            fitted = charged_fit(g, r, drop, 1.0, loop, age, fitted)
        m, left, resistance = fitted
        if not left < ALIKE:
            return False
        per_unit = resistance / abs(g.z1)
        low, high = min(low, m), max(high, m)
        low_r, high_r = min(low_r, per_unit), max(high_r, per_unit)
    most = ALIKE * (1.0 + max(high, -low))
    return high - low < most and high_r - low_r < most
