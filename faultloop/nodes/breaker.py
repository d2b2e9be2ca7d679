"""A breaker's side of the bus."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

from faultloop.io.can.frames import Frame, Heartbeat, Rejection, State, decode, ticks
from faultloop.io.can.goose import Publisher, Repetition, Subscriber
from faultloop.io.can.table import OPERATIONAL, RELAYS, Kind
from faultloop.nodes.clock import Cyclic

Report = Callable[[int, str, str], None]
"""Called with time [ns], level ("info", "warning") and a text for the log."""


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
    report : told of every frame that it refuses, and why.
    """

    def __init__(
        self, number: int, relays: Sequence[int], closed: int, heartbeat_s: float, report: Report
    ) -> None:
        repetition = Repetition(heartbeat_ns=round(heartbeat_s * 1e9))
        self.number = number
        self.status = Publisher(Kind.BREAKER_STATUS, number, poles=closed, repetition=repetition)
        self.commands = {
            kind + relay: Subscriber(repetition) for relay in relays for kind in (Kind.TRIP, Kind.CLOSE)
        }
        self._heartbeat = Cyclic(1 / heartbeat_s)
        self._report = report
        self.rejected = 0

    @property
    def next_ns(self) -> int:
        """When `poll` has something to send."""
        return min(self.status.next_ns, self._heartbeat.next_ns)

    def set(self, t_ns: int, closed: int) -> None:
        """Its position from `t_ns` on."""
        self.status.set(closed, t_ns)

    def poll(self, t_ns: int) -> list[Frame]:
        """The frames that are due."""
        frames = [frame] if (frame := self.status.poll(t_ns)) is not None else []
        if self._heartbeat.poll(t_ns):
            for subscriber in self.commands.values():
                subscriber.supervise(t_ns)
            alarm = int(any(s.alarm for s in self.commands.values()))
            beat = Heartbeat(RELAYS + self.number, OPERATIONAL, alarm, self.rejected, ticks(t_ns))
            frames.append(beat.encode())
        return frames

    def receive(self, t_ns: int, frame: Frame) -> Command | None:
        """Take a frame; the command in it, once for each state, or None."""
        subscriber = self.commands.get(frame.id)
        if subscriber is None:
            return None
        message = decode(frame)
        taken = subscriber.receive(message, t_ns) if isinstance(message, State) else message
        if isinstance(taken, Rejection):
            self.rejected += 1
            self._report(t_ns, "warning", f"frame {frame.id:#05x} refused: {taken.value}")
            return None
        if not taken or not isinstance(message, State) or not message.poles:
            return None
        operation = "open" if message.kind == Kind.TRIP else "close"
        return Command(t_ns, operation, message.poles, message.number)
