"""How long a zone without delay waits behind a voltage transformer of which nothing is told.

The transient of a capacitive voltage transformer lasts longer than a cycle and is larger than a fault's
voltage behind a weak source.  So where the change says that the source is weak, the loop in time
(`loop_fit`) is believed only over a window of a cycle and more.

What it still adds after a cycle is slow (the last modes of passive circuits and of active ones have time
constants of 25 to 170 ms): next to nothing but a mean, which falls out where the fit is taken without means.
That may be believed sooner, but its residual counts more, and not behind a source so weak that what is left
is as large as the fault's voltage.  And what is slow turns the impedance: one outside a zone is inside
for little more than a cycle at a time.  All three were chosen on four circuits; docs/evidence.md has their
figures.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from faultloop.jit import njit
from faultloop.relay.memory import size2

Record = Any

WEAK = 3.2
"""Source over line, from the change of voltages and currents: up to here nothing waits."""
LONGEST, STRONGER = 1.5, 5.0
"""Cycles that a zone waits behind a source of 5 times the line and more; less behind a stronger one."""
CENTRED_CYCLES, CENTRED_SOURCE, CENTRED_DOUBT = 1.25, 6.5, 4.0
"""From when on, and up to which source, the fit without means is believed; how much what it leaves counts."""
PHASORS_CYCLES = 1.75
"""Inside without a break for so long, and the phasors are believed as they are.  Faults from 85 % of the line
on were for 1.28 at most (four circuits, sources of 5 to 30 times the line, 48 faults each), those at 30 %
behind the worst circuit for 2.3 and more."""


@njit
def weakness(g: Record, q: Record) -> float:
    """Source over line where a zone may have to wait; 0 where it need not."""
    if g.ideal_vt:
        return 0.0
    voltage2 = size2(q.change[1]) + size2(q.change[2])
    current2 = size2(q.change[4]) + size2(q.change[5])
    ratio = math.sqrt(voltage2 / (current2 * size2(g.z1))) if current2 > 0.0 else np.inf
    return ratio if ratio > WEAK else 0.0


@njit
def is_believed(g: Record, q: Record, ratio: float) -> bool:
    """Whether the fit is, for a source of this weakness."""
    return ratio == 0.0 or q.memory.age >= min(LONGEST, LONGEST - 1.0 + ratio / STRONGER) * g.cycle


@njit
def is_believed_centred(g: Record, q: Record, ratio: float) -> bool:
    """Whether the fit without means is."""
    return 0.0 < ratio < CENTRED_SOURCE and q.memory.age >= CENTRED_CYCLES * g.cycle
