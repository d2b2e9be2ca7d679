"""A model of a CAN bus: when does each frame arrive?  Discrete events, integer nanoseconds.

Rules (ISO 11898-1:2015): a bus that is idle takes the first frame at once; when it gets idle, the waiting
frame with the lowest arbitration field goes; no frame is pre-empted; three bits of intermission follow each
frame.  Receivers take a frame when the last but one bit of its end of frame has passed (from there on it is
valid for them), one bit before it is valid for its sender.  Each sender offers all of its waiting frames (it
has as many mailboxes as it needs); frames with one identifier go in the order of submission.  Errors on the
wire, where there are any, and what follows from them are in `bits` and `confinement`.  No propagation delay.

The rules themselves are kernels, in `arbitration`; `SimulatedBus` is the bus for whoever is not compiled.
"""

from __future__ import annotations

import copy
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from faultloop.errors import InputError
from faultloop.io.can import arbitration
from faultloop.io.can.arbitration import ASKS, FULL, NEVER, SECOND_NS, WIRE, Bus
from faultloop.io.can.bits import FLAG, receivers_late, wire_bits
from faultloop.io.can.confinement import STATES, Controller, ErrorSource, StateChange
from faultloop.io.can.frames import Frame
from faultloop.io.can.length import check, wire_length
from faultloop.io.can.record import Bytes, delivered, new_frame, taken
from faultloop.jit import compiled


class _Kernels(NamedTuple):
    """Of every bus; they are called without finding out types that are always the same, which takes four
    times as long as the call."""

    submit: Callable[[Bus, Bytes, int, int], None]
    advance: Callable[[Bus, int], int]
    next_event_ns: Callable[[Bus], int]


_known: list[_Kernels] = []


def _kernels(state: Bus) -> _Kernels:
    if not _known:
        submit = compiled(arbitration.submit_bytes, state, new_frame(), 0, 0)
        advance, next_event_ns = (
            compiled(arbitration.advance, state, 0),
            compiled(arbitration.next_event_ns, state),
        )
        _known.append(_Kernels(submit, advance, next_event_ns))
    return _known[0]


WORD = {name: place for place, name in enumerate(WIRE.names or ())}
__all__ = ["SECOND_NS", "BusLoad", "Delivery", "SimulatedBus"]


class Delivery(NamedTuple):
    """A frame that every node but its sender has received at `t_ns`."""

    t_ns: int
    frame: Frame
    sender: object


