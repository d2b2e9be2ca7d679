"""The bus model's kernels: which frame begins when, and when it has arrived; see `bus` for the rules."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from faultloop.io.can.confinement import (
    CONTROLLER,
    DELIMITER,
    IN_SERVICE,
    OFF,
    failed,
    heard_error,
    heard_frame,
    is_off,
    other_begins,
    recovered,
    run_begins,
    state_of,
    succeeded,
)
from faultloop.io.can.length import INTERMISSION, lengths
from faultloop.io.can.record import FRAME, Bytes, Record, Records
from faultloop.jit import njit

SECOND_NS = 1_000_000_000
RECESSIVE_TAIL = 1 + 7  # acknowledge delimiter, end of frame
IDENTIFIERS = 1 << 11
NEVER = 2**63 - 1
NONE = -1

IDLE, ASKS, FULL = range(3)
"""What `advance` ends with: nothing more happens until then; is the transmission hit? (`transmit` or `cut`
answers); there is no room for what was received."""

WIRE = np.dtype(
    [
        (name, "i8")
        for name in (
            "bitrate",  # [bit/s]
            "data_bitrate",
            "now_ns",
            "idle_ns",  # from when on the next frame may start
            "order",  # of the next submission
            "waiting",  # how many frames wait
            "sending",  # 1: one is on the wire, and not yet received
            "received",  # how many frames were received, and are not yet taken
            "changes",  # how many changes of controllers' states are not yet taken
            "confined",  # how many controllers are counted for
            "asks",  # 1: whether a transmission is hit is asked
            "chosen",  # whose place among the waiting is this; NONE
            "start_ns",  # and when it begins
            "busy_ns",
            "errors",
        )
    ]
)
CHANGE = np.dtype([("t_ns", "i8"), ("sender", "i8"), ("state", "i8")])
LOAD = np.dtype([("frames", "i8"), ("longest_wait_ns", "i8")])


class Bus(NamedTuple):
    """The state of one bus."""

    wire: Records
    """(1,) WIRE"""
    waiting: Records
    """(n,) FRAME, in any order"""
    sending: Records
    """(1,) FRAME"""
    received: Records
    """(n,) FRAME"""
    controllers: Records
    """(n,) CONTROLLER, in the order of the senders' first frames"""
    changes: Records
    """(n,) CHANGE"""
    load: Records
    """(2049,) LOAD, by identifier; the last one of extended frames"""


def new_bus(bitrate: int, data_bitrate: int, senders: int = 64) -> Bus:
    """A bus that is idle, with room for controllers of that many senders."""
    wire = np.zeros(1, WIRE)
    wire["bitrate"], wire["data_bitrate"], wire["chosen"] = bitrate, data_bitrate, NONE
    frames = (np.zeros(64, FRAME), np.zeros(1, FRAME), np.zeros(16, FRAME))
    rest = (np.zeros(senders, CONTROLLER), np.zeros(4 * senders, CHANGE), np.zeros(IDENTIFIERS + 1, LOAD))
    return Bus(wire, *frames, *rest)


@njit
def bits_ns(bus: Bus, nominal: int, data: int) -> int:
    """Time of some bits at either rate [ns]."""
    w = bus.wire[0]
    return nominal * SECOND_NS // w.bitrate + data * SECOND_NS // w.data_bitrate


@njit
def submit(bus: Bus, frame: Record, t_ns: int, sender: int) -> None:
    """Offer a frame, for which there must be room."""
    w = bus.wire[0]
    if w.asks or w.confined:
        _confine_sender(bus, sender)
    nominal, data = lengths(frame)
    bus.waiting[w.waiting] = frame
    own = bus.waiting[w.waiting]
    own.t_ns = t_ns
    own.sender = sender
    own.order = w.order
    own.duration_ns = bits_ns(bus, nominal, data)
    own.arbitration = arbitration_field(frame)
    w.waiting += 1
    w.order += 1


