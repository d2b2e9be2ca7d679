"""Channels of which samples do not come: NaN, from sampled values that are lost or marked invalid.

An estimator goes on for a sample or two by what it knows, and would do so for ever, at the load from before.
What is built on that is a fault's current without one phase; so after an eighth of a cycle a phase counts as
one without voltage or current (`voltages`, `currents`), whatever its phasor says, until values come again.
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
            if PART * q.without[channel] >= g.cycle and channel >= 3:
                q.missing &= ~phase
            q.without[channel] = 0
            continue
        q.without[channel] += 1
        if PART * q.without[channel] >= g.cycle:
            if channel < 3:
                q.proven &= ~phase
            else:
                q.missing |= phase
