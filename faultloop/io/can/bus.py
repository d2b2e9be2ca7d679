"""A model of a CAN bus: when does each frame arrive?  Discrete events, integer nanoseconds.

Rules (ISO 11898-1:2015): a bus that is idle takes the first frame at once; when it gets idle, the waiting
frame with the lowest arbitration field goes; no frame is pre-empted; three bits of intermission follow each
frame.  Receivers take a frame when the last but one bit of its end of frame has passed (from there on it is
valid for them), one bit before it is valid for its sender.  Each sender offers all of its waiting frames (it
has as many mailboxes as it needs); frames with one identifier go in the order of submission.  Errors on the
wire, where there are any, and what follows from them are in `bits` and `confinement`.  No propagation delay.
"""

from __future__ import annotations

import copy
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

from faultloop.errors import InputError
from faultloop.io.can.bits import FLAG, receivers_late, wire_bits
from faultloop.io.can.confinement import DELIMITER, Controller, ErrorSource, StateChange
from faultloop.io.can.frames import Frame
from faultloop.io.can.length import INTERMISSION, wire_length

SECOND_NS = 1_000_000_000
RECESSIVE_TAIL = 1 + 7  # acknowledge delimiter, end of frame
Counting = Callable[[Controller], None]


class Delivery(NamedTuple):
    """A frame that every node but its sender has received at `t_ns`."""

    t_ns: int
    frame: Frame
    sender: object


class _Waiting(NamedTuple):
    arbitration: int
    order: int
    t_ns: int
    frame: Frame
    sender: object
    duration_ns: int


@dataclass(slots=True)
class BusLoad:
    """What went over the bus."""

    frames: Counter[int] = field(default_factory=Counter)  # sent, by identifier
    longest_wait_ns: dict[int, int] = field(default_factory=dict)  # from submission to start, by identifier
    busy_ns: int = 0  # frames and intermissions, and what errors cost
    errors: int = 0  # error frames

    def over(self, duration_ns: int) -> float:
        """Part of `duration_ns` in which the bus was not idle, 0 to 1."""
        return self.busy_ns / duration_ns if duration_ns else 0.0


def arbitration_field(frame: Frame) -> int:
    """The bits that decide the arbitration, as a number: the lowest wins.

    A base frame beats an extended one with the same first 11 bits (its RTR/RRS and IDE are dominant).
    """
    if frame.extended:
        return (frame.id >> 18) << 20 | 0b11 << 18 | (frame.id & 0x3FFFF)
    return frame.id << 20