@njit
def submit_bytes(bus: Bus, frame: Bytes, t_ns: int, sender: int) -> None:
    """`submit` for whoever is not compiled."""
    submit(bus, frame.view(FRAME)[0], t_ns, sender)


@njit
def arbitration_field(frame: Record) -> int:
    """The bits that decide the arbitration, as a number: the lowest wins.

    A base frame beats an extended one with the same first 11 bits (its RTR/RRS and IDE are dominant).
    """
    if frame.extended:
        return (frame.id >> 18) << 20 | 0b11 << 18 | (frame.id & 0x3FFFF)
    return frame.id << 20


@njit
def next_event_ns(bus: Bus) -> int:
    """When the next frame is received, if none is submitted until then; `NEVER` if none is under way."""
    w = bus.wire[0]
    if w.sending:
        return bus.sending[0].t_ns
    if not w.waiting:
        return NEVER
    chosen, start_ns = _choose(bus)
    return _received_ns(bus, chosen, start_ns)


@njit
def advance(bus: Bus, until_ns: int) -> int:
    """Let time pass; frames received up to and including ``until_ns`` go, in order, to ``received``.

    A frame that would start at ``until_ns`` itself does not start yet: one of a higher priority may still be
    submitted for that instant.  Ends with IDLE, ASKS or FULL, and goes on when it is called again.
    """
    w = bus.wire[0]
    while True:
        if w.sending:
            if bus.sending[0].t_ns > until_ns:
                break
            if w.received >= bus.received.shape[0] or w.changes + w.confined >= bus.changes.shape[0]:
                return FULL
            bus.received[w.received] = bus.sending[0]
            w.received += 1
            w.sending = 0
        if not w.waiting:
            break
        chosen, start_ns = _choose(bus)
        if start_ns >= until_ns:
            break
        if w.changes + 3 * w.confined >= bus.changes.shape[0]:
            return FULL
        if w.confined:
            _end_recessive_run(bus, start_ns)
        w.chosen = chosen
        w.start_ns = start_ns
        if w.asks:
            return ASKS
        transmit(bus)
    w.now_ns = max(w.now_ns, until_ns)
    return IDLE


@njit
def transmit(bus: Bus) -> None:
    """The chosen frame goes through."""
    w = bus.wire[0]
    start_ns, chosen = w.start_ns, w.chosen
    _put_on_wire(bus)
    frame = bus.waiting[chosen]
    end_ns = start_ns + frame.duration_ns
    w.idle_ns = end_ns + bits_ns(bus, INTERMISSION, 0)
    w.busy_ns += w.idle_ns - start_ns
    load = bus.load[IDENTIFIERS if frame.extended else frame.id]
    load.frames += 1
    load.longest_wait_ns = max(load.longest_wait_ns, start_ns - frame.t_ns)
    sender = frame.sender
    w.waiting -= 1
    bus.waiting[chosen] = bus.waiting[w.waiting]
    w.chosen = NONE
    if w.confined:
        _begin_recessive_run(bus, end_ns - bits_ns(bus, RECESSIVE_TAIL, 0))
        for i in range(w.confined):
            c = bus.controllers[i]
            before = state_of(c)
            if c.sender == sender:
                succeeded(c, w.idle_ns)
            else:
                heard_frame(c)
            _note(bus, end_ns, c, before)


@njit
def cut(bus: Bus, seen_ns: int, delimiter_ns: int) -> None:
    """The chosen frame is hit: its sender sees it at ``seen_ns``, the flags have ended at ``delimiter_ns``;
    it stays, to be sent again."""
    w = bus.wire[0]
    start_ns, sender = w.start_ns, bus.waiting[w.chosen].sender
    if _received_ns(bus, w.chosen, start_ns) < seen_ns:
        _put_on_wire(bus)  # hit in the very last bit: receivers have taken it, and will take it again
    w.chosen = NONE
    w.idle_ns = delimiter_ns + bits_ns(bus, DELIMITER + INTERMISSION, 0)
    w.errors += 1
    w.busy_ns += w.idle_ns - start_ns
    _begin_recessive_run(bus, delimiter_ns)
    for i in range(w.confined):
        c = bus.controllers[i]
        before = state_of(c)
        if c.sender == sender:
            failed(c, delimiter_ns, w.idle_ns)
        else:
            heard_error(c)
        _note(bus, seen_ns, c, before)


