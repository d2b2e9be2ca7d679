"""A second fault while the first one goes on: the change against the state that the first has settled to.

What the first fault has changed against the memory says nothing about a second one at another place.  But
superposition holds for the second by itself: the network with the first fault in it gets one new source.  So
once the phasors have stood still that state is kept, as the memory keeps the one from before the first; what
then changes against it has a type and, by its energy, a direction of its own.

The reference goes along with what moves slowly, a quarter of a cycle behind, until something changes against
it; when the phasors stand still again it is renewed.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from faultloop.jit import njit
from faultloop.relay import energy
from faultloop.relay.energy import ENERGY
from faultloop.relay.memory import differs, power, weight

Record = Any

SETTLED = 0.1
"""Of the whole change, within a quarter of a cycle: less, and the first fault's state has settled."""
DISTINCT = 0.15
"""Of the whole change: more is a second one."""

SECOND = np.dtype(
    [
        ("reference", "c16", (6,)),  # phasors of the settled state
        ("settled", "i8"),  # there is one
        ("active", "i8"),  # a second change against it
        ("age", "i8"),  # samples since
        ("d", "c16", (6,)),  # that change
        ("energy", ENERGY),
    ],
    align=True,
)


@njit
def forget(s: Record) -> None:
    """There is no first fault."""
    s.settled = s.active = s.age = 0


@njit
def settle(g: Record, q: Record) -> None:
    """At a snapshot: keep the state of a quarter of a cycle ago where nothing has moved since."""
    s, m = q.second, q.memory
    back = g.snapshots // 8
    if 4 * m.age < 3 * g.cycle or (s.active and s.age < g.cycle):
        return
    slot = (m.head - back) % g.snapshots
    turn = power(m.rotor, g.snapshot * back)
    for k in range(6):
        m.work[k] = q.x[k] - turn * m.ring[slot, k]
    if weight(g, m.work) < SETTLED**2 * weight(g, q.d):
        for k in range(6):
            s.reference[k] = turn * m.ring[slot, k]
        if s.active or not s.settled:
            energy.rest(g, s.energy, False)
        s.settled, s.active, s.age = 1, 0, 0


@njit
def differs_again(g: Record, q: Record) -> bool:
    """Whether something has changed against the settled state."""
    s = q.second
    for k in range(6):
        s.d[k] = q.x[k] - s.reference[k]
    return weight(g, s.d) > DISTINCT**2 * weight(g, q.d) and differs(g, q.x, s.reference)


@njit
def follow(g: Record, q: Record, turn: complex) -> None:
    """One sample in a disturbance, ``turn`` = e^(j w0 t)."""
    s = q.second
    for k in range(6):
        s.reference[k] *= q.memory.rotor
    if q.memory.tick == 0:
        settle(g, q)
    if not s.settled:
        return
    energy.accumulate(s.energy, q.sample, s.reference, turn)
    again = differs_again(g, q)
    if not s.active and not again:
        energy.rest(g, s.energy, True)
        return
    s.active = 1
    s.age += 1
    energy.follow(g, s.energy)
