"""What a relay knew at a sample, for a person who asks why: each zone's depth by every loop, released or not,
and everything that can keep it from starting.

Nothing of it is computed while a relay runs.  The decision is a function of the samples, the phasors, the
loops and the inputs (breaker, pilot scheme), all of which a log has; so `faultloop.review.retrace_run` runs
the relay's own chain over them once more, and its bits must come out as they were logged.  Of the samples at
which there is something to explain the kernels below measure by the functions that the zones use themselves.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from faultloop.jit import njit
from faultloop.relay.characteristics import (
    OFFSET,
    QUAD,
    loop_current,
    loop_voltage,
    quad_measures,
)
from faultloop.relay.functions.lphd import cause
from faultloop.relay.functions.pdis import delay, doubt
from faultloop.relay.memory import at_frequency, size2
from faultloop.relay.quantities import Record
from faultloop.relay.voltages import loops_of
from faultloop.relay.zone_depth import ALONE, PHASORS_BEHIND, by_characteristic, uncharged_depth, zone_depth

SHARED = np.dtype(
    [
        ("number", "i8"),  # of the sample
        ("ready", "i8"),
        ("cause", "i8"),  # LPHD: why not, or which loops cannot measure
        ("disturbed", "i8"),
        ("fed", "i8"),
        ("age", "i8"),  # samples of the disturbance
        ("fault", "i8"),
        ("released", "i8"),
        ("behind", "i8"),
        ("direction", "i8"),
        ("fuse_failure", "i8"),
        ("swing", "i8"),  # RPSB: a swing is found
        ("blocked_loops", "i8"),
        ("blocked_zones", "i8"),
        ("unmeasured", "i8"),  # mask of loops with a dead pole, a missing current or no proven voltage
        ("polarizing", "c16"),
        ("frequency", "f8"),  # of the reference
        ("reference", "c16", (6,)),  # the phasors from before the disturbance
    ],
    align=True,
)
ZONE = np.dtype(
    [
        ("m", "f8", (6,)),  # depth by each loop, whatever is released; NaN where it cannot be told
        ("x", "f8", (6,)),  # the part of it along the reactance line ...
        ("r", "f8", (6,)),  # ... and the fault resistance [ohm]
        ("uncharged", "f8", (6,)),  # m by R and X alone
        ("current", "f8", (6,)),  # of the loop, over what it needs
        ("residual", "f8"),  # 3I0 over what a ground loop needs
        ("counter", "f8"),
        ("inside", "i8"),
        ("pickup", "i8"),
        ("operate", "i8"),
        ("timer", "i8"),
        ("delay", "i8"),
        ("waits", "i8"),  # inside for long enough, and now to be confirmed in time
        ("confirmed", "f8"),  # the depth with its doubt that must then be below 1; infinite: it waits
        ("alone", "f8"),  # by the samples, where it counts in place of the phasors'; NaN where it does not
    ],
    align=True,
)


@njit
def shared_row(g: Record, q: Record, swinging: int, out: Record) -> None:
    """``SHARED`` of the sample just decided."""
    out.ready, out.cause, out.disturbed, out.fed = q.ready, cause(g, q), q.disturbed, q.fed
    out.age, out.fault, out.released, out.behind = q.memory.age, q.fault, q.released, q.behind
    out.direction, out.fuse_failure, out.swing = q.direction, q.fuse_failure, swinging
    out.blocked_loops, out.blocked_zones = q.blocked_loops, q.blocked_zones
    out.unmeasured = loops_of(q.dead | q.missing | q.suspected | (7 & ~q.proven))
    out.polarizing = q.polarizing if q.disturbed and not q.fuse_failure else q.sequence[1]
    out.frequency = q.memory.frequency
    for k in range(6):
        out.reference[k] = q.memory.reference[k]


@njit
def measures(g: Record, q: Record, c: Record, loop: int) -> tuple[float, float, float, float]:
    """m, its part along the reactance line, R, and m without the line's charging, of a loop, without the
    least currents."""
    v, i = loop_voltage(q.x, loop), loop_current(q.x, loop, c.k0)
    if not size2(i) > 0.0:
        return np.nan, np.nan, np.nan, np.nan
    x, r = quad_measures(g, q, c, loop, v, i, c.tilt)
    return by_characteristic(g, q, c, loop, v, i), x, r, uncharged_depth(g, q, c, loop, v, i)


@njit
def measures_at_rest(g: Record, q: Record, c: Record, loop: int) -> tuple[float, float, float, float]:
    """The same where there is nothing from before: polarized by the loop's own voltage and current."""
    v, i = loop_voltage(q.x, loop), loop_current(q.x, loop, c.k0)
    if not size2(i) > 0.0:
        return np.nan, np.nan, np.nan, np.nan
    z, reach = v * i.conjugate() / size2(i), at_frequency(g, q.memory, c.reach)
    x, r = z.imag / reach.imag, (z * reach.conjugate()).imag / reach.imag
    if c.characteristic == OFFSET:
        m = np.sqrt(size2(z) / size2(reach))
        return m, x, r, m
    if c.characteristic >= QUAD:
        beside = abs(r) / (c.resistive_ground if loop < 3 else c.resistive_phase)
        m = max(abs(x) if c.direction == 0 else x, beside)
        return m, x, r, m
    along = z.real * reach.real + z.imag * reach.imag
    m = size2(z) / along if along > 0.0 else np.inf
    return m, x, r, m


@njit
def zone_row(g: Record, q: Record, c: Record, w: Record, out: Record) -> None:
    """``ZONE`` of the sample just decided."""
    for loop in range(6):
        measured = measures(g, q, c, loop) if q.disturbed else measures_at_rest(g, q, c, loop)
        out.m[loop], out.x[loop], out.r[loop], out.uncharged[loop] = measured
        out.current[loop] = np.sqrt(size2(loop_current(q.x, loop, c.k0))) / c.minimum_current
    out.residual = 3 * np.sqrt(size2(q.sequence[3])) / c.minimum_residual
    out.counter, out.inside, out.pickup = w.counter, w.inside, w.pickup
    out.operate, out.timer, out.delay = w.operate, w.timer, delay(c, w.fault)
    out.waits, out.confirmed, out.alone = 0, np.nan, np.nan
    mask = q.released & c.loops & ~q.blocked_loops
    if c.direction > 0:
        mask &= ~loops_of(q.behind | q.from_behind)
    if not q.disturbed or w.counter <= 0.0 or w.timer > 0:
        return
    if w.alone > 0:
        out.alone = zone_depth(g, q, c, mask, ALONE, -PHASORS_BEHIND)
    if w.pickup or (w.inside == 0 and w.alone == 0) or w.counter < c.security:
        return
    out.waits = 1
    left = doubt(g, q, w)
    early = left == np.inf or q.memory.age < g.lumped
    out.confirmed = np.inf if early else zone_depth(g, q, c, mask, left, -PHASORS_BEHIND)


@njit
def explain(constants: NDArray, state: NDArray, shared: NDArray, zones: NDArray) -> bool:
    """Fill shared[0] and zones[0] (Z,) from the state after a sample; False where nothing is to tell."""
    c, s = constants[0], state[0]
    g, q = c.shared, s.shared
    swinging = s.rpsb[0].state == 1 if c.count.rpsb else 0
    if q.ready and not (q.disturbed or q.blocked_zones or q.pickup or q.operate):
        return False
    shared_row(g, q, 1 if swinging else 0, shared[0])
    for k in range(c.count.pdis):
        zone_row(g, q, c.pdis[k], s.pdis[k], zones[0, k])
    return True
