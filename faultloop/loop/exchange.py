"""Everything that the nodes of a run say to each other, compiled: who has something due, how the bus carries
it, who takes it.

`serve` lets time pass on the bus and at the nodes until something acts on a relay or a breaker.  What a
person or a log wants to know of it goes into a ring, which Python empties.  Where Python has a part in it (a
key, a fault on the bus, an attacker, a device on a real bus), `serve` stops, and goes on when called again.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from faultloop.io.can.arbitration import (
    ASKS,
    IDENTIFIERS,
    Bus,
    advance,
    next_event_ns,
    off,
    submit,
)
from faultloop.io.can.codes import FINE
from faultloop.io.can.port import HEARTBEAT, NOBODY, encode
from faultloop.io.can.record import FRAME, MESSAGE, Record, Records
from faultloop.jit import njit
from faultloop.nodes.channel import Channels, arrival_ns, arrived, channel_of, cut_off, enter
from faultloop.nodes.node import MOST, TAKEN, Nodes, next_ns, poll, receive

LOOK, ADVANCE, HEAR, TURN, POLL = range(5)
"""What `serve` does next."""
DONE, ACTED, FAULT_OF_WIRE, RECEIVED, DUE, OFFERED, FULL = range(7)
"""Why it returns: nothing more happens until then; somebody acts; is the transmission hit?  Python is to take
what was received; has something due; is to send what is offered; is to empty the ring or to make room."""
FRAME_SEEN, STATE_TAKEN, REFUSED, BEAT, CONTROLLER, POLES_CHANGED, FAULT_CHANGED, SILENCE = range(8)
"""Events in the ring."""
SECOND_NS = 1_000_000_000
RING = 512
ARRIVALS = 8
"""By one channel at once, at most; what has arrived beside comes next."""

CONTROL = np.dtype(
    [
        (name, "i8")
        for name in (
            "phase",
            "now_ns",
            "last",  # 1: now is the end of what was asked for
            "python_ns",  # when Python has something due
            "hears",  # 1: Python takes what is received; 2: it is asked whenever time has passed
            "sends",  # 1: Python sends what the nodes have to say
            "quiet",  # 1: frames are counted, and none is told
            "offered",  # how many messages
            "events",  # how many are in the ring
            "frames",
            "sample",  # number of the next sample, which events are of
        )
    ]
)
SEAT = np.dtype(
    [
        ("sender", "i8"),  # what the bus knows it by
        ("away", "i8"),  # 1: it is restarting, and sends nothing
        ("deaf", "i8"),  # 1: a fault keeps it off the bus
        ("breaker", "i8"),  # 1: a state without poles does not act on it
        ("number", "i8"),  # of the relay or breaker
        ("objection", "i8"),  # to the sealed frame that is heard now
    ]
)
EVENT = np.dtype(
    [
        (name, "i8")
        for name in (
            "sample",
            "t_ns",
            "what",
            "node",
            "identifier",
            "value",
            "closed",
        )  # poles before a command
    ]
)


class Exchange(NamedTuple):
    """Bus, nodes and ring."""

    control: Records
    """(1,) CONTROL"""
    seats: Records
    """(n,) SEAT, of the nodes"""
    nodes: Nodes
    bus: Bus
    offers: Records
    """(n * MOST,) MESSAGE that the nodes have to say now"""
    offered_by: NDArray[np.int64]
    plain: Records
    """(n,) FRAME: what is in the sealed frame that is heard now, for each node"""
    scratch: tuple[Records, Records]
    """(1,) FRAME, (1,) MESSAGE"""
    events: Records
    """(RING,) EVENT"""
    frames: Records
    """(RING,) FRAME of the events"""
    counted: NDArray[np.int64]
    """(2049,) frames by identifier; the last: extended ones"""
    channels: Channels


def new_exchange(nodes: Nodes, bus: Bus, channels: Channels) -> Exchange:
    """Nothing has been said yet."""
    n = len(nodes.node)
    return Exchange(
        np.zeros(1, CONTROL),
        np.zeros(n, SEAT),
        nodes,
        bus,
        np.zeros(n * MOST, MESSAGE),
        np.zeros(n * MOST, np.int64),
        np.zeros(n, FRAME),
        (np.zeros(1, FRAME), np.zeros(1, MESSAGE)),
        np.zeros(RING, EVENT),
        np.zeros(RING, FRAME),
        np.zeros(IDENTIFIERS + 1, np.int64),
        channels,
    )


def remembered(x: Exchange) -> list[NDArray[np.uint8]]:
    """The bytes of the arrays of which what is in them now has a part in what comes."""
    arrays = (x.control, x.seats, *x.nodes, *x.bus, x.counted, *x.channels)
    return [array.reshape(-1).view(np.uint8) for array in arrays]


@njit
def serve(x: Exchange, until_ns: int) -> int:
    """Send what is due and deliver what arrives, in order of time, up to and including ``until_ns``."""
    c = x.control[0]
    while True:
        if c.phase == LOOK:
            next_ns = due_ns(x)
            c.last = next_ns > until_ns
            c.now_ns = until_ns if c.last else next_ns
            c.phase = ADVANCE
        if c.phase == ADVANCE:
            if advance(x.bus, c.now_ns) == ASKS:
                return FAULT_OF_WIRE
            if not _has_room(x):
                return FULL
            _tell_controllers(x)
            c.phase = HEAR
        if c.phase == HEAR:
            acted = False
            if c.hears > 1 or (c.hears and x.bus.wire[0].received):
                c.phase = TURN
                _arrive(x)
                return RECEIVED
            for k in range(x.bus.wire[0].received):
                acted |= hear(x, x.bus.received[k], False)
            x.bus.wire[0].received = 0
            acted |= _arrive(x)
            c.phase = TURN
            if acted:
                return ACTED
        if c.phase == TURN:
            if c.last:
                c.phase = LOOK
                return DONE
            c.phase = POLL
            if c.python_ns <= c.now_ns:
                return DUE
        if x.bus.wire[0].waiting + x.offers.shape[0] > x.bus.waiting.shape[0] or not _has_room(x):
            return FULL
        silent = _poll(x)
        c.phase = LOOK
        if c.sends and (c.offered or c.python_ns <= c.now_ns):
            return OFFERED
        _send(x)
        if silent:
            return ACTED


@njit
def hear(x: Exchange, frame: Record, sealed: bool) -> bool:
    """Every node takes a frame that was received; True where somebody acts on it.

    A ``sealed`` one each has opened before: ``plain`` and the seat's objection."""
    c = x.control[0]
    t_ns, identifier = frame.t_ns, frame.id
    x.counted[IDENTIFIERS if frame.extended else identifier] += 1
    if not c.quiet:
        x.frames[c.frames] = frame
        tell(x, t_ns, FRAME_SEEN, 0, 0, c.frames)
        c.frames += 1
    acted = False
    for i in range(x.seats.shape[0]):
        seat = x.seats[i]
        if seat.deaf or off(x.bus, seat.sender, c.now_ns):
            continue
        if x.channels.channel.shape[0] and _leaves(x, i, frame, sealed):
            continue
        if sealed:
            acted |= _take(x, i, x.plain[i], seat.objection, t_ns)
        else:
            acted |= _take(x, i, frame, FINE, t_ns)
    return acted


