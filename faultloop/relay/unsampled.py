"""Channels of which samples do not come: NaN, from sampled values that are lost or marked invalid.

An estimator goes on for a sample or two by what it knows, and would do so for ever, at the load from before.
What is built on that is a fault's current without one phase; so after an eighth of a cycle a phase counts as
one without voltage or current (`voltages`, `currents`), whatever its phasor says, until values come again.
A voltage is proven in quiet alone; one that was proven before a gap of up to a cycle is so again half a cycle
after it, or a fault that begins in the same disturbance would find none.
"""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from faultloop.jit import njit
from faultloop.relay.recent import LARGEST

Record = Any

PART = 8
"""Of a cycle."""


@njit
def watch(g: Record, q: Record, sample: NDArray) -> None:
    """One sample: ``q.proven`` and ``q.missing`` without the phases whose values do not come."""
    for channel in range(6):
        phase = 1 << channel % 3
        if abs(sample[channel]) < LARGEST:
            come_back(g, q, channel, phase)
            continue
        q.without[channel] = max(q.without[channel], 0) + 1
        if PART * q.without[channel] < g.cycle:
            continue
        if channel >= 3:
            q.missing |= phase
        else:
            q.bridged |= q.proven & phase
            q.proven &= ~phase


@njit
def come_back(g: Record, q: Record, channel: int, phase: int) -> None:
    """A sample of a channel whose values come; below 0 ``q.without`` counts those after a gap."""
    count = q.without[channel]
    q.without[channel] = min(count + 1, 0)
    if PART * count >= g.cycle:
        if channel >= 3:
            q.missing &= ~phase
        elif count <= g.cycle:
            q.without[channel] = -g.cycle // 2
    elif count == -1:
        q.proven |= q.bridged & phase
    if channel < 3 and q.without[channel] == 0:
        q.bridged &= ~phase
