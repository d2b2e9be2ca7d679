"""A breaker's side of the bus."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from faultloop.io.can.authentication import PLAIN, Seal
from faultloop.io.can.frames import Frame, Heartbeat, Rejection, State, decode, ticks
from faultloop.io.can.goose import Publisher, Repetition, Subscriber
from faultloop.io.can.table import BY_IDENTIFIER, OPERATIONAL, RELAYS, Alarm, Kind
from faultloop.nodes.clock import Cyclic
from faultloop.nodes.refusals import Refusals, Report


@dataclass(frozen=True, slots=True)
class Command:
    """What a breaker node accepted from the bus."""

    t_ns: int
    operation: Literal["open", "close"]
    poles: int
    relay: int


class BreakerNode:
    """A breaker's side of the bus: acts on trip and close frames of its relays, publishes its position.

    Parameters
    ----------
    number : of the breaker, 0 to 15.
    relays : numbers of the relays that may command it.
    closed : mask of closed poles at the start.
    report : told of the frames that it refuses, and why.
    seal : what its state frames pass, in and out.
    start_ns : when it starts, run time [ns]; it acts on no frame that was sent before.
    confirmations : frames that must agree before it acts.
    """

    def __init__(
        self,
        number: int,
        relays: Sequence[int],
        closed: int,
        heartbeat_s: float,
        report: Report,
        *,
        seal: Seal = PLAIN,
        start_ns: int = 0,
        confirmations: int = 1,
    ) -> None:
        repetition = Repetition(heartbeat_ns=round(heartbeat_s * 1e9))
        self.number = number
        self.status = Publisher(
            Kind.BREAKER_STATUS, number, poles=closed, start_ns=start_ns, repetition=repetition
        )
        self.commands = {
            kind + relay: Subscriber(repetition, start_ns=start_ns, confirmations=confirmations)
            for relay in relays
            for kind in (Kind.TRIP, Kind.CLOSE)
        }
        self._seal = seal
        self._heartbeat = Cyclic.since(start_ns, 1 / heartbeat_s)
        self._refusals = Refusals(report)

    @property
    def rejected(self) -> Counter[Rejection]:
        """Frames refused, by cause."""
        return self._refusals.causes

    @property
    def next_ns(self) -> int:
        """When `poll` has something to send."""
        return min(self.status.next_ns, self._heartbeat.next_ns)

    def set(self, t_ns: int, closed: int) -> None:
        """Its position from `t_ns` on."""
        self.status.set(closed, t_ns)

    def poll(self, t_ns: int) -> list[Frame]:
        """The frames that are due."""
        frames = []
        if (frame := self.status.poll(t_ns)) is not None:
            frames.append(self._seal.close(t_ns, frame))
        if self._heartbeat.poll(t_ns):
            frames.append(self._beat(t_ns))
        return frames

    def _beat(self, t_ns: int) -> Frame:
        for subscriber in self.commands.values():
            subscriber.supervise(t_ns)
        alarms = Alarm.SILENT if any(s.alarm for s in self.commands.values()) else Alarm(0)
        if self._refusals.beat(t_ns):
            alarms |= Alarm.REJECTED
        node = RELAYS + self.number
        return Heartbeat(node, OPERATIONAL, alarms, self._refusals.total, ticks(t_ns)).encode()

    def receive(self, t_ns: int, frame: Frame) -> Command | None:
        """Take a frame; the command in it, once for each state, or None.

        A frame that is for somebody else is passed over; one that is for it and fails any check, or whose
        identifier is nobody's, is refused and counted.
        """
        subscriber = self.commands.get(frame.id)
        if subscriber is None:
            if frame.id not in BY_IDENTIFIER:
                self._refusals.add(t_ns, frame, Rejection.UNKNOWN_ID)
            return None
        taken = self._taken(t_ns, frame, subscriber)
        if isinstance(taken, Rejection):
            self._refusals.add(t_ns, frame, taken)
            return None
        if taken is None or not taken.poles:
            return None
        return Command(t_ns, "open" if taken.kind == Kind.TRIP else "close", taken.poles, taken.number)

    def _taken(self, t_ns: int, frame: Frame, subscriber: Subscriber) -> State | Rejection | None:
        """The new state in a frame; None for a repetition; or why it is refused."""
        opened = self._seal.open(t_ns, frame)
        message = opened if isinstance(opened, Rejection) else decode(opened)
        if not isinstance(message, State):
            return message if isinstance(message, Rejection) else Rejection.FORMAT
        answer = subscriber.receive(message, t_ns)
        if isinstance(answer, Rejection):
            return answer
        return message if answer else None
