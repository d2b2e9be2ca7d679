"""Differential data between a relay and its node: the set that it has measured, those that it is given."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from faultloop.io.can.differential import BARE, EXTERNAL, TRANSFERS
from faultloop.io.can.port import DIFFERENTIAL
from faultloop.io.can.record import Record
from faultloop.jit import njit
from faultloop.nodes.clock import SECOND_NS
from faultloop.nodes.node import Nodes
from faultloop.nodes.sets import CHANNEL, GLOBAL, NOT, WAITING, microseconds
from faultloop.nodes.time_sync import clock_us, knows_time

US = 1e6


@njit
def say_set(nodes: Nodes, i: int, g: Record, q: Record, c: Record, w: Record, t_ns: int) -> None:
    """The newest own set, for the node to send at ``t_ns``."""
    m, own = nodes.own_set[i], w.own[w.index % w.own.shape[0]]
    m.kind = DIFFERENTIAL
    m.number = nodes.node[i].relay
    n = nodes.node[i]
    sample_ns = q.number * SECOND_NS // np.int64(g.sampling)
    m.time = clock_us(n, sample_ns)
    m.poles = own.valid
    m.state = synchronized(n, c, sample_ns)
    m.alarms = (EXTERNAL if w.external > 0 else 0) | (TRANSFERS if w.trips and c.transfer else 0)
    m.alarms |= BARE if own.bare else 0
    m.test = 0
    m.rejected = c.hash
    # against the clock that the set's time is of: what it is ahead, the phasor is behind
    turn = turn_of(g, -1e-6 * microseconds(m.time - sample_ns // 1000))
    for phase in range(3):
        current = own.i[phase] * turn
        m.values[2 * phase] = current.real
        m.values[2 * phase + 1] = current.imag
    nodes.node[i].set_ns = t_ns


@njit
def turn_of(g: Record, seconds: float) -> complex:
    """By how much a phasor turns in that time."""
    angle = 2 * math.pi * g.frequency * seconds
    return complex(math.cos(angle), math.sin(angle))


@njit
def synchronized(n: Record, c: Record, t_ns: int) -> int:
    """How a node's clock is synchronized."""
    if c.by_channel:
        return CHANNEL
    return GLOBAL if knows_time(n, t_ns) else NOT


@njit
def give_sets(nodes: Nodes, i: int, g: Record, q: Record, c: Record, w: Record) -> None:
    """What the node has taken since, to the relay, and how well the ends are aligned."""
    n = nodes.node[i]
    w.remotes = min(n.sources, w.remote.shape[0])
    own_us = clock_us(n, q.number * SECOND_NS // np.int64(g.sampling))
    for k in range(w.remotes):
        source, far = nodes.source[n.first_source + k], w.remote[k]
        source.given = max(source.given, source.count - WAITING)
        while source.given < source.count:
            m = nodes.sets[n.first_source + k, source.given % WAITING]
            far.number = m.number
            far.since = 0
            far.synchronized = m.state
            far.transfers = far.transfers + 1 if m.alarms & TRANSFERS else 0
            if m.state == NOT:
                w.out_of_time |= 1 << k
            else:
                w.out_of_time &= ~(1 << k)
                take_set(g, q.number, own_us, c.per_cycle, far, m)
            source.given += 1
        far.ways_us, far.vary_us = 2 * source.half_us, source.vary_us
        far.trip_us, far.clock_us = source.trip_us, source.clock_us
        held = far.synchronized == CHANNEL and not c.by_channel
        far.holds += held and not far.held
        far.held = held
        far.switches, far.jumps = source.switches, source.jumps


@njit
def take_set(g: Record, number: int, own_us: int, per_cycle: int, far: Record, m: Record) -> None:
    """One set of another end, to where its instant has its place; ``own_us`` is this end's clock at
    sample ``number``."""
    far.late_us = microseconds(own_us - m.time)
    eighth_us = US / (per_cycle * g.frequency)
    if far.late_us < -eighth_us * far.set.shape[0] / 2:
        return  # of a time that is still to come
    # a set is of the first sample in its eighth of a cycle, up to a sample after that has begun
    index = np.int64(np.rint((number * US / g.sampling - far.late_us - US / g.sampling / 2) / eighth_us))
    # what was against the other clock, against this one's, and then against the samples' own time
    ahead_us = microseconds(own_us - np.int64(np.rint(number * US / g.sampling)) & 0xFFFFFFFF)
    turn = turn_of(g, 1e-6 * (m.values[6] + ahead_us))
    own = far.set[index % far.set.shape[0]]
    own.index = index
    own.valid = m.poles
    own.bare = 1 if m.alarms & BARE else 0
    for phase in range(3):
        own.i[phase] = complex(m.values[2 * phase], m.values[2 * phase + 1]) * turn


@njit
def say_first(nodes: Nodes, i: int, constants: NDArray[Any], state: NDArray[Any], t_ns: int) -> None:
    """`say_set` for whoever is not compiled: ``CONSTANTS`` and ``STATE``, (1,)."""
    c, s = constants[0], state[0]
    say_set(nodes, i, c.shared, s.shared, c.pdif[0], s.pdif[0], t_ns)


@njit
def give_first(nodes: Nodes, i: int, constants: NDArray[Any], state: NDArray[Any]) -> None:
    """`give_sets` for whoever is not compiled."""
    c, s = constants[0], state[0]
    give_sets(nodes, i, c.shared, s.shared, c.pdif[0], s.pdif[0])
