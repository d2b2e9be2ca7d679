"""The direction of a disturbance from the energy that it sends through the relay's place.

The change of voltages and currents against what was there before obeys a network with one source, at the
fault; everything else in it is passive and at rest when the fault begins.  So

    E(t) = integral of (dva dia + dvb dib + dvc dic) dt,    current counted into the line,

cannot be negative for a fault behind the relay, whatever is ahead, as that network has nothing to give;
and it cannot be positive for a fault ahead.  It holds at every moment and for every waveform, of
travelling waves and resonances too, and for the samples behind any linear filter that is the same for all
channels (a filtered voltage and a filtered current belong to the same network).  Chamia and Liberman
(IEEE Trans. PAS-97, 1978) take the sign of the first change of the power; its integral has a sign that
stays.

The greatest excursion to either side since before the disturbance tells the direction, once it is a part of
what the sizes of voltage and current allow; then it stays, though what they allow grows on where what was
given comes back, as in a network that resonates near the nominal frequency.  It needs a reference that is
right and stops holding where something else is switched; see RDIR.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from faultloop.jit import njit
from faultloop.relay.recent import SQRT2

Record = Any

LEAST = 0.02
"""Of the apparent energy, sqrt(integral dv^2 dt integral di^2 dt): less is no sign."""
DISTINCT = 4.0
"""How much greater the excursion to one side must be than the one to the other."""
STAYS_CYCLES = 4
"""After so long a direction stays: sources that slip in the fault have gone away from the reference."""

POWER, VOLTAGE2, CURRENT2 = range(3)
ENERGY = np.dtype(
    [
        ("now", "f8", (3,)),  # sums over samples of dv di, dv^2, di^2
        ("before", "f8", (3,)),  # in quiet: those of the half cycle before
        ("count", "i8"),
        ("following", "i8"),  # samples of a disturbance
        ("lowest", "f8"),  # excursion of the power's sum since the disturbance began
        ("highest", "f8"),
        ("direction", "i8"),  # 1 forward, -1 reverse, 0 not known
    ],
    align=True,
)


@njit
def accumulate(e: Record, sample: NDArray, reference: NDArray, turn: complex) -> None:
    """One sample's change against the reference phasors (RMS), ``turn`` = e^(j w0 t)."""
    for k in range(3):
        dv = sample[k] - SQRT2 * (reference[k] * turn).real
        di = sample[3 + k] - SQRT2 * (reference[3 + k] * turn).real
        e.now[POWER] += dv * di
        e.now[VOLTAGE2] += dv * dv
        e.now[CURRENT2] += di * di


@njit
def rest(g: Record, e: Record, ready: bool) -> None:
    """In quiet: forget what is older than a cycle.  A disturbance is noticed some samples after it began, so
    the last half cycle counts with it.  What was before the reference was right, and the disturbance that
    has just ended, do not."""
    if not ready or e.following:
        e.following = 0
        e.direction = 0
        e.count = 0
        e.before[:] = 0.0
        e.now[:] = 0.0
        return
    e.count += 1
    if 2 * e.count >= g.cycle:
        e.count = 0
        for p in range(3):
            e.before[p], e.now[p] = e.now[p], 0.0


@njit
def follow(g: Record, e: Record) -> None:
    """In a disturbance: excursions and direction."""
    if not e.following:
        e.lowest = e.highest = 0.0
    e.following += 1
    if e.direction and e.following > STAYS_CYCLES * g.cycle:
        return
    energy = e.before[POWER] + e.now[POWER]
    apparent = math.sqrt((e.before[VOLTAGE2] + e.now[VOLTAGE2]) * (e.before[CURRENT2] + e.now[CURRENT2]))
    e.lowest = min(e.lowest, energy)
    e.highest = max(e.highest, energy)
    forward, reverse = -e.lowest, e.highest
    if forward > max(LEAST * apparent, DISTINCT * reverse):
        e.direction = 1
    elif reverse > max(LEAST * apparent, DISTINCT * forward):
        e.direction = -1
    elif (e.direction > 0 and forward <= DISTINCT * reverse) or (
        e.direction < 0 and reverse <= DISTINCT * forward
    ):
        e.direction = 0
