"""Metal-oxide varistors across a part of the network: ``i = I sgn(u) (|u| / U)^q``, phase by phase.

The network without them is linear, so their currents follow from the voltages that it would have and from
the impedance that they see in it (compensation method, H. W. Dommel, IEEE Trans. PAS-90, 1971); then every
voltage is put right by the currents.  Nothing is factored anew, and a step in which none conducts costs a
comparison.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from faultloop.jit import njit
from faultloop.plant.elements import Floats, Ints
from faultloop.plant.factor import Factor, Structure, solve

IDLE = 0.5
"""Of the level: below it the current is that of the level times 0.5^q, nothing."""
CLOSE = 1e-10
"""Of the level: how near to each other two rounds end."""
MOST_ROUNDS = 100


@dataclass(frozen=True)
class Varistor:
    """Three, one in each phase, between two nodes."""

    start: str
    end: str
    level_v: float
    """Peak."""
    level_a: float
    """Current at ``level_v``."""
    exponent: float


class Varistors(NamedTuple):
    """Constants of all."""

    bus: Ints
    """(varistors, 2) rows of v"""
    curve: Floats
    """(varistors, 3) level [V], current there [A], exponent"""


def varistor_constants(varistors: Sequence[Varistor], row: Mapping[str, int]) -> Varistors:
    """Of a circuit's."""
    return Varistors(
        bus=np.array([[row[x.start], row[x.end]] for x in varistors], dtype=np.int64).reshape(-1, 2),
        curve=np.array([[x.level_v, x.level_a, x.exponent] for x in varistors]).reshape(-1, 3),
    )


@njit
def respond(structure: Structure, factor: Factor, bus: Ints) -> None:
    """Fills ``factor.response``: the voltages [V] that one ampere into a varistor's start and out of its end
    makes everywhere, (varistors, 3, buses, 3), in each phase."""
    for m in range(bus.shape[0]):
        for p in range(3):
            v = factor.response[m, p]
            v[:] = 0.0
            v[bus[m, 0], p] += 1.0
            v[bus[m, 1], p] -= 1.0
            solve(structure, factor, v)


@njit
def across(u: float, impedance: float, curve: Floats) -> float:
    """Voltage of one varistor behind ``impedance`` at a source of ``u``.

    ``x + k x^q = |u| / U`` is increasing and convex, so that Newton's method falls onto the root from above.
    """
    level, amperes, exponent = curve
    driven = abs(u) / level
    k = impedance * amperes / level
    x = min(driven, (driven / k) ** (1.0 / exponent))
    for _ in range(MOST_ROUNDS):
        power = k * x ** (exponent - 1.0)
        change = (x + power * x - driven) / (1.0 + exponent * power)
        x -= change
        if change < CLOSE * x:
            break
    return math.copysign(x * level, u)


@njit
def conduct(net: Varistors, factor: Factor, v: Floats, state: Floats) -> None:
    """Lets the varistors conduct: the voltages of the network without them become those with them.  ``state``
    (varistors, 2, 3) gets the voltages across them without them [V], and their currents [A].

    Phase by phase in turn until nothing changes: what they see of each other is small beside their own.
    """
    busy = False
    for m in range(net.bus.shape[0]):
        for p in range(3):
            u = v[net.bus[m, 0], p] - v[net.bus[m, 1], p]
            state[m, 0, p], state[m, 1, p] = u, 0.0
            busy |= abs(u) > IDLE * net.curve[m, 0]
    rounds = MOST_ROUNDS if busy else 0
    for _ in range(rounds):
        change = 0.0
        for m in range(net.bus.shape[0]):
            for p in range(3):
                change = max(change, renew_current(net, factor, state, m, p))
        if change < CLOSE:
            break
    if busy:
        put_right(factor, v, state)


@njit
def renew_current(net: Varistors, factor: Factor, state: Floats, m: int, p: int) -> float:
    """Of one varistor with the others as they are; by how much its voltage changes, of the level."""
    a, b = net.bus[m, 0], net.bus[m, 1]
    own = factor.response[m, p, a, p] - factor.response[m, p, b, p]
    old = state[m, 1, p]
    u = state[m, 0, p] + own * old
    for n in range(net.bus.shape[0]):
        for s in range(3):
            u -= (factor.response[n, s, a, p] - factor.response[n, s, b, p]) * state[n, 1, s]
    new = (u - across(u, own, net.curve[m])) / own
    state[m, 1, p] = new
    return abs(new - old) * own / net.curve[m, 0]


@njit
def put_right(factor: Factor, v: Floats, state: Floats) -> None:
    """Every voltage, by what the varistors' currents make of it."""
    for m in range(state.shape[0]):
        for p in range(3):
            for k in range(factor.inverse.shape[0]):
                for s in range(3):
                    v[k, s] -= factor.response[m, p, k, s] * state[m, 1, p]