class SimulatedBus:
    """The bus of one run.

    Parameters
    ----------
    bitrate : nominal bit rate [bit/s].
    data_bitrate : bit rate of the data phase of FD frames with bit rate switch [bit/s].
    errors : says which transmissions are hit by an error on the wire; None for none.
    """

    def __init__(
        self, bitrate: int = 500_000, data_bitrate: int = 2_000_000, errors: ErrorSource | None = None
    ) -> None:
        for key, value in (("bitrate", bitrate), ("data_bitrate", data_bitrate)):
            if value <= 0:
                raise InputError(f"{value} bit/s is not a bit rate: it must be positive", key=key)
        self.bitrate = bitrate
        self.data_bitrate = data_bitrate
        self.errors = errors
        self.load = BusLoad()
        self.controllers: dict[object, Controller] = {}
        """Of all that have sent, by sender, where there may be errors."""
        self.changes: list[StateChange] = []
        """Of the controllers' states, in the order they were found; whoever reads them takes them out."""
        self.now_ns = 0
        self._idle_ns = 0  # from when on the next frame may start
        self._order = 0
        self._waiting: list[_Waiting] = []
        self._sending: tuple[Delivery, ...] = ()  # the frame on the wire, not yet received

    def submit(self, t_ns: int, frame: Frame, sender: object = None) -> None:
        """Offer a frame at `t_ns`, not before the time up to which the bus was advanced."""
        if t_ns < self.now_ns:
            raise ValueError(f"submitted at {t_ns} ns, but the bus is at {self.now_ns} ns")
        duration_ns = self.duration_ns(frame)  # refuses what cannot be sent
        if self.errors is not None or self.controllers:
            self.controllers.setdefault(sender, Controller(SECOND_NS // self.bitrate))
        self._waiting.append(
            _Waiting(arbitration_field(frame), self._order, t_ns, frame, sender, duration_ns)
        )
        self._order += 1

    def duration_ns(self, frame: Frame) -> int:
        """Time on the wire, from the start of frame to the end of the end of frame [ns]."""
        return self._bits_ns(*wire_length(frame))

    def next_event_ns(self) -> int | None:
        """When the next frame is received, if none is submitted until then; None if none is under way."""
        if self._sending:
            return self._sending[0].t_ns
        chosen = self._choose()
        return None if chosen is None else self._received_ns(*chosen)

    def advance(self, until_ns: int) -> list[Delivery]:
        """Let time pass; returns the frames received up to and including `until_ns`, in order.

        A frame that would start at `until_ns` itself does not start yet: one of a higher priority may still
        be submitted for that instant.
        """
        received: list[Delivery] = []
        while True:
            if self._sending:
                if self._sending[0].t_ns > until_ns:
                    break
                received += self._sending
                self._sending = ()
            chosen = self._choose()
            if chosen is None or chosen[1] >= until_ns:
                break
            self._start(*chosen)
        self.now_ns = max(self.now_ns, until_ns)
        return received

    def pending(self) -> list[Frame]:
        """The frames that are waiting or on the wire."""
        return [frame for _, frame, _ in self._sending] + [waiting.frame for waiting in self._waiting]

    @property
    def idle_from_ns(self) -> int:
        """When the next frame may begin: the end of the newest frame's intermission."""
        return self._idle_ns

    def waiting_from(self, sender: object) -> int:
        """How many frames of a sender wait for the bus, the one on the wire not counted."""
        return sum(waiting.sender == sender for waiting in self._waiting)

    def bus_off(self, t_ns: int) -> frozenset[object]:
        """Who is bus-off at `t_ns`, the time up to which the bus was advanced: it hears nothing."""
        if not self.controllers:
            return frozenset()
        return frozenset(sender for sender, one in self.controllers.items() if one.off(t_ns))

    def save(self) -> tuple:
        """Everything that changes, for `restore`."""
        errors, controllers = copy.deepcopy(self.errors), self._copied_controllers()
        wire = (self.now_ns, self._idle_ns, self._order, tuple(self._waiting), self._sending)
        return wire, self._copied_load(), errors, controllers, tuple(self.changes)

    def restore(self, state: tuple) -> None:
        """Go back to a saved state; it may be restored again later."""
        wire, self.load, errors, self.controllers, changes = state
        self.now_ns, self._idle_ns, self._order, waiting, self._sending = wire
        self._waiting, self.changes = list(waiting), list(changes)
        self.load, self.controllers = self._copied_load(), self._copied_controllers()
        self.errors = copy.deepcopy(errors)

    def _copied_load(self) -> BusLoad:
        load = self.load
        return BusLoad(Counter(load.frames), dict(load.longest_wait_ns), load.busy_ns, load.errors)

    def _copied_controllers(self) -> dict[object, Controller]:
        return {sender: controller.copied() for sender, controller in self.controllers.items()}

    def _choose(self) -> tuple[_Waiting, int] | None:
        """The frame that starts next and when, from what is known now."""
        if not self._waiting:
            return None
        if self.controllers:
            return self._choose_of_those_ready()
        start_ns = max(self._idle_ns, min(waiting.t_ns for waiting in self._waiting))
        return min(waiting for waiting in self._waiting if waiting.t_ns <= start_ns), start_ns

    def _choose_of_those_ready(self) -> tuple[_Waiting, int]:
        """The same where a controller may have to wait longer than for the bus."""
        ready = [(max(waiting.t_ns, self._ready_ns(waiting.sender)), waiting) for waiting in self._waiting]
        start_ns = max(self._idle_ns, min(from_ns for from_ns, _ in ready))
        return min(waiting for from_ns, waiting in ready if from_ns <= start_ns), start_ns

    def _ready_ns(self, sender: object) -> int:
        controller = self.controllers.get(sender)
        return 0 if controller is None else controller.ready_ns

    def _received_ns(self, chosen: _Waiting, start_ns: int) -> int:
        return start_ns + chosen.duration_ns - SECOND_NS // self.bitrate

    def _start(self, chosen: _Waiting, start_ns: int) -> None:
        if self.controllers:
            self._end_recessive_run(start_ns)
        if self.errors is not None and self._hit(chosen, start_ns):
            return
        self._waiting.remove(chosen)
        self._sending = (Delivery(self._received_ns(chosen, start_ns), chosen.frame, chosen.sender),)
        end_ns = start_ns + chosen.duration_ns
        self._idle_ns = end_ns + INTERMISSION * SECOND_NS // self.bitrate
        load = self.load
        load.busy_ns += self._idle_ns - start_ns
        load.frames[chosen.frame.id] += 1
        wait_ns = start_ns - chosen.t_ns
        load.longest_wait_ns[chosen.frame.id] = max(wait_ns, load.longest_wait_ns.get(chosen.frame.id, 0))
        if self.controllers:
            self._begin_recessive_run(end_ns - RECESSIVE_TAIL * SECOND_NS // self.bitrate)
            self._confine(end_ns, chosen.sender, lambda c: c.succeeded(self._idle_ns), Controller.heard_frame)

    # -- errors on the wire ---------------------------------------------------------------------------------

    def _hit(self, chosen: _Waiting, start_ns: int) -> bool:
        """If an error hits the frame that begins: it is cut, and stays to be sent again."""
        assert self.errors is not None
        frame, sender = chosen.frame, chosen.sender
        place = self.errors.hit(start_ns, frame, sender, sum(wire_length(frame)))
        if place is None:
            return False
        passive = self.controllers[sender].state == "error-passive"
        seen_ns, delimiter_ns = self._flags_ns(start_ns, frame, place, passive)
        received_ns = self._received_ns(chosen, start_ns)
        if received_ns < seen_ns:  # in the very last bit: receivers have taken it, and will take it again
            self._sending = (Delivery(received_ns, frame, sender),)
        self._idle_ns = delimiter_ns + (DELIMITER + INTERMISSION) * SECOND_NS // self.bitrate
        self.load.errors += 1
        self.load.busy_ns += self._idle_ns - start_ns
        self._begin_recessive_run(delimiter_ns)
        self._confine(
            seen_ns, sender, lambda c: c.failed(delimiter_ns, self._idle_ns), Controller.heard_error
        )
        return True

    def _flags_ns(self, start_ns: int, frame: Frame, place: int, passive: bool) -> tuple[int, int]:
        """When the sender sees the disturbed bit, and when the last error flag has ended.

        From the bit after that one on everything is at the nominal bit rate, but receivers that are still in
        the data phase look that often whether a rule is broken.
        """
        wire = wire_bits(frame)
        fast = sum(place >= other for other in wire.data_phase)
        seen_ns = start_ns + self._bits_ns(place + 1 - fast, fast)
        late = receivers_late(wire, place, passive=passive)
        late_ns = self._bits_ns(0, late) if place in wire.data_phase else self._bits_ns(late, 0)
        return seen_ns, seen_ns + late_ns + self._bits_ns(FLAG, 0)

    def _bits_ns(self, nominal: int, data: int) -> int:
        return nominal * SECOND_NS // self.bitrate + data * SECOND_NS // self.data_bitrate

    def _confine(self, t_ns: int, sender: object, own: Counting, others: Counting) -> None:
        """Count what has happened at the sender and at the others; note whose state it changed."""
        for node, controller in self.controllers.items():
            before = controller.state
            (own if node == sender else others)(controller)
            self._note(t_ns, node, before)

    def _end_recessive_run(self, t_ns: int) -> None:
        """A frame begins: whoever has seen enough by then is back, the others go on counting after it."""
        for sender, controller in self.controllers.items():
            if controller.state == "bus-off" and controller.ready_ns <= t_ns:
                controller.recovered()
                self._note(controller.ready_ns, sender, "bus-off")
            controller.other_begins(t_ns)

    def _begin_recessive_run(self, t_ns: int) -> None:
        for controller in self.controllers.values():
            controller.run_begins(t_ns)

    def _note(self, t_ns: int, sender: object, before: str) -> None:
        state = self.controllers[sender].state
        if state != before:
            self.changes.append(StateChange(t_ns, sender, state))