@njit
def _take(x: Exchange, i: int, frame: Record, objection: int, t_ns: int) -> bool:
    """A node takes a plain frame; True where it acts on it."""
    m, seat = x.scratch[1][0], x.seats[i]
    answer = receive(x.nodes, i, frame, objection, t_ns, m)
    if answer < 0:
        tell(x, t_ns, REFUSED, i, frame.id, -answer)
    elif answer == TAKEN:
        tell(x, t_ns, STATE_TAKEN, i, m.kind + m.number, m.poles)
        return not seat.breaker or m.poles != 0
    return False


@njit
def _leaves(x: Exchange, i: int, frame: Record, sealed: bool) -> bool:
    """Whether a frame is for a node at the other end of a channel, and then it is in that, or is none that
    can reach it."""
    k = channel_of(x.channels, i, frame.id, frame.t_ns)
    if k == NOBODY:
        return cut_off(x.channels, i, frame.id)
    if sealed:
        enter(x.channels, k, x.plain[i], x.seats[i].objection, frame.t_ns)
    else:
        enter(x.channels, k, frame, FINE, frame.t_ns)
    return True


@njit
def _arrive(x: Exchange) -> bool:
    """What has come through the channels; True where somebody acts on it."""
    acted = False
    for k in range(x.channels.channel.shape[0]):
        i, count = x.channels.channel[k].seat, 0
        place = arrived(x.channels, k, x.control[0].now_ns)
        while place != NOBODY:
            traveller = x.channels.queue[k, place]
            if not x.seats[i].away:
                acted |= _take(x, i, x.channels.frames[k, place], traveller.objection, traveller.due_ns)
            count += 1
            place = NOBODY if count == ARRIVALS else arrived(x.channels, k, x.control[0].now_ns)
    return acted


