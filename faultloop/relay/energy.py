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

import cmath
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from faultloop.jit import njit
from faultloop.relay.recent import LENGTH, SQRT2

Record = Any

LEAST = 0.02
"""Of the apparent energy, sqrt(integral dv^2 dt integral di^2 dt): less is no sign."""
DISTINCT = 4.0
"""How much greater the excursion to one side must be than the one to the other."""
STAYS_CYCLES = 4
"""After so long a direction stays, and once lost no other one is given: sources that slip in the fault have
gone away from the reference ..."""
MOVING_CYCLES = 1
"""... or after so long, in a fault within what moved before it."""

POWER, VOLTAGE2, CURRENT2 = range(3)
ENERGY = np.dtype(
    [
        ("now", "f8", (3,)),  # sums over samples of dv di, dv^2, di^2
        ("before", "f8", (3,)),  # in quiet: those of the half cycle before
        ("count", "i8"),
        ("following", "i8"),  # samples of a disturbance
        ("moving", "i8"),  # it began within another one
        ("lowest", "f8"),  # excursion of the power's sum since the disturbance began
        ("highest", "f8"),
        ("direction", "i8"),  # 1 forward, -1 reverse, 0 not known
        ("given", "i8"),  # the last one that was known in this disturbance
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
        e.moving = 0
        e.direction = e.given = 0
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
def again(g: Record, e: Record, r: Record, m: Record, turn: complex) -> None:
    """Begin with what the last half cycle has against the memory's reference of now, from the values
    that `recent` keeps: a disturbance that is noticed within another one, some samples after it began.  A sum
    that began later would have no sign that holds."""
    rest(g, e, False)
    e.moving = 1
    late = r.count + 0.5 * (g.stride - 1)  # of the newest value, in samples
    angle = g.turn_per_value + cmath.phase(m.rotor) * g.stride
    at = turn * cmath.rect(1.0, -angle / g.stride * late)
    back = cmath.rect(1.0, -angle)
    for j in range(g.values // 2):
        for k in range(3):
            dv = r.value[(r.head - j) % LENGTH, k] - SQRT2 * (m.reference[k] * at).real
            di = r.value[(r.head - j) % LENGTH, 3 + k] - SQRT2 * (m.reference[3 + k] * at).real
            e.now[POWER] += g.stride * dv * di
            e.now[VOLTAGE2] += g.stride * dv * dv
            e.now[CURRENT2] += g.stride * di * di
        at *= back


@njit
def follow(g: Record, e: Record) -> None:
    """In a disturbance: excursions and direction."""
    if not e.following:
        e.lowest = e.highest = 0.0
    e.following += 1
    late = e.following > (MOVING_CYCLES if e.moving else STAYS_CYCLES) * g.cycle
    if late and e.direction:
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
    if late and e.given and e.direction != e.given:
        e.direction = 0
    elif e.direction:
        e.given = e.direction
