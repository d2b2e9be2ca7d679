"""A participant on the bus, as records and kernels: what it publishes, whom it hears, its sign of life.

It speaks messages; the port (`faultloop.io.can.port`) makes frames of them.  The compiled loop steps all
nodes of a run, a process its own.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from faultloop.config.time_sync import TimeSync
from faultloop.io.can.authentication import PLAIN, Seal
from faultloop.io.can.codes import FINE, UNKNOWN_ID
from faultloop.io.can.frames import REJECTIONS, Frame, Rejection, State, decode
from faultloop.io.can.port import (
    DIFFERENTIAL,
    HEARTBEAT,
    MEASUREMENTS,
    NOBODY,
    decode_state,
    encode,
    kind_of,
    ticks,
)
from faultloop.io.can.record import FRAME, MESSAGE, Record, Records, put, taken
from faultloop.io.can.table import OPERATIONAL, Alarm, Kind
from faultloop.io.can.time_sync import TIME_SYNC
from faultloop.jit import njit
from faultloop.nodes.clock import CYCLIC, FOREVER, Cyclic, tick
from faultloop.nodes.goose import (
    NEW,
    PUBLISHER,
    SUBSCRIBER,
    Publisher,
    Subscriber,
    accept,
    publish,
    set_state,
    supervise,
)
from faultloop.nodes.refusals import Refusals, Report
from faultloop.nodes.sets import NOTHING as NOTHING_YET
from faultloop.nodes.sets import SOURCE, WAITING, accept_set, microseconds
from faultloop.nodes.time_sync import (
    MASTER,
    SLAVE,
    clock_us,
    hear_time,
    knows_time,
    set_slave,
    tell_time,
)

MEASURED = 15
"""Values that a relay shows: phasors with their frequency (14), fault location."""
PAGES = 3
MOST = 5 + 1 + 1 + PAGES + 2
"""Messages that a node gives at once, at most."""
NOTHING, TAKEN = 0, 1
SILENT, REJECTED = int(Alarm.SILENT), int(Alarm.REJECTED)

NODE = np.dtype(
    [
        *(
            (name, "i8")
            for name in (
                "number",  # of its heartbeat
                "relay",  # of its measurements
                "first_publisher",
                "publishers",
                "first_subscriber",
                "subscribers",
                "supervised",  # how many of its subscribers, the first ones, raise the alarm
                "linked",  # how many of these, after the first, are relays that a channel links to it
                "silences",  # of these, and ends of silences: something to act upon; counts on
                "strict",  # 1: it refuses what has an identifier of nobody
                "refused",  # frames
                "refused_before",  # its last heartbeat
                "page",  # counter of its measurements
                "transfers",  # which of a relay's publishers tells of a transferred trip; 0: none
                "back_trips",  # and which one of breaker failure
                "set_ns",  # when its set of differential data is due; FOREVER: there is none
                "clock_ns",  # by how much its clock is ahead ...
                "clock_ppb",  # ... and how fast it drifts ...
                "clock_lost_ns",  # ... since it has had no time from outside; FOREVER: it has
                "first_source",
                "sources",  # whose differential data it takes
            )
        ),
        ("heartbeat", CYCLIC),
        ("measurements", CYCLIC),
        ("master", MASTER),
        ("time", SLAVE),
    ],
    align=True,
)


class Nodes(NamedTuple):
    """The state of some nodes."""

    node: Records
    """(n,) NODE"""
    publishers: Records
    """PUBLISHER, of all nodes"""
    subscribers: Records
    """SUBSCRIBER, of all nodes"""
    measured: NDArray[np.float64]
    """(n, MEASURED)"""
    own_set: Records
    """(n,) MESSAGE: differential data to be sent"""
    source: Records
    """SOURCE, of all nodes"""
    sets: Records
    """(sources, WAITING) MESSAGE: what was taken from each"""
    sent_us: NDArray[np.int64]
    """(n, 256) times of its sets, by their counter; NOTHING of those that it has not sent"""


@njit
def next_ns(nodes: Nodes, i: int) -> int:
    """When `poll` has something to send."""
    n = nodes.node[i]
    due_ns = min(n.heartbeat.next_ns, n.measurements.next_ns, n.set_ns)
    due_ns = min(due_ns, n.master.period.next_ns, n.master.follow_ns)
    for k in range(n.first_publisher, n.first_publisher + n.publishers):
        due_ns = min(due_ns, nodes.publishers[k].next_ns)
    for k in range(n.first_subscriber + 1, n.first_subscriber + 1 + n.linked):
        if not nodes.subscribers[k].alarm:
            due_ns = min(due_ns, nodes.subscribers[k].expires_ns)
    return due_ns


@njit
def poll(nodes: Nodes, i: int, t_ns: int, out: Records, count: int) -> int:
    """Puts the messages that are due into ``out`` from ``count`` on; returns how many there are then."""
    n = nodes.node[i]
    for k in range(n.first_subscriber + 1, n.first_subscriber + 1 + n.linked):
        n.silences += supervise(nodes.subscribers[k], t_ns)
    for k in range(n.first_publisher, n.first_publisher + n.publishers):
        if publish(nodes.publishers[k], t_ns, out[count]):
            count += 1
    if t_ns >= n.set_ns:
        n.set_ns = FOREVER
        _tell_heard(nodes, i, t_ns)
        out[count] = nodes.own_set[i]
        count += 1
    count = tell_time(n.master, t_ns, out, count)
    if tick(n.heartbeat, t_ns):
        _beat(nodes, i, t_ns, out[count])
        count += 1
    if tick(n.measurements, t_ns):
        for page in range(PAGES):
            _show(n, nodes.measured[i], page, out[count])
            count += 1
    return count


@njit
def _tell_heard(nodes: Nodes, i: int, t_ns: int) -> None:
    """Into the set that is sent: its counter, and how long before its time the last one of another end was
    heard; of several in turn."""
    n, m = nodes.node[i], nodes.own_set[i]
    m.counter = (m.counter + 1) & 0xFF
    nodes.sent_us[i, m.counter] = m.time
    m.page = 0
    m.st_num = 0
    m.sq_num = 0
    if n.sources:
        source = nodes.source[n.first_source + m.counter % n.sources]
        m.sq_num = source.number
        if source.heard_ns != NOTHING_YET:
            ago = microseconds(m.time - clock_us(n, source.heard_ns))
            if 0 <= ago < 1 << 16:
                m.page = source.counter
                m.st_num = max(ago, 1)


@njit
def _beat(nodes: Nodes, i: int, t_ns: int, m: Record) -> None:
    n = nodes.node[i]
    alarms = 0
    for k in range(n.first_subscriber, n.first_subscriber + n.supervised):
        supervise(nodes.subscribers[k], t_ns)
        if nodes.subscribers[k].alarm:
            alarms |= SILENT
    if n.refused > n.refused_before:
        alarms |= REJECTED
    n.refused_before = n.refused
    m.kind = HEARTBEAT
    m.number = n.number
    m.state = OPERATIONAL
    m.alarms = alarms
    m.rejected = n.refused
    m.time = ticks(t_ns)


@njit
def _show(n: Record, measured: NDArray[np.float64], page: int, m: Record) -> None:
    """One page of what a relay measures: RMS voltages, currents; frequency, its rate of change, location."""
    m.kind = MEASUREMENTS
    m.number = n.relay
    m.page = page
    m.counter = n.page
    for p in range(3):
        k = 6 * page + 2 * p
        m.values[p] = measured[12 + p] if page == 2 else abs(complex(measured[k], measured[k + 1]))
    n.page = (n.page + 1) & 0xFF


@njit
def subscriber_of(nodes: Nodes, i: int, identifier: int) -> int:
    """Place of the subscriber that hears frames of that identifier, `NOBODY` where there is none."""
    n = nodes.node[i]
    for k in range(n.first_subscriber, n.first_subscriber + n.subscribers):
        s = nodes.subscribers[k]
        if s.kind + s.number == identifier:
            return k
    return NOBODY


@njit
def receive(nodes: Nodes, i: int, frame: Record, objection: int, t_ns: int, m: Record) -> int:
    """Take a frame that arrived at ``t_ns``, plain, or ``objection``, the number of why it does not count.

    Returns TAKEN where ``m`` is a state that is new to the node, NOTHING, or minus the number of why the
    frame is refused.  A frame that is for somebody else is passed over.
    """
    n = nodes.node[i]
    if n.sources and (frame.id & ~0xF) == DIFFERENTIAL:
        return _receive_set(nodes, i, frame, objection, t_ns, m)
    if frame.id == TIME_SYNC and (n.time.follows or n.master.period.rate_hz > 0.0):
        answer = -hear_time(n, frame, t_ns, m)
        n.refused += answer < 0
        return answer
    place = subscriber_of(nodes, i, frame.id)
    if place == NOBODY:
        if n.strict and kind_of(frame.id) == NOBODY:
            n.refused += 1
            return -UNKNOWN_ID
        return NOTHING
    answer = -objection if objection != FINE else -decode_state(frame, m)
    silent = nodes.subscribers[place].alarm
    if answer == FINE:
        answer = accept(nodes.subscribers[place], m, t_ns)
    if answer < 0:
        n.refused += 1
        return answer
    if silent and 0 < place - n.first_subscriber <= n.linked:
        return TAKEN  # the channel is back, which is new by itself
    return TAKEN if answer == NEW else NOTHING


@njit
def _receive_set(nodes: Nodes, i: int, frame: Record, objection: int, t_ns: int, m: Record) -> int:
    n = nodes.node[i]
    for k in range(n.first_source, n.first_source + n.sources):
        source = nodes.source[k]
        if source.number == (frame.id & 0xF):
            answer = -objection
            if objection == FINE:
                now_us, timed = clock_us(n, t_ns), knows_time(n, t_ns)
                answer = accept_set(source, frame, t_ns, now_us, timed, nodes.sent_us[i], m)
            if answer < 0:
                n.refused += 1
                return answer
            nodes.sets[k, (source.count - 1) % WAITING] = m
            return TAKEN
    return NOTHING


@njit
def encode_one(messages: Records, k: int, frames: Records) -> None:
    """One of some messages, into the first frame: for whoever is not compiled."""
    encode(messages[k], frames[0])


@njit
def receive_first(nodes: Nodes, i: int, frames: Records, objection: int, t_ns: int, messages: Records) -> int:
    """`receive` for whoever is not compiled."""
    return receive(nodes, i, frames[0], objection, t_ns, messages[0])


class Node:
    """A node for whoever is not compiled: frames in, frames out, with its seal and its report.

    Parameters
    ----------
    number : of its heartbeat.
    publishers, subscribers : what it publishes and hears.
    supervised : how many subscribers raise the alarm of silence, the first ones.
    heartbeat_s, measurements_hz : how often it publishes while nothing happens.
    report : told of the frames that it refuses, and why.
    seal : what its state frames pass, in and out.
    start_ns : when it starts, run time [ns].
    relay : number of its measurements.
    strict : it refuses frames whose identifier is nobody's.
    sources : whose differential data it takes, ``SOURCE``.
    linked : how many of the supervised subscribers, after the first, are relays at a channel's other end.
    """

    def __init__(
        self,
        number: int,
        publishers: Sequence[Publisher],
        subscribers: Sequence[Subscriber],
        supervised: int,
        report: Report,
        *,
        heartbeat_s: float = 0.0,
        measurements_hz: float = 0.0,
        seal: Seal = PLAIN,
        start_ns: int = 0,
        relay: int = 0,
        strict: bool = True,
        linked: int = 0,
        sources: Any = None,
    ) -> None:
        self.seal = seal
        self.refusals = Refusals(report)
        node = np.zeros(1, NODE)
        for key, value in (
            ("number", number),
            ("relay", relay),
            ("publishers", len(publishers)),
            ("subscribers", len(subscribers)),
            ("supervised", supervised),
            ("strict", strict),
            ("linked", linked),
            ("set_ns", FOREVER),
            ("clock_lost_ns", FOREVER),
            ("sources", 0 if sources is None else len(sources)),
        ):
            node[key] = value
        Cyclic(1 / heartbeat_s if heartbeat_s else 0.0, start_ns, record=node["heartbeat"])
        Cyclic(measurements_hz, start_ns + 1, record=node["measurements"])
        Cyclic(0.0, record=node["master"]["period"])
        node["master"]["follow_ns"] = FOREVER
        self.nodes = Nodes(
            node,
            _gathered(PUBLISHER, [p.record for p in publishers]),
            _gathered(SUBSCRIBER, [s.record for s in subscribers]),
            np.full((1, MEASURED), np.nan),
            np.zeros(1, MESSAGE),
            np.zeros(0, SOURCE) if sources is None else sources,
            np.zeros((0 if sources is None else len(sources), WAITING), MESSAGE),
            np.full((1, 256), NOTHING_YET),
        )
        self.place = 0
        """Its number among `nodes`."""
        self._messages, self._frame = np.zeros(MOST, MESSAGE), np.zeros(1, FRAME)

    def set_clock(self, offset_ns: int, ppb: int, lost_ns: int) -> None:
        """Its clock is so much ahead, and drifts so fast once it has lost the time from outside."""
        node = self.nodes.node[self.place]
        node["clock_ns"], node["clock_ppb"], node["clock_lost_ns"] = offset_ns, ppb, lost_ns

    def follow_time(self, table: TimeSync, seed: int, deaf_ns: int = FOREVER) -> None:
        """Its clock is set by TIME_SYNC, which it hears until `deaf_ns`."""
        set_slave(self.nodes.node[self.place : self.place + 1]["time"], table, seed, deaf_ns)

    @property
    def rejected(self) -> Counter[Rejection]:
        """Frames refused, by cause."""
        return self.refusals.causes

    @property
    def next_ns(self) -> int:
        """When `poll` has something to send."""
        return next_ns(self.nodes, self.place)

    @property
    def measured(self) -> NDArray[np.float64]:
        """(15,) phasor row and fault location of a relay, kept up to date by whoever runs it."""
        return self.nodes.measured[self.place]

    def publisher(self, k: int) -> Any:
        """The record of its k-th publisher."""
        return self.nodes.publishers[int(self.nodes.node["first_publisher"][self.place]) + k]

    def subscribers(self) -> Records:
        """The records of whom it hears."""
        n = self.nodes.node[self.place]
        return self.nodes.subscribers[n["first_subscriber"] : n["first_subscriber"] + n["subscribers"]]

    def hears(self, identifier: int) -> bool:
        """Whether frames of that identifier are for it."""
        if (identifier & ~0xF) == DIFFERENTIAL:
            n = self.nodes.node[self.place]
            own = self.nodes.source[n["first_source"] : n["first_source"] + n["sources"]]
            return bool(np.any(own["number"] == (identifier & 0xF)))
        return subscriber_of(self.nodes, self.place, identifier) != NOBODY

    def poll(self, t_ns: int) -> list[Frame]:
        """The frames that are due."""
        count = poll(self.nodes, self.place, t_ns, self._messages, 0)
        return [self.wired(t_ns, self._messages, k) for k in range(count)]

    def wired(self, t_ns: int, messages: Records, k: int) -> Frame:
        """The frame of one of its messages as it leaves."""
        kind = messages["kind"][k]
        if kind == HEARTBEAT:
            self.refusals.beat(t_ns)
        encode_one(messages, k, self._frame)
        frame = Frame(*taken(self._frame, 0))
        return frame if kind in (HEARTBEAT, MEASUREMENTS, TIME_SYNC) else self.seal.close(t_ns, frame)

    def take(self, t_ns: int, frame: Frame) -> Any:
        """Take a frame; the ``MESSAGE`` in it where it is a state that is new, else None."""
        objection, plain = self.opened(t_ns, frame)
        put(self._frame, 0, plain)
        answer = receive_first(self.nodes, self.place, self._frame, objection, t_ns, self._messages)
        if answer < 0:
            self.refusals.add(t_ns, frame.id, REJECTIONS[-answer - 1])
        return self._messages[0] if answer == TAKEN else None

    def opened(self, t_ns: int, frame: Frame) -> tuple[int, Frame]:
        """What its seal says to a frame that it hears: the number of an objection, and the plain frame."""
        if self.seal is PLAIN or not self.hears(frame.id):
            return FINE, frame
        plain = self.seal.open(t_ns, frame)
        return (plain.code, frame) if isinstance(plain, Rejection) else (FINE, plain)


def rehearse() -> None:
    """Load every kernel that a process's node needs, before the run begins: numba compiles or loads one when
    it is first called, and the first trip would have to wait for that."""
    node = Node(
        0,
        [Publisher(kind, 0) for kind in (Kind.TRIP, Kind.BREAKER_STATUS)],
        [Subscriber(kind=Kind.BREAKER_STATUS, number=0)],
        1,
        lambda *_: None,
        heartbeat_s=1.0,
        measurements_hz=10.0,
    )
    set_state(node.publisher(0), 7, 0)
    for frame in (*node.poll(0), *node.poll(node.next_ns)):
        node.take(0, frame)
    follower, t_ns = Subscriber(), 0
    for publisher in (Publisher(Kind.TRIP, 0), Publisher(Kind.BREAKER_STATUS, 0, 7)):
        publisher.set(3, t_ns)
        frame = publisher.poll(t_ns)
        message = None if frame is None else decode(frame)
        if isinstance(message, State):
            message.encode()
            follower.receive(message, t_ns)
    follower.supervise(t_ns)


def _gathered(dtype: np.dtype, parts: Sequence[Records]) -> Records:
    """`np.concatenate`, which takes 60 us to find out that the types of records are the same."""
    gathered = np.zeros(sum(len(part) for part in parts), dtype)
    raw = b"".join(part.tobytes() for part in parts)
    gathered.view(np.uint8)[:] = np.frombuffer(raw, np.uint8)
    return gathered


def joined(nodes: Sequence[Node]) -> Nodes:
    """The states of some nodes in one, which all of them use from now on."""
    parts = [node.nodes for node in nodes]
    whole = Nodes(
        _gathered(NODE, [part.node for part in parts]),
        _gathered(PUBLISHER, [part.publishers for part in parts]),
        _gathered(SUBSCRIBER, [part.subscribers for part in parts]),
        np.concatenate([np.zeros((0, MEASURED)), *(part.measured for part in parts)]),
        _gathered(MESSAGE, [part.own_set for part in parts]),
        _gathered(SOURCE, [part.source for part in parts]),
        np.zeros((sum(len(part.source) for part in parts), WAITING), MESSAGE),
        np.full((len(parts), 256), NOTHING_YET),
    )
    publishers = subscribers = sources = 0
    for place, node in enumerate(nodes):
        whole.node["first_publisher"][place], whole.node["first_subscriber"][place] = publishers, subscribers
        publishers += len(node.nodes.publishers)
        subscribers += len(node.nodes.subscribers)
        whole.node["first_source"][place] = sources
        sources += len(node.nodes.source)
        node.nodes, node.place = whole, place
    return whole


def replaced(whole: Nodes, place: int, node: Node) -> None:
    """Put a node that starts anew in the place of the one that it follows."""
    old, new = whole.node[place : place + 1], node.nodes
    first, other = int(old["first_publisher"][0]), int(old["first_subscriber"][0])
    whole.publishers[first : first + len(new.publishers)] = new.publishers
    whole.subscribers[other : other + len(new.subscribers)] = new.subscribers
    whole.measured[place] = new.measured[0]
    third = int(old["first_source"][0])
    whole.own_set[place], whole.sent_us[place] = new.own_set[0], new.sent_us[0]
    whole.source[third : third + len(new.source)] = new.source
    old[:] = new.node
    old["first_publisher"], old["first_subscriber"], old["first_source"] = first, other, third
    node.nodes, node.place = whole, place