@dataclass(slots=True)
class BusLoad:
    """What went over the bus."""

    frames: Counter[int] = field(default_factory=Counter)
    """Sent, by identifier; extended frames together, by 2048."""
    longest_wait_ns: dict[int, int] = field(default_factory=dict)
    """From submission to start, likewise."""
    busy_ns: int = 0
    """Frames and intermissions, and what errors cost."""
    errors: int = 0
    """Error frames."""

    def over(self, duration_ns: int) -> float:
        """Part of `duration_ns` in which the bus was not idle, 0 to 1."""
        return self.busy_ns / duration_ns if duration_ns else 0.0


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
        self.state = arbitration.new_bus(bitrate, data_bitrate)
        self.changes: list[StateChange] = []
        """Of the controllers' states, in the order they were found; whoever reads them takes them out."""
        self._senders: list[object] = []
        self._numbers: dict[object, int] = {}
        self.errors = errors

    @property
    def errors(self) -> ErrorSource | None:
        """Says which transmissions are hit by an error on the wire; None for none."""
        return self._errors

    @errors.setter
    def errors(self, errors: ErrorSource | None) -> None:
        self._errors = errors
        self._words[WORD["asks"]] = errors is not None

    @property
    def state(self) -> Bus:
        """For whoever runs the kernels on it."""
        return self._state

    @state.setter
    def state(self, state: Bus) -> None:
        self._state = state
        # A field of a record takes 0.7 us to read, a number of a memoryview 0.05.
        self._words = memoryview(state.wire).cast("B").cast("q")

    @property
    def now_ns(self) -> int:
        """The time up to which it was advanced."""
        return self._words[WORD["now_ns"]]

    def number_of(self, sender: object) -> int:
        """What the kernels know a sender by."""
        number = self._numbers.get(sender)
        if number is None:
            number = self._numbers[sender] = len(self._senders)
            self._senders.append(sender)
        return number

    def submit(self, t_ns: int, frame: Frame, sender: object = None) -> None:
        """Offer a frame at `t_ns`, not before the time up to which the bus was advanced."""
        if t_ns < self.now_ns:
            raise ValueError(f"submitted at {t_ns} ns, but the bus is at {self.now_ns} ns")
        check(frame)  # refuses what cannot be sent
        self.reserve(1)
        _kernels(self.state).submit(self.state, new_frame(frame), t_ns, self.number_of(sender))

    def reserve(self, count: int) -> None:
        """Have room for `count` more frames that wait, and for the controllers of all senders."""
        state, senders = self.state, len(self._senders) + count
        if self._words[WORD["waiting"]] + count > len(state.waiting):
            self.state = state = state._replace(waiting=_longer(state.waiting, count))
        if senders > len(state.controllers):
            changes = np.zeros(8 * senders, state.changes.dtype)
            changes[: len(state.changes)] = state.changes
            self.state = state._replace(controllers=_longer(state.controllers, senders), changes=changes)

    def duration_ns(self, frame: Frame) -> int:
        """Time on the wire, from the start of frame to the end of the end of frame [ns]."""
        return arbitration.bits_ns(self.state, *wire_length(frame))

    def next_event_ns(self) -> int | None:
        """When the next frame is received, if none is submitted until then; None if none is under way."""
        t_ns = _kernels(self.state).next_event_ns(self.state)
        return None if t_ns == NEVER else t_ns

    def advance(self, until_ns: int) -> list[Delivery]:
        """Let time pass; returns the frames received up to and including `until_ns`, in order.

        A frame that would start at `until_ns` itself does not start yet: one of a higher priority may still
        be submitted for that instant.
        """
        received: list[Delivery] = []
        advance = _kernels(self.state).advance
        while True:
            code = advance(self.state, until_ns)
            if code == ASKS:
                self.answer()
                continue
            received += self.received()
            if code != FULL:
                return received

    def answer(self) -> None:
        """The kernel asks whether the transmission that begins is hit: go on with it, or cut it."""
        assert self.errors is not None
        words, state = self._words, self.state
        chosen, start_ns = words[WORD["chosen"]], words[WORD["start_ns"]]
        frame = Frame(*taken(state.waiting, chosen))
        sender = self._senders[int(state.waiting["sender"][chosen])]
        place = self.errors.hit(start_ns, frame, sender, sum(wire_length(frame)))
        if place is None:
            arbitration.transmit(state)
        else:
            passive = self.controllers[sender].state == "error-passive"
            arbitration.cut(state, *self._flags_ns(start_ns, frame, place, passive))

    def _flags_ns(self, start_ns: int, frame: Frame, place: int, passive: bool) -> tuple[int, int]:
        """When the sender sees the disturbed bit, and when the last error flag has ended.

        From the bit after that one on everything is at the nominal bit rate, but receivers that are still in
        the data phase look that often whether a rule is broken.
        """
        wire = wire_bits(frame)
        fast = sum(place >= other for other in wire.data_phase)
        seen_ns = start_ns + arbitration.bits_ns(self.state, place + 1 - fast, fast)
        late = receivers_late(wire, place, passive=passive)
        nominal, data = (0, late) if place in wire.data_phase else (late, 0)
        late_ns = arbitration.bits_ns(self.state, nominal, data)
        return seen_ns, seen_ns + late_ns + arbitration.bits_ns(self.state, FLAG, 0)

    def sender(self, number: int) -> object:
        """Who is known to the kernels by a number."""
        return self._senders[number]

    def received(self) -> list[Delivery]:
        """Takes out what the kernels have received."""
        state, words = self.state, self._words
        for i in range(words[WORD["changes"]]):
            t_ns, sender, number = state.changes[i].item()
            self.changes.append(StateChange(t_ns, self._senders[sender], STATES[number]))
        received = []
        for i in range(words[WORD["received"]]):
            t_ns, sender, fields = delivered(state.received, i)
            received.append(Delivery(t_ns, Frame(*fields), self._senders[sender]))
        words[WORD["changes"]] = words[WORD["received"]] = 0
        return received

    def pending(self) -> list[Frame]:
        """The frames that are waiting or on the wire."""
        state, words = self.state, self._words
        sending = [Frame(*taken(state.sending, 0))] if words[WORD["sending"]] else []
        return sending + [Frame(*taken(state.waiting, i)) for i in range(words[WORD["waiting"]])]

    @property
    def idle_from_ns(self) -> int:
        """When the next frame may begin: the end of the newest frame's intermission."""
        return self._words[WORD["idle_ns"]]

    def waiting_from(self, sender: object) -> int:
        """How many frames of a sender wait for the bus, the one on the wire not counted."""
        waiting = self.state.waiting["sender"][: self._words[WORD["waiting"]]]
        return int(np.count_nonzero(waiting == self._numbers.get(sender, -1)))

    def bus_off(self, t_ns: int) -> frozenset[object]:
        """Who is bus-off at `t_ns`, the time up to which the bus was advanced: it hears nothing."""
        if not self._words[WORD["confined"]]:
            return frozenset()
        return frozenset(
            sender for sender in self.controllers if arbitration.off(self.state, self._numbers[sender], t_ns)
        )

    @property
    def controllers(self) -> dict[object, Controller]:
        """Of all that have sent, by sender, where there may be errors."""
        own = self.state.controllers[: self._words[WORD["confined"]]]
        return {
            self._senders[int(own["sender"][i])]: Controller(record=own[i : i + 1]) for i in range(len(own))
        }

    @property
    def load(self) -> BusLoad:
        """What has gone over it so far."""
        table, words = self.state.load, self._words
        sent = {int(i): table[i].item() for i in np.flatnonzero(table["frames"])}
        return BusLoad(
            Counter({identifier: frames for identifier, (frames, _) in sent.items()}),
            {identifier: wait_ns for identifier, (_, wait_ns) in sent.items()},
            words[WORD["busy_ns"]],
            words[WORD["errors"]],
        )

    def busy(self, duration_ns: int) -> float:
        """``load.over(duration_ns)``, without counting the frames."""
        return BusLoad(busy_ns=self._words[WORD["busy_ns"]]).over(duration_ns)

    def begin_again(self, state: Bus) -> None:
        """With a state in which it has begun before, and the senders of then."""
        self.state, self.changes = state, []

    def save(self) -> tuple:
        """Everything that changes, for `restore`."""
        return Bus(*(part.copy() for part in self.state)), copy.deepcopy(self.errors), tuple(self.changes)

    def restore(self, state: tuple) -> None:
        """Go back to a saved state; it may be restored again later."""
        self.state = Bus(*(part.copy() for part in state[0]))
        self.errors = copy.deepcopy(state[1])
        self.changes = list(state[2])


def _longer(array: np.ndarray, count: int) -> np.ndarray:
    longer = np.zeros(2 * len(array) + count, array.dtype)
    longer[: len(array)] = array
    return longer
