"""RFLO: where on the line the fault is.

Reactance method: m = Im(V / I) / Im(Z1).  Takagi (1982), which takes load and fault resistance out with the
change of the current, in the modified form of Schweitzer (1990) for ground loops (residual current):

    m = Im(V If*) / Im(Z1 I If*)      If = 3 I0 (ground loops), the change of the loop current (phase loops)

The current of a ground loop has the parallel line's residual current in it where that is measured, as the
zones' has (Schweitzer 1990, with I + 3 k0 I0 + 3 kM Ip0).

The answer is the mean over about half a cycle where it stood stillest, the later of two that are equally
still: the window before the estimator has settled and the one in which the breaker opens both move.  It
is frozen when a faulted pole's current is gone, and told when no zone is started any more, even while
another pole still carries current.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from faultloop.config.tables import Table
from faultloop.jit import njit
from faultloop.relay.characteristics import loop_current, loop_voltage
from faultloop.relay.events import Event, Names
from faultloop.relay.functions.function import Function
from faultloop.relay.loop_fit import FIRST, SECOND
from faultloop.relay.memory import at_frequency, size2
from faultloop.relay.quantities import Record
from faultloop.relay.voltages import ALL_PHASES, loops_of

if TYPE_CHECKING:
    from faultloop.relay.settings import RelaySettings

PHASE_LOOP_OF_ABC = 4  # B-C
POLES = (0, 1, 2, 4, 3, 6, 5, 7)
"""Mask of the faulted poles, by fault type."""


class Rflo(Table):
    """``[rflo]``: fault location."""

    method: Literal["takagi", "reactance"] = "takagi"
    """With or without the compensation of load and fault resistance."""


def values(settings: RelaySettings, table: Rflo) -> dict[str, Any]:
    """Which method."""
    return {"takagi": table.method == "takagi"}


@njit
def estimate(g: Record, q: Record, c: Record, loop: int, k0: complex) -> float:
    """Distance by one loop, per unit of the line."""
    v = loop_voltage(q.x, loop)
    i = loop_current(q.x, loop, k0) + (q.mutual if loop < 3 else 0.0)
    polarizing = i
    if c.takagi and loop < 3:
        polarizing = q.x[3] + q.x[4] + q.x[5]
    elif c.takagi:
        polarizing = q.d[3 + FIRST[loop]] - q.d[3 + SECOND[loop]]
    drop = (at_frequency(g, q.memory, g.z1) * i * polarizing.conjugate()).imag
    return (v * polarizing.conjugate()).imag / drop if drop != 0.0 else np.nan


@njit
def start(w: Record, fault: int) -> None:
    """A fault, or another type of it: the answer before stands until there is a new one."""
    if w.fault == 0:
        w.found = 0
    w.fault = fault
    w.count = 0
    w.best_spread = np.inf


@njit
def finish(q: Record, w: Record) -> None:
    """All zones have reset: the answer stands until the next fault that can be located."""
    if w.fault != 0:
        w.fault = 0
        if w.found:
            w.told += 1
            q.notices += 1


@njit
def locate(g: Record, q: Record, c: Record, w: Record) -> None:
    """One sample of the fault locator, while a zone has started."""
    fault = q.fault
    if fault == 0 or q.direction < 0 or q.dead & POLES[fault]:
        return
    if fault != w.fault:
        start(w, fault)
    loop = PHASE_LOOP_OF_ABC if fault == 7 else fault - 1
    if (loops_of(q.suspected | (ALL_PHASES & ~q.proven)) >> loop) & 1:
        return
    k0 = (g.z0 - g.z1) / (3 * g.z1)
    i = loop_current(q.x, loop, k0)
    if size2(i) < g.minimum_current**2:
        return
    m = estimate(g, q, c, loop, k0)
    if m != m:
        return
    w.count += 1
    gain = max(1.0 / w.count, 4.0 / g.cycle)
    w.mean += gain * (m - w.mean)
    w.spread += gain * (abs(m - w.mean) - w.spread)
    if w.count * 2 >= g.cycle and w.spread <= 1.1 * w.best_spread:
        w.value = w.mean
        w.found = 1
        w.best_spread = min(w.spread, w.best_spread)


@njit
def step(g: Record, q: Record, c: Record, w: Record) -> None:
    """One sample of the fault locator."""
    if q.zone_started:
        locate(g, q, c, w)
    else:
        finish(q, w)


def tell(names: Names, was: np.void, now: np.void) -> Iterator[Event]:
    """Where the fault was, once it is over."""
    if now["told"] != was["told"]:
        part, length = float(now["value"]), names.settings.line.length_km
        km = "" if length is None else f", {part * length:.3g} km"
        yield Event(names.sample, "info", f"RFLO1 fault at {part:.3f} of the line{km}")


RFLO = Function(
    name="RFLO",
    settings=Rflo,
    step=step,
    constants=(("takagi", "i8"),),
    values=values,
    state=(
        ("mean", "f8"),
        ("spread", "f8"),
        ("count", "i8"),
        ("best_spread", "f8"),
        ("value", "f8"),  # the answer, per unit of the line
        ("found", "i8"),  # it is of this fault
        ("fault", "i8"),  # the type it is for; 0 between faults
        ("told", "i8"),  # faults located so far
    ),
    start={"value": np.nan},
    always=True,
    bits=(),
    tell=tell,
)
