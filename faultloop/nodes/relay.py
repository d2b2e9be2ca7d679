"""A relay's side of the bus."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from faultloop.io.can.authentication import PLAIN, Seal
from faultloop.io.can.frames import Frame, Heartbeat, Measurements, Page, Rejection, State, decode, ticks
from faultloop.io.can.goose import Publisher, Repetition, Subscriber
from faultloop.io.can.table import BY_IDENTIFIER, OPERATIONAL, Alarm, Kind
from faultloop.nodes.clock import Cyclic
from faultloop.nodes.refusals import Refusals, Report, unheard


class RelayNode:
    """A relay's side of the bus: publishes trip, close, pilot and measurements; follows breaker and far end.

    Parameters
    ----------
    number : of the relay, 0 to 15.
    breaker : number of the breaker it trips and follows, None if it has none.
    partners : numbers of the relays whose pilot signal it takes.
    heartbeat_s, measurements_hz : how often it publishes while nothing happens.
    report : told of the frames that it refuses, and why.
    seal : what its state frames pass, in and out.
    start_ns : when it starts, run time [ns]; it acts on no frame that was sent before.
    confirmations : frames that must agree before it acts.
    """

    def __init__(
        self,
        number: int,
        breaker: int | None,
        partners: Sequence[int],
        heartbeat_s: float,
        measurements_hz: float,
        report: Report = unheard,
        *,
        seal: Seal = PLAIN,
        start_ns: int = 0,
        confirmations: int = 1,
    ) -> None:
        repetition = Repetition(heartbeat_ns=round(heartbeat_s * 1e9))
        self.number = number
        self.breaker = breaker
        self.trip = Publisher(Kind.TRIP, number, start_ns=start_ns, repetition=repetition)
        self.close = Publisher(Kind.CLOSE, number, start_ns=start_ns, repetition=repetition)
        self.pilot = Publisher(Kind.PILOT, number, start_ns=start_ns, repetition=repetition)
        self.status = Subscriber(repetition, start_ns=start_ns, confirmations=confirmations)
        self.pilots = {
            partner: Subscriber(repetition, start_ns=start_ns, confirmations=confirmations)
            for partner in partners
        }
        self._seal = seal
        self._heartbeat = Cyclic.since(start_ns, 1 / heartbeat_s)
        self._measurements = Cyclic.since(start_ns + 1, measurements_hz)
        self._counter = 0
        self._refusals = Refusals(report)
        self.measured = np.full(15, np.nan)
        """Phasor row and fault location, kept up to date by whoever runs the relay."""

    @property
    def rejected(self) -> Counter[Rejection]:
        """Frames refused, by cause."""
        return self._refusals.causes

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

    @property
    def shown_ns(self) -> int:
        """When it shows what the relay measures next."""
        return self._measurements.next_ns

    def set(self, t_ns: int, trip: int, close: int, pilot: int) -> None:
        """The relay's outputs from `t_ns` on, each a mask of poles."""
        self.trip.set(trip, t_ns)
        self.close.set(close, t_ns)
        self.pilot.set(pilot, t_ns)

    def poll(self, t_ns: int) -> list[Frame]:
        """The frames that are due."""
        states = (self.trip.poll(t_ns), self.close.poll(t_ns), self.pilot.poll(t_ns))
        frames = [self._seal.close(t_ns, frame) for frame in states if frame is not None]
        if self._heartbeat.poll(t_ns):
            frames.append(self._beat(t_ns))
        if self._measurements.poll(t_ns):
            frames += [m.encode() for m in self._pages()]
        return frames

    def _beat(self, t_ns: int) -> Frame:
        self.status.supervise(t_ns)
        alarms = Alarm.SILENT if self.status.alarm else Alarm(0)
        if self._refusals.beat(t_ns):
            alarms |= Alarm.REJECTED
        return Heartbeat(self.number, OPERATIONAL, alarms, self._refusals.total, ticks(t_ns)).encode()

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
            if frame.id not in BY_IDENTIFIER:
                self._refusals.add(t_ns, frame, Rejection.UNKNOWN_ID)
            return False
        opened = self._seal.open(t_ns, frame)
        message = opened if isinstance(opened, Rejection) else decode(opened)
        taken = subscriber.receive(message, t_ns) if isinstance(message, State) else message
        if isinstance(taken, Rejection):
            self._refusals.add(t_ns, frame, taken)
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
