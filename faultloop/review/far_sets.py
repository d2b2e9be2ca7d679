"""What a line differential relay was given by the other ends, again, from the frames of a log.

The frames go through the same channel (its chance is the scenario's) and the same node as in the run, each at
the time at which the log has it.  What befell a receiver alone (off the bus, restarted) a log does not have.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from faultloop.io.can.authentication import unsealed
from faultloop.io.can.frames import Differential, Frame, decode
from faultloop.io.can.table import Kind
from faultloop.io.mcap_reader import Log
from faultloop.io.messages import CAN_FRAME
from faultloop.loop.phasors import give_first
from faultloop.loop.recorded import recorded_scenario
from faultloop.loop.scenario import Scenario
from faultloop.nodes import relay_node
from faultloop.nodes.channel import Arrivals, new_channels
from faultloop.nodes.clock import FOREVER, SampleClock
from faultloop.relay import Relay
from faultloop.relay.functions.pdif import agreement
from faultloop.relay.relay import records_of

COMPARED = np.dtype([("t_ns", "i8"), ("total", "f8", (3,)), ("bias", "f8", (3,)), ("external", "i8")])
"""Of an instant at which all ends' sets were there: when that was [ns since the run's start], of each phase
the sum of the currents and half the sum of their sizes [A], whether a fault outside was known."""
MOST = 1 << 17
"""Instants that are kept, 8 MB."""
FAR = (Kind.PILOT, Kind.TRANSFER, Kind.DIFFERENTIAL)
"""What goes by a channel."""


class FarSets:
    """The sets of the other ends, for a relay of a log that is run once more.

    Parameters
    ----------
    log : with the frames on the bus.
    scenario : that it is of.
    relay : by its name the one of the scenario; it has a line differential.
    """

    def __init__(self, log: Log, scenario: Scenario, relay: Relay) -> None:
        names = [place.name for place in scenario.relay]
        number = names.index(relay.name)
        self._relay = relay
        self._clock = SampleClock(scenario.system.sampling_hz)
        self._node = relay_node(scenario, number, agreement=agreement(relay.settings))
        seed = scenario.scenario.seed
        self._arrivals = Arrivals(new_channels(scenario.channel, names, seed, only=relay.name))
        self._own = Kind.DIFFERENTIAL + number
        self._plain_too = recorded_scenario(log).get("can", {}).get("keys") is None
        self._frames = self._read(log)
        self._next = next(self._frames, None)
        self._last = -1
        self._compared = np.zeros(1024, COMPARED)
        self._count = 0

    def _read(self, log: Log) -> Iterator[tuple[int, Frame]]:
        """Frames of the log that a channel carries, and of time, stretch by stretch."""
        for span in log.stretches() if CAN_FRAME.topic in log.topics else ():
            for entry in log.entries(CAN_FRAME, from_ns=span[0], to_ns=span[1]):
                if entry.extended or not (entry.id & ~0xF in FAR or entry.id == Kind.TIME_SYNC):
                    continue
                frame = Frame(entry.id, bytes(entry.data), fd=entry.fd)
                plain = unsealed(frame)
                # where keys are asked for, a plain frame was refused
                if plain is not frame or self._plain_too or entry.id == Kind.TIME_SYNC:
                    yield entry.t_ns, plain

    @property
    def compared(self) -> NDArray[np.void]:
        """(n,) ``COMPARED``."""
        return self._compared[: self._count]

    def next_number(self, number: int) -> int:
        """The first sample after this one by which something more will have arrived."""
        t_ns = self._arrivals.next_ns if self._next is None else min(self._next[0], self._arrivals.next_ns)
        return max(self._clock.first_from(t_ns), number + 1) if t_ns < FOREVER else FOREVER

    def give(self, number: int) -> bool:
        """To the relay, whatever had arrived by the time of this sample; whether there was something."""
        t_ns, taken = self._clock.ns(number), False
        self._look(t_ns)
        while self._next is not None and self._next[0] <= t_ns:
            at_ns, frame = self._next
            self._next = next(self._frames, None)
            taken |= self._take(at_ns - 1)
            if frame.id == self._own:
                self._note(frame)
            elif frame.id == Kind.TIME_SYNC:
                self._node.receive(at_ns, frame)
            else:
                self._arrivals.takes(at_ns, frame)
        if self._arrivals.next_ns <= t_ns:
            taken |= self._take(t_ns)
        if taken:
            give_first(self._node.nodes, self._node.place, *records_of(self._relay))
        return taken

    def _look(self, t_ns: int) -> None:
        """At what the sample before has compared."""
        w = records_of(self._relay)[1]["pdif"][0, 0]
        last = int(w["last"])
        if last <= self._last:
            return
        self._last = last
        own = w["own"][last % len(w["own"])]
        currents = [own["i"]]
        for far in w["remote"][: int(w["remotes"])]:
            one = far["set"][last % len(far["set"])]
            currents.append(one["i"] - own["charging"] * (one["bare"] and not own["bare"]))
        total, bias = np.abs(np.sum(currents, axis=0)), np.abs(currents).sum(axis=0) / 2
        if self._count == len(self._compared):
            self._make_room()
        self._compared[self._count] = (t_ns, total, bias, int(w["external"] > 0))
        self._count += 1

    def _make_room(self) -> None:
        """Where there are too many, of each two the one with the greater sum of an end's currents stays."""
        if self._count < MOST:
            self._compared = np.concatenate([self._compared, np.zeros_like(self._compared)])
            return
        greatest = self._compared["total"].max(axis=1).reshape(-1, 2)
        stay = 2 * np.arange(self._count // 2) + greatest.argmax(axis=1)
        self._count = len(stay)
        self._compared[: self._count] = self._compared[stay]

    def _take(self, t_ns: int) -> bool:
        found = [
            self._node.receive(due_ns, frame)
            for due_ns, frame in self._arrivals.poll(t_ns)
            if frame.id & ~0xF == Kind.DIFFERENTIAL
        ]
        return any(found)

    def _note(self, frame: Frame) -> None:
        """When the own set was measured that the other end will say it has heard."""
        message = decode(frame)
        if isinstance(message, Differential):
            self._node.nodes.sent_us[self._node.place, message.counter] = message.time
