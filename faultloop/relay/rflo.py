"""RFLO: where on the line the fault is.

Reactance method: m = Im(V / I) / Im(Z1).  Takagi (1982), which takes load and fault resistance out with the
change of the current, in the modified form of Schweitzer (1990) for ground loops (residual current):

    m = Im(V If*) / Im(Z1 I If*)      If = 3 I0 (ground loops), the change of the loop current (phase loops)

The answer is the mean over about half a cycle where it stood stillest, the later of two that are equally
still: the window before the estimator has settled and the one in which the breaker opens both move.
"""

from __future__ import annotations

import numpy as np

from faultloop.jit import njit
from faultloop.relay.memory import size2
from faultloop.relay.pdis import FIRST, SECOND, loop_current, loop_voltage

PHASE_LOOP_OF_ABC = 4  # B-C


@njit
def estimate(c, s, loop, k0):
    """Distance by one loop, per unit of the line."""
    v = loop_voltage(s.x, loop)
    i = loop_current(s.x, loop, k0)
    polarizing = i
    if c.takagi and loop < 3:
        polarizing = s.x[3] + s.x[4] + s.x[5]
    elif c.takagi:
        polarizing = s.d[3 + FIRST[loop]] - s.d[3 + SECOND[loop]]
    drop = (c.z1 * i * polarizing.conjugate()).imag
    return (v * polarizing.conjugate()).imag / drop if drop != 0.0 else np.nan


@njit
def start(w, fault):
    """A fault: forget the one before.  Another type of it: the answer stands until there is a new one."""
    if w.fault == 0:
        w.value = np.nan
    w.fault = fault
    w.count = 0
    w.best_spread = np.inf


@njit
def finish(w):
    """All zones and the trip have reset: the answer stands until the next fault."""
    if w.fault != 0:
        w.fault = 0
        w.told += w.value == w.value


@njit
def step_location(c, s):
    """One sample of the fault locator, while a zone has started."""
    w = s.location
    fault = s.selection.fault
    if fault == 0 or s.direction.direction < 0:
        return
    if fault != w.fault:
        start(w, fault)
    loop = PHASE_LOOP_OF_ABC if fault == 7 else fault - 1
    i = loop_current(s.x, loop, (c.z0 - c.z1) / (3 * c.z1))
    if size2(i) < c.minimum_current**2:
        return
    m = estimate(c, s, loop, (c.z0 - c.z1) / (3 * c.z1))
    if m != m:
        return
    w.count += 1
    gain = max(1.0 / w.count, 4.0 / c.cycle)
    w.mean += gain * (m - w.mean)
    w.spread += gain * (abs(m - w.mean) - w.spread)
    if w.count * 2 >= c.cycle and w.spread <= 1.1 * w.best_spread:
        w.value = w.mean
        w.best_spread = min(w.spread, w.best_spread)
