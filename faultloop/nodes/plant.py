"""The plant's side of the bus: sampled values out, positions of breakers in."""

from __future__ import annotations

from collections.abc import Callable

from faultloop.io.can.frames import Frame, Heartbeat, SampledValues, ticks
from faultloop.io.can.table import OPERATIONAL, PLANT_NODE
from faultloop.nodes.clock import Cyclic, SampleClock
from faultloop.nodes.follower import with_followed_breakers
from faultloop.nodes.refusals import Report
from faultloop.nodes.roster import breaker_follower, time_master
from faultloop.nodes.tables import BusTables
from faultloop.nodes.time_sync import confirm_first
from faultloop.plant import Plant
from faultloop.plant.breaker import Breaker
from faultloop.plant.fault import Fault

AT_ONCE = 64
"""Samples that one `poll` makes at most: a late plant must still hear the breakers."""

Changed = Callable[[int, str, int, int], None]
"""Called with run time [ns], "pole" or "fault", which one, and its new value, as the plant reports it."""


class PlantNode:
    """Publishes one frame of sampled values for each relay and sample, and follows the breakers' status.

    Parameters
    ----------
    scenario : the whole of it.
    first_sample : number of the first sample; not 0 for a plant that joins a run that has begun.  It must be
        at a whole cycle, so that the waves go on where they were.
    report : told of every status frame that is refused, and why.
    changed : told of every pole and fault that changed.
    """

    def __init__(self, scenario: BusTables, first_sample: int, report: Report, changed: Changed) -> None:
        sampling_hz = scenario.system.sampling_hz
        if first_sample * scenario.system.frequency_hz % sampling_hz:
            raise ValueError(f"sample {first_sample} is not at a whole cycle")
        self._clock = SampleClock(sampling_hz)
        begins_ns = self._clock.ns(first_sample)
        followed = with_followed_breakers(scenario, frozenset(b.name for b in scenario.breaker))
        self.plant = Plant(followed.beginning_at(begins_ns / 1e9) if begins_ns else followed)
        _rehearse(self.plant)
        self.sampling_hz = sampling_hz
        self.total = self._clock.first_from(round(scenario.scenario.duration_s * 1e9))
        self.sample_count = self.first_sample = first_sample
        self._begins_ns = begins_ns
        self._names = [breaker.name for breaker in scenario.breaker]
        self._relays = range(len(scenario.relay))
        self._changed = changed
        numbers = {fault.name: i for i, fault in enumerate(scenario.fault)}
        self._fault_numbers = [numbers[fault.name] for fault in self.plant.tables.all(Fault)]
        self._report = report
        self.attend(scenario, begins_ns)
        self._heartbeat = Cyclic(1 / scenario.can.heartbeat_s, begins_ns)
        self._master = time_master(scenario, report, start_ns=begins_ns)

    def attend(self, scenario: BusTables, start_ns: int) -> None:
        """Follow the breakers from run time `start_ns` on; the seal is that of `scenario`."""
        self.followers = [
            breaker_follower(scenario, i, self.plant.closed(name), self._report, start_ns=start_ns)
            for i, name in enumerate(self._names)
        ]

    def sample_ns(self, count: int) -> int:
        """Run time of a sample [ns]."""
        return self._clock.ns(count)

    @property
    def done(self) -> bool:
        """The last sample has been published."""
        return self.sample_count >= self.total

    @property
    def next_ns(self) -> int:
        """When `poll` has something to send."""
        due_ns = self._heartbeat.next_ns
        if self._master is not None:
            due_ns = min(due_ns, self._master.next_ns)
        return due_ns if self.done else min(self.sample_ns(self.sample_count), due_ns)

    def poll(self, t_ns: int) -> list[Frame]:
        """The frames that are due."""
        frames: list[Frame] = []
        # Those with `sample_ns` up to `t_ns`.
        due = min(self._clock.first_from(t_ns + 1), self.total)
        n = min(due - self.sample_count, AT_ONCE)
        while n > 0:
            made = self.plant.advance(n)
            for row in self.plant.samples.tolist():
                count = self.sample_count
                frames += [
                    SampledValues(i, count, tuple(row[i]), count & 0xFF).encode() for i in self._relays
                ]
                self.sample_count += 1
            for change in self.plant.changes:
                number = change.index if change.kind == "pole" else self._fault_numbers[change.index]
                self._changed(self._begins_ns + change.t_ns, change.kind, number, change.value)
            n -= made
        if self._heartbeat.poll(t_ns):
            frames.append(Heartbeat(PLANT_NODE, OPERATIONAL, 0, 0, ticks(t_ns)).encode())
        return frames + self._time(t_ns)

    def _time(self, t_ns: int) -> list[Frame]:
        """SYNC, and its follow-up at once: a socket tells nobody when his own frame has ended.  That is as
        late for every relay, so that they have one time, which is late by that against the plant's."""
        if self._master is None or t_ns < self._master.next_ns:
            return []
        frames = self._master.poll(t_ns)
        confirm_first(self._master.nodes.node["master"], t_ns)
        return frames + self._master.poll(t_ns)

    def receive(self, t_ns: int, frame: Frame) -> None:
        """Take a frame: a breaker's accepted status moves its poles, at once or at the next current zero."""
        for number, follower in enumerate(self.followers):
            for movement in follower.receive(t_ns, frame):
                at_ns = max(t_ns, self.sample_ns(self.sample_count)) - self._begins_ns
                self.plant.command(self._names[number], movement.operation, movement.poles, at_ns)


def _rehearse(plant: Plant) -> None:
    """Load every kernel that a fault or an opening needs: numba loads one when it is first called, in up to
    100 ms, for which the samples of a real fault would have to wait."""
    state = plant.save()
    for breaker in plant.tables.all(Breaker):
        plant.command(breaker.name, "open", 7, 0)
    left = plant.sampling_hz // 25  # two cycles: every pole has its current zero
    while left > 0:
        left -= plant.advance(left)
    plant.restore(state)
