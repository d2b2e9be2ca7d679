"""The nodes on the bus: a relay and a breaker, each with nothing but frames and its own clock.

A node takes frames (`receive`) and gives frames (`poll`, due at `next_ns`); it shares no memory with the
other nodes, and it does not know whether the bus is simulated or real.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from faultloop.io.can.frames import Frame, Heartbeat, Measurements, Page, Rejection, State, decode, ticks
from faultloop.io.can.goose import Publisher, Repetition, Subscriber
from faultloop.io.can.table import RELAYS, Kind

FOREVER = np.iinfo(np.int64).max
OPERATIONAL = 5

Report = Callable[[int, str, str], None]
"""Called with time [ns], level ("info", "warning") and a text for the log."""


class _Cyclic:
    """Due at every multiple of an interval, counted from zero so that no rounding adds up."""

    def __init__(self, rate_hz: float, first: int = 0) -> None:
        self.rate_hz = rate_hz
        self.count = first
        self.next_ns = self._due()

    def _due(self) -> int:
        return round(self.count * 1e9 / self.rate_hz) if self.rate_hz > 0 else FOREVER

    def poll(self, t_ns: int) -> bool:
        if t_ns < self.next_ns:
            return False
        self.count += 1
        self.next_ns = self._due()
        return True


class RelayNode:
    """A relay's side of the bus: publishes trip, close, pilot and measurements; follows breaker and far end.

    Parameters
    ----------
    number : of the relay, 0 to 15.
    breaker : number of the breaker it trips and follows, None if it has none.
    partners : numbers of the relays whose pilot signal it takes.
    heartbeat_s, measurements_hz : how often it publishes while nothing happens.
    """

    def __init__(
        self,
        number: int,
        breaker: int | None,
        partners: Sequence[int],
        heartbeat_s: float,
        measurements_hz: float,
    ) -> None:
        repetition = Repetition(heartbeat_ns=round(heartbeat_s * 1e9))
        self.number = number
        self.breaker = breaker
        self.trip = Publisher(Kind.TRIP, number, repetition=repetition)
        self.close = Publisher(Kind.CLOSE, number, repetition=repetition)
        self.pilot = Publisher(Kind.PILOT, number, repetition=repetition)
        self.status = Subscriber(repetition)
        self.pilots = {partner: Subscriber(repetition) for partner in partners}
        self._heartbeat = _Cyclic(1 / heartbeat_s)
        self._measurements = _Cyclic(measurements_hz, first=1)
        self._counter = 0
        self._rejected = 0
        self.measured = np.full(15, np.nan)
        """Phasor row and fault location, kept up to date by whoever runs the relay."""

    @property
    def next_ns(self) -> int:
        """When `poll` has something to send."""
        return min(
            self.trip.next_ns,
            self.close.next_ns,
            self.pilot.next_ns,
            self._heartbeat.next_ns,
            self._measurements.next_ns,
        )

    def set(self, t_ns: int, trip: int, close: int, pilot: int) -> None:
        """The relay's outputs from `t_ns` on, each a mask of poles."""
        self.trip.set(trip, t_ns)
        self.close.set(close, t_ns)
        self.pilot.set(pilot, t_ns)

    def poll(self, t_ns: int) -> list[Frame]:
        """The frames that are due."""
        frames = [f for p in (self.trip, self.close, self.pilot) if (f := p.poll(t_ns)) is not None]
        if self._heartbeat.poll(t_ns):
            silent = self.status.supervise(t_ns) | self.status.alarm
            frames.append(
                Heartbeat(self.number, OPERATIONAL, int(silent), self._rejected, ticks(t_ns)).encode()
            )
        if self._measurements.poll(t_ns):
            frames += [m.encode() for m in self._pages()]
        return frames

    def _pages(self) -> list[Measurements]:
        rms = np.abs(self.measured[0:12:2] + 1j * self.measured[1:12:2]).tolist()
        frequency, rocof, location = self.measured[12:15].tolist()
        pages = (
            (Page.VOLTAGE, (rms[0], rms[1], rms[2])),
            (Page.CURRENT, (rms[3], rms[4], rms[5])),
            (Page.FREQUENCY, (frequency, rocof, location)),
        )
        messages = [
            Measurements(self.number, page, v, (self._counter + i) & 0xFF)
            for i, (page, v) in enumerate(pages)
        ]
        self._counter = (self._counter + len(pages)) & 0xFF
        return messages

    def receive(self, t_ns: int, frame: Frame) -> bool:
        """Take a frame; True where the relay's inputs have changed."""
        kind, number = frame.id & ~0xF, frame.id & 0xF
        if kind == Kind.BREAKER_STATUS and number == self.breaker:
            subscriber = self.status
        elif kind == Kind.PILOT and number in self.pilots:
            subscriber = self.pilots[number]
        else:
            return False
        message = decode(frame)
        taken = subscriber.receive(message, t_ns) if isinstance(message, State) else message
        if isinstance(taken, Rejection):
            self._rejected += 1
        return taken is True

    @property
    def breaker_closed(self) -> int:
        """Closed poles of its breaker, as last accepted; all where it has none or has heard nothing yet."""
        return 7 if self.status.poles is None else self.status.poles

    @property
    def pilot_received(self) -> int:
        """Poles for which any partner sends its pilot signal."""
        mask = 0
        for subscriber in self.pilots.values():
            mask |= subscriber.poles or 0
        return mask


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
        self._heartbeat = _Cyclic(1 / heartbeat_s)
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