@njit
def due_ns(x: Exchange) -> int:
    """When something happens next, if nothing else does before."""
    t_ns = min(x.control[0].python_ns, next_event_ns(x.bus))
    if x.channels.channel.shape[0]:
        t_ns = min(t_ns, arrival_ns(x.channels))
    for i in range(x.seats.shape[0]):
        if not x.seats[i].away:
            t_ns = min(t_ns, next_ns(x.nodes, i))
    return t_ns


@njit
def _poll(x: Exchange) -> bool:
    """What the nodes have to say now, into ``offers``; True where one of them misses another."""
    c = x.control[0]
    count = 0
    silent = False
    for i in range(x.seats.shape[0]):
        if x.seats[i].away:
            continue
        before, silences = count, x.nodes.node[i].silences
        count = poll(x.nodes, i, c.now_ns, x.offers, before)
        if x.nodes.node[i].silences != silences:
            tell(x, c.now_ns, SILENCE, i, 0, 0)
            silent = True
        for k in range(before, count):
            x.offered_by[k] = i
    c.offered = count
    return silent


@njit
def _send(x: Exchange) -> None:
    """Offer it to the bus."""
    c, frame = x.control[0], x.scratch[0][0]
    for k in range(c.offered):
        m, i = x.offers[k], x.offered_by[k]
        if m.kind == HEARTBEAT and x.nodes.node[i].refused:
            tell(x, c.now_ns, BEAT, i, 0, 0)
        encode(m, frame)
        submit(x.bus, frame, c.now_ns, x.seats[i].sender)
    c.offered = 0


@njit
def _tell_controllers(x: Exchange) -> None:
    w = x.bus.wire[0]
    for k in range(w.changes):
        change = x.bus.changes[k]
        tell(x, change.t_ns, CONTROLLER, change.sender, 0, change.state)
    w.changes = 0


@njit
def tell(x: Exchange, t_ns: int, what: int, node: int, identifier: int, value: int) -> None:
    """Into the ring."""
    c = x.control[0]
    event = x.events[c.events]
    event.sample = c.sample
    event.t_ns = t_ns
    event.what = what
    event.node = node
    event.identifier = identifier
    event.value = value
    c.events += 1


@njit
def _has_room(x: Exchange) -> bool:
    """For what all that is received now, and all that is sent, may tell."""
    c, w, n = x.control[0], x.bus.wire[0], x.seats.shape[0]
    events = c.events + w.changes + w.received * (n + 1) + 2 * n
    if x.channels.channel.shape[0]:
        events += x.channels.channel.shape[0] * ARRIVALS
    return events <= x.events.shape[0] and c.frames + w.received <= x.frames.shape[0]
