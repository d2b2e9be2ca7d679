"""The process of a relay: samples in, trips out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from math import gcd
from typing import Any

import numpy as np

from faultloop.io.can.frames import Frame
from faultloop.io.can.table import Kind
from faultloop.live.clock import RunClock
from faultloop.live.stream import BesideStream, SampleStream, quantised
from faultloop.loop.pacing import Percentiles
from faultloop.loop.phasors import give_first, say_first
from faultloop.loop.recording import Recorder
from faultloop.loop.scenario import Scenario
from faultloop.loop.warm import history, measured
from faultloop.nodes import FOREVER, relay_node
from faultloop.nodes.block import RelayBlock
from faultloop.nodes.channel import Arrivals, new_channels
from faultloop.nodes.clock import SampleClock
from faultloop.relay import Relay, RelayInputs, load_settings
from faultloop.relay.functions.pdif import agreement
from faultloop.relay.relay import records_of

SILENT_NS = 20_000_000
"""Without a sample for so long, the relay says that it measures nothing."""


def identifiers(scenario: Scenario, number: int) -> list[int]:
    """What a relay listens to: its samples, the parallel line's, its breaker's position, pilot signals of its
    partners."""
    node = relay_node(scenario, number)
    breaker = [] if node.breaker is None else [Kind.BREAKER_STATUS + node.breaker]
    names = [place.name for place in scenario.relay]
    others = {names.index(c.misrouted) for c in scenario.channel if c.misrouted is not None}
    pilots = [Kind.PILOT + i for i in dict.fromkeys((*node.partners, *sorted(others)))]
    transfers = [kind + i for kind in (Kind.TRANSFER, Kind.DIFFERENTIAL) for i in node.linked]
    parallel = scenario.relay[number].parallel
    beside = [] if parallel is None else [Kind.SAMPLED_VALUES + names.index(parallel)]
    time = [] if scenario.time_sync is None else [int(Kind.TIME_SYNC)]
    return [Kind.SAMPLED_VALUES + number, *beside, *breaker, *pilots, *transfers, *time]


class RelayProcess:
    """A relay on the bus.

    It is in service before time zero, as in the simulation, if it takes part from sample 0 on: it has then
    run over a second of the plant's steady state.  One that joins later starts with empty filters and is
    blind until they are settled; so does one whose samples broke off.
    """

    def __init__(self, scenario: Scenario, number: int, overrides: Sequence[str] = ()) -> None:
        self.place = scenario.relay[number]
        self.name = self.place.name
        self._scenario, self._number = scenario, number
        self.node = relay_node(scenario, number)
        settings = load_settings(scenario.settings_path(self.place), overrides)
        self.relay = Relay(settings, name=self.name)
        self._empty = self.relay.save()
        self._agreement = agreement(settings)
        hz = scenario.system.sampling_hz
        self._clock = SampleClock(hz)
        self._total = self._clock.first_from(round(scenario.scenario.duration_s * 1e9))
        cycle = hz // gcd(hz, scenario.system.frequency_hz)
        self._stream = SampleStream(hz, cycle)
        self._beside: BesideStream | None = None
        if self.place.parallel is not None:
            self._beside = BesideStream(hz, cycle)
            names = [place.name for place in scenario.relay]
            self._beside_id = Kind.SAMPLED_VALUES + names.index(self.place.parallel)
        self._arrivals = Arrivals(
            new_channels(
                scenario.channel,
                [place.name for place in scenario.relay],
                scenario.scenario.seed,
                only=self.name,
            )
        )
        self._samples_id = Kind.SAMPLED_VALUES + number
        self._recorder = Recorder([])
        self._topic = f"/relay/{self.name}"
        self._latency_ns: list[int] = []
        self._silent = False
        self._sets = 0
        self._frames: list[Frame] = []
        self._made_ns = 0
        """When the first of these was."""
        self._heard_ns = 0
        self._restarts = 0
        self.trips = 0
        before = measured(scenario, quantised(history(scenario)))[number]
        self.relay.warm_up(before[:, :6] if self._beside is None else before)
        self._warm = self.relay.save(), self.relay.events
        self._rehearse()

    def _rehearse(self) -> None:
        """Load the kernels that take what comes from the far end, before the run begins (`node.rehearse`)."""
        node = relay_node(self._scenario, self._number, agreement=self._agreement)
        self._arrivals.poll(0)
        if self._agreement:
            say_first(node.nodes, node.place, *records_of(self.relay), 0)
            give_first(node.nodes, node.place, *records_of(self.relay))
        node.poll(0)
        assert len(node.heard) == len(RelayInputs._fields)

    def begin(self, recorder: Recorder, clock: RunClock) -> None:
        self._recorder = recorder
        self._heard_ns = start_ns = max(clock.now_ns(), 0)
        self.node = relay_node(
            clock.started(self._scenario),
            self._number,
            self._event,
            start_ns=start_ns,
            agreement=self._agreement,
        )
        recorder.add_relay(self.name, self.relay.bits, self.relay.characteristics())

    @property
    def next_ns(self) -> int:
        silence = FOREVER if self._silent else self._heard_ns + SILENT_NS
        made = self._made_ns if self._frames else FOREVER
        return min(made, self.node.next_ns, self._arrivals.next_ns, silence)

    def poll(self, t_ns: int) -> list[Frame]:
        if not self._silent and t_ns >= self._heard_ns + SILENT_NS and self._stream.next_count < self._total:
            self._silent = True
            self._event(t_ns, "warning", f"no sampled values for {SILENT_NS / 1e6:g} ms")
        elif self._stream.next_count >= self._total:
            self._heard_ns = t_ns  # the plant has said all
        for at_ns, frame in self._arrivals.poll(t_ns):
            self._hear(t_ns, at_ns, frame)
        silences = self.node.silences
        frames, self._frames = self._frames + self.node.poll(t_ns), []
        if self.node.silences != silences:
            self._run(t_ns)
            self.relay.inputs = RelayInputs(*self.node.heard)
        return frames

    def receive(self, t_ns: int, frames: list[tuple[int, Frame]]) -> None:
        for at_ns, frame in frames:
            if frame.id == self._samples_id:
                if self._stream.receive(at_ns, frame):
                    self._heard_ns = at_ns
            elif self._beside is not None and frame.id == self._beside_id:
                self._beside.receive(at_ns, frame)
            elif not self._arrivals.takes(at_ns, frame):
                self._hear(t_ns, at_ns, frame)
        self._run(t_ns)

    def _hear(self, t_ns: int, at_ns: int, frame: Frame) -> None:
        if self.node.receive(at_ns, frame):
            self._run(t_ns)  # what came before the inputs changed was measured with the old ones
            self.relay.inputs = RelayInputs(*self.node.heard)
            if self._agreement:
                give_first(self.node.nodes, self.node.place, *records_of(self.relay))

    def _run(self, t_ns: int) -> None:
        taken = self._stream.take()
        for first, rows in taken if self._beside is None else self._beside.join(taken):
            if self._silent:
                self._silent = False
                self._event(t_ns, "info", "sampled values are back")
            if first == 0:
                self.relay.restore(self._warm[0])
                self._tell(t_ns, self._warm[1])
            elif first != self.relay.sample_count:
                self._begin_anew(t_ns, first)
            done = 0
            while done < len(rows):
                m = self.relay.advance(rows[done:])
                self._record(t_ns, rows[done : done + m])
                done += m
            last_ns = self._clock.ns(first + len(rows) - 1)
            self._latency_ns.append(t_ns - last_ns)

    def _begin_anew(self, t_ns: int, first: int) -> None:
        """Empty filters, and no trip: what is not measured any more cannot be held."""
        inputs = self.relay.inputs
        self.relay.restore(self._empty)
        self.relay.inputs = inputs
        self.relay.sample_count = first
        self._restarts += 1
        self._event(t_ns, "warning", f"measures from sample {first} on, with empty filters")

    def _record(self, t_ns: int, rows: np.ndarray) -> None:
        relay = self.relay
        first = relay.sample_count - len(rows)
        self._recorder.block(self.name, self._clock, first, RelayBlock.of(relay, rows[:, :6]))
        self._tell(t_ns, relay.events)
        outputs = relay.outputs
        self.node.set(t_ns, *outputs.masks)
        if outputs.phasors != self._sets:
            self._sets = outputs.phasors
            say_first(self.node.nodes, self.node.place, *records_of(relay), t_ns)
            self._made_ns = self._made_ns if self._frames else t_ns
            self._frames += self.node.poll(t_ns)  # of samples that come in a burst every set is sent
        self.node.measured[:14] = relay.phasors[-1]
        self.node.measured[14] = relay.fault_location

    def _tell(self, t_ns: int, events: list[Any]) -> None:
        for event in events:
            at_ns = self._clock.ns(event.sample_count)
            self._event(at_ns, event.level, event.text)
            if event.trip is not None:
                self.trips += 1
                self._recorder.trip(self.name, at_ns, event.sample_count, event.trip)

    def done(self, t_ns: int) -> bool:
        return t_ns >= self._clock.ns(self._total) and (
            self._stream.next_count >= self._total or self._silent
        )

    def statistics(self, pace: float) -> dict[str, Any]:
        stream = self._stream
        return {
            "samples": stream.next_count,
            "lost": stream.lost,
            "bridged": stream.bridged,
            "rejected": {cause.name: count for cause, count in self.node.rejected.items()}
            | {"SAMPLED_VALUES": stream.rejected},
            "trips": self.trips,
            "location": self.relay.fault_location,
            "latency_ms": asdict(Percentiles.of(self._latency_ns, pace)),
        }

    def _event(self, t_ns: int, level: str, text: str) -> None:
        self._recorder.event(f"{self._topic}/events", t_ns, level, text, self.name)
