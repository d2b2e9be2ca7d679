"""The process of the plant."""

from __future__ import annotations

from dataclasses import asdict
from math import gcd
from typing import Any

from faultloop.io.can.frames import Frame
from faultloop.io.can.table import Kind
from faultloop.live.clock import RunClock
from faultloop.loop.pacing import Deadlines, Percentiles
from faultloop.loop.recording import PLANT_EVENTS, Recorder
from faultloop.loop.scenario import Scenario
from faultloop.nodes.clock import SECOND_NS, SampleClock
from faultloop.nodes.plant import PlantNode

LATE_NS = SECOND_NS // 10
"""A plant that begins later than this after time zero joins a run that has begun."""


def identifiers(scenario: Scenario) -> list[int]:
    """What the plant listens to: the breakers' positions."""
    return [Kind.BREAKER_STATUS + i for i in range(len(scenario.breaker))]


class PlantProcess:
    """Publishes the samples at their times; logs poles and faults, the truth.

    A plant that begins in a run that has begun takes part from a whole cycle on: there the waves of
    every source whose frequency is the system's are where they were at time zero.
    """

    def __init__(self, scenario: Scenario) -> None:
        self.name = "plant"
        self.scenario = scenario
        self.node = PlantNode(scenario, 0, self._report, self._changed)
        self._recorder = Recorder([])
        self._deadlines = Deadlines(SampleClock(scenario.system.sampling_hz).ns(1))
        self._cycle = scenario.system.sampling_hz // gcd(
            scenario.system.sampling_hz, scenario.system.frequency_hz
        )

    def begin(self, recorder: Recorder, clock: RunClock) -> None:
        self._recorder = recorder
        self.scenario = clock.started(self.scenario)
        now_ns = clock.now_ns()
        if now_ns > LATE_NS:
            self._join(now_ns)
        else:
            self.node.attend(self.scenario, max(now_ns, 0))
        for note in self.node.plant.notes:
            recorder.event(PLANT_EVENTS, 0, "info", note, "plant")
        for number, breaker in enumerate(self.scenario.breaker):
            self._record_poles(0, number, self.node.plant.closed(breaker.name))

    @property
    def next_ns(self) -> int:
        return self.node.next_ns

    def poll(self, t_ns: int) -> list[Frame]:
        node = self.node
        before = node.sample_count
        frames = node.poll(t_ns)
        for count in range(before, node.sample_count):
            self._deadlines.note(node.sample_ns(count), t_ns)
        return frames

    def _join(self, t_ns: int) -> None:
        """Begin at the next whole cycle that leaves time to build the network anew."""
        hz = self.scenario.system.sampling_hz
        soon = SampleClock(hz).first_from(t_ns + SECOND_NS // 4)
        first = -(-soon // self._cycle) * self._cycle
        self.node = PlantNode(self.scenario, first, self._report, self._changed)
        at_ns = self.node.sample_ns(first)
        self._recorder.event(PLANT_EVENTS, at_ns, "warning", f"joins at sample {first}", "plant")

    def receive(self, t_ns: int, frames: list[tuple[int, Frame]]) -> None:
        for at_ns, frame in frames:
            self.node.receive(at_ns, frame)

    def done(self, t_ns: int) -> bool:
        return self.node.done

    def statistics(self, pace: float) -> dict[str, Any]:
        late = self._deadlines
        return {
            "samples": len(late.late_ns),
            "deadlines_missed": late.missed,
            "jitter_ms": asdict(Percentiles.of(late.late_ns, pace)),
        }

    def _report(self, t_ns: int, level: str, text: str) -> None:
        self._recorder.event(PLANT_EVENTS, t_ns, level, text, "plant")

    def _changed(self, t_ns: int, kind: str, number: int, value: int) -> None:
        if kind == "pole":
            self._record_poles(t_ns, number, value)
            return
        fault = self.scenario.fault[number]
        self._recorder.fault(t_ns, number, fault.name, fault.type, bool(value))

    def _record_poles(self, t_ns: int, number: int, closed: int) -> None:
        self._recorder.breaker(self.scenario.breaker[number].name, t_ns, closed)
