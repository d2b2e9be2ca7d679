"""A relay's side of the bus."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from faultloop.io.can.frames import Frame, Heartbeat, Measurements, Page, Rejection, State, decode, ticks
from faultloop.io.can.goose import Publisher, Repetition, Subscriber
from faultloop.io.can.table import OPERATIONAL, Kind
from faultloop.nodes.clock import Cyclic


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
        self._heartbeat = Cyclic(1 / heartbeat_s)
        self._measurements = Cyclic(measurements_hz, first=1)
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