@njit
def off(bus: Bus, sender: int, t_ns: int) -> bool:
    """Is a sender bus-off at ``t_ns``, the time up to which the bus was advanced?  It hears nothing then."""
    place = _controller_of(bus, sender)
    return place != NONE and is_off(bus.controllers[place], t_ns)


@njit
def _put_on_wire(bus: Bus) -> None:
    w = bus.wire[0]
    bus.sending[0] = bus.waiting[w.chosen]
    bus.sending[0].t_ns = _received_ns(bus, w.chosen, w.start_ns)
    w.sending = 1


@njit
def _received_ns(bus: Bus, chosen: int, start_ns: int) -> int:
    return start_ns + bus.waiting[chosen].duration_ns - bits_ns(bus, 1, 0)


@njit
def _choose(bus: Bus) -> tuple[int, int]:
    """The frame that starts next and when, from what is known now; there must be one that waits."""
    w = bus.wire[0]
    first_ns = NEVER
    for i in range(w.waiting):
        first_ns = min(first_ns, _from_ns(bus, i))
    start_ns = max(w.idle_ns, first_ns)
    chosen = NONE
    for i in range(w.waiting):
        if _from_ns(bus, i) <= start_ns and (chosen == NONE or _goes_before(bus, i, chosen)):
            chosen = i
    return chosen, start_ns


@njit
def _from_ns(bus: Bus, i: int) -> int:
    """When a frame may start: its controller may have to wait longer than for the bus."""
    frame = bus.waiting[i]
    if not bus.wire[0].confined:
        return frame.t_ns
    place = _controller_of(bus, frame.sender)
    return frame.t_ns if place == NONE else max(frame.t_ns, bus.controllers[place].ready_ns)


@njit
def _goes_before(bus: Bus, i: int, j: int) -> bool:
    a, b = bus.waiting[i], bus.waiting[j]
    return a.arbitration < b.arbitration or (a.arbitration == b.arbitration and a.order < b.order)


@njit
def _controller_of(bus: Bus, sender: int) -> int:
    for i in range(bus.wire[0].confined):
        if bus.controllers[i].sender == sender:
            return i
    return NONE


@njit
def _confine_sender(bus: Bus, sender: int) -> None:
    """From its first frame on, where there may be errors."""
    w = bus.wire[0]
    if _controller_of(bus, sender) == NONE:
        c = bus.controllers[w.confined]
        c.sender = sender
        c.bit_ns = SECOND_NS // w.bitrate
        c.tec = 0
        c.rec = 0
        c.ready_ns = 0
        c.sequences = IN_SERVICE
        w.confined += 1


@njit
def _end_recessive_run(bus: Bus, t_ns: int) -> None:
    """A frame begins: whoever has seen enough by then is back, the others go on counting after it."""
    for i in range(bus.wire[0].confined):
        c = bus.controllers[i]
        if state_of(c) == OFF and c.ready_ns <= t_ns:
            recovered(c)
            _note(bus, c.ready_ns, c, OFF)
        other_begins(c, t_ns)


@njit
def _begin_recessive_run(bus: Bus, t_ns: int) -> None:
    for i in range(bus.wire[0].confined):
        run_begins(bus.controllers[i], t_ns)


@njit
def _note(bus: Bus, t_ns: int, c: Record, before: int) -> None:
    w, state = bus.wire[0], state_of(c)
    if state != before:
        bus.changes[w.changes].t_ns = t_ns
        bus.changes[w.changes].sender = c.sender
        bus.changes[w.changes].state = state
        w.changes += 1
