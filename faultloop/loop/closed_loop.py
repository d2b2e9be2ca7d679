"""The closed loop: one clock, plant, relays, bus, breakers, recorder.

Causality is exact: no frame acts before it has arrived.  Plant and relays run ahead in blocks (`ahead`),
which end at the first sample at which anything changed that another part can hear of: a relay's output, a
breaker's pole, a fault.  Then the compiled `exchange` lets the bus and its nodes follow to the block's end,
or to where something from the bus acts; what plant and relays have run beyond that is forgotten.  So Python
is paid per change, not per sample or frame, and the result is the same, bit for bit, as sample by sample.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from faultloop.errors import InputError, nearest
from faultloop.io.can.transport import Transport
from faultloop.loop.ahead import Ahead
from faultloop.loop.outcome import pole_names
from faultloop.loop.pacing import Deadlines
from faultloop.loop.recording import PLANT_EVENTS, Recorder
from faultloop.loop.scenario import Scenario
from faultloop.loop.traffic import Traffic
from faultloop.loop.warm import warm_up
from faultloop.nodes import FOREVER, Command, Movement, with_followed_breakers
from faultloop.nodes.clock import SampleClock
from faultloop.plant import Plant
from faultloop.relay import Event, Relay, RelayInputs

BLOCK = 240
"""Samples that plant and relays run ahead at most."""


class ClosedLoop:
    """One run of a scenario.

    Parameters
    ----------
    scenario : validated.
    relays : the relays, by name.
    recorder : gets everything.
    bus : carries the frames.
    pace : simulated seconds per second of wall time; None runs as fast as it can.
    without : breakers that are not simulated: the plant follows the status that somebody else on the bus
        publishes for them.
    warm_up : has the relays run over the time before sample 0.
    """

    def __init__(
        self,
        scenario: Scenario,
        relays: Mapping[str, Relay],
        recorder: Recorder,
        bus: Transport,
        pace: float | None = None,
        without: Collection[str] = (),
        *,
        warm_up: Callable[[Scenario, Sequence[Relay]], None] = warm_up,
    ) -> None:
        self.scenario = scenario
        self._warm_up = warm_up
        left_out = _breakers_left_out(scenario, without)
        self.plant = Plant(with_followed_breakers(scenario, left_out))
        self.relays = [relays[place.name] for place in scenario.relay]
        self.recorder = recorder
        self.clock = SampleClock(self.plant.sampling_hz)
        self.total = self.clock.first_from(round(scenario.scenario.duration_s * 1e9))
        self._ahead = Ahead(self.plant, self.relays)
        self._breaker_names = [b.name for b in scenario.breaker]
        self._relay_names = [place.name for place in scenario.relay]
        self._traffic = Traffic(scenario, bus, recorder, self, left_out)
        self._away: set[int] = set()
        self._cold: list[Any] = []  # the relays' states before anything was measured
        self.deadlines = Deadlines(self.clock.ns(1))
        """Of the blocks, in a run that is paced."""
        self.interrupted = False
        self._pace = pace
        # In real time a block must not keep anybody waiting; in simulated time it may be long.
        self._block = BLOCK if pace is None else max(1, self.clock.sampling_hz // 1000)

    # -- the clock ------------------------------------------------------------------------------------------

    def run(self, progress: Callable[[float], None] | None = None) -> None:
        """From the first sample to the last."""
        self._begin()
        started, ahead = time.monotonic(), self._ahead
        while ahead.sample_count < self.total and not self.interrupted:
            if not ahead.left:
                self._serve_whole(self.clock.ns(ahead.sample_count))
                ahead.make(self._length(ahead.sample_count))
            if self._traffic.serve(self.clock.ns(ahead.sample_count + ahead.left - 1)):
                continue  # something has acted: what is left may be nothing
            self._take(ahead.left)
            if progress is not None:
                progress(ahead.sample_count / self.total)
            if self._pace is not None:
                self._keep_time(self.clock.ns(ahead.sample_count), started, self._pace)
        self.simulated_ns = self.clock.ns(ahead.sample_count)
        self._serve_whole(self.simulated_ns)
        self._traffic.end(self.simulated_ns)

    def _serve_whole(self, until_ns: int) -> None:
        while self._traffic.serve(until_ns):
            pass

    def _length(self, k: int) -> int:
        """Samples of the block from `k` on.  What a relay measures is shown as it is at the end of a block:
        none passes the next showing."""
        shown_ns = min((node.shown_ns for node in self._traffic.relays), default=FOREVER)
        n = min(self._block, self.total - k)
        return n if shown_ns >= self.clock.ns(k + n) else max(1, self.clock.first_from(shown_ns) - k)

    def _keep_time(self, t_ns: int, started: float, pace: float) -> None:
        """Sleep until `t_ns`; note how late it has become."""
        ahead_s = t_ns / 1e9 / pace - (time.monotonic() - started)
        if ahead_s > 0:
            time.sleep(ahead_s)
        self.deadlines.note(t_ns, round((time.monotonic() - started) * pace * 1e9))

    def _begin(self) -> None:
        for place, relay in zip(self.scenario.relay, self.relays, strict=True):
            self.recorder.add_relay(place.name, relay.bits, relay.characteristics())
            self._cold.append(relay.save())
        self._warm_up(self.scenario, self.relays)
        for note in self.plant.notes:
            self._event(0, "plant", "info", note, PLANT_EVENTS)
        for name in self._breaker_names:
            self.recorder.breaker(name, 0, self.plant.closed(name))
        for i, relay in enumerate(self.relays):
            self._record_events(i, relay.events)
            self._set(i, 0, relay.phasors[-1])

    # -- one piece ------------------------------------------------------------------------------------------

    def _take(self, count: int) -> None:
        """The next samples that were made have happened."""
        piece = self._ahead.take(count)
        last_ns = self.clock.ns(piece.first + piece.length - 1)
        for i, part in piece.relays.items():
            self.recorder.block(self._relay_names[i], self.clock, piece.first, part.block)
        if piece.ends:
            self._record_plant(last_ns)
        for i, part in piece.relays.items():
            self._record_events(i, part.events)
            if part.ends:
                self._set(i, last_ns, part.block.phasors[-1])

    def _reach(self, t_ns: int) -> None:
        """Something happens at `t_ns`: the samples before it are as they are, those after it are not yet."""
        count = self.clock.first_from(t_ns) - self._ahead.sample_count
        if count > 0:
            self._take(count)

    def _record_plant(self, t_ns: int) -> None:
        """Poles and faults that the block, which ends at `t_ns`, changed.

        A breaker's node scans its contacts once a sample, so its frame is of the sample after the change.
        """
        for change in self.plant.changes:
            if change.kind == "pole":
                self.recorder.breaker(self._breaker_names[change.index], change.t_ns, change.value)
                if change.index in self._traffic.breakers:
                    self._traffic.breakers[change.index].set(t_ns, change.value)
            else:
                fault = self.scenario.fault[change.index]
                self.recorder.fault(change.t_ns, change.index, fault.name, fault.type, bool(change.value))

    def _record_events(self, number: int, events: Iterable[Event]) -> None:
        name = self._relay_names[number]
        for event in events:
            at_ns = self.clock.ns(event.sample_count)
            self._event(at_ns, name, event.level, event.text, f"/relay/{name}/events")
            if event.trip is not None:
                self.recorder.trip(name, at_ns, event.sample_count, event.trip)

    def _set(self, number: int, t_ns: int, phasors: np.ndarray) -> None:
        """The outputs of a relay at the end of a block, `t_ns`, and what it measures there."""
        relay, node = self.relays[number], self._traffic.relays[number]
        outputs = relay.outputs
        node.set(t_ns, outputs.trip_poles, outputs.close_poles, outputs.pilot)
        node.measured[:14] = phasors
        node.measured[14] = relay.fault_location

    def _event(self, t_ns: int, source: str, level: str, text: str, topic: str) -> None:
        self.recorder.event(topic, t_ns, level, text, source)

    # -- what comes from the bus ----------------------------------------------------------------------------

    def take_inputs(self, relay: int, t_ns: int) -> None:
        """A relay's node has accepted a state; mostly it says what the relay knows already."""
        node = self._traffic.relays[relay]
        inputs = RelayInputs(node.breaker_closed, node.pilot_received)
        if inputs != self.relays[relay].inputs:
            self._reach(t_ns)
            self._ahead.settle_relay(relay)
            self.relays[relay].inputs = inputs

    def obey(self, breaker: int, command: Command) -> None:
        """A breaker acts on an accepted command; this is the time that a trip's report states."""
        name = self._breaker_names[breaker]
        self._reach(command.t_ns)
        self._ahead.settle()
        self.plant.command(name, command.operation, command.poles, command.t_ns)
        relay = self.scenario.relay[command.relay].name
        self.recorder.breaker(name, command.t_ns, self.plant.closed(name), command.operation, relay)
        text = f"{command.operation} poles {pole_names(command.poles)} received from {relay}"
        self._event(command.t_ns, name, "info", text, f"/breaker/{name}/events")

    def move(self, breaker: int, t_ns: int, movement: Movement) -> None:
        """The status of a breaker that is somebody else's moves the plant."""
        name = self._breaker_names[breaker]
        self._reach(t_ns)
        self._ahead.settle()
        self.plant.command(name, movement.operation, movement.poles, t_ns)
        text = f"status {movement.operation}, poles {pole_names(movement.poles)}"
        self._event(t_ns, name, "info", text, f"/breaker/{name}/events")

    def restart(self, relay: int, t_ns: int, *, begins: bool) -> None:
        """A relay goes, or is back: cold, and remembers nothing."""
        self._reach(t_ns)
        self._ahead.settle()
        if begins:
            self._away.add(relay)
        else:
            self._away.discard(relay)
            self.relays[relay].restore(self._cold[relay])
            self.relays[relay].sample_count = self.clock.first_from(t_ns)
        self._ahead.run_only([i for i in range(len(self.relays)) if i not in self._away])

    def closed(self, breaker: int, t_ns: int) -> int:
        """Mask of a breaker's poles that conduct."""
        self._reach(t_ns)
        self._ahead.settle()
        return self.plant.closed(self._breaker_names[breaker])


def _breakers_left_out(scenario: Scenario, without: Collection[str]) -> frozenset[str]:
    breakers = [breaker.name for breaker in scenario.breaker]
    for name in without:
        if name in breakers:
            continue
        if any(name == place.name for place in scenario.relay):
            raise InputError(
                f"'{name}' is a relay; what can be left out here are the breakers: {', '.join(breakers)}",
                key="--without",
            )
        raise InputError(f"there is no breaker '{name}': {nearest(name, breakers)}", key="--without")
    return frozenset(without)
