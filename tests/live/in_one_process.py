"""The nodes of a scenario as their processes run them, all in this one, over a bus that takes no time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

from faultloop.io.can.frames import Frame
from faultloop.live.attacker import AttackerProcess
from faultloop.live.breaker import BreakerProcess
from faultloop.live.clock import RunClock
from faultloop.live.plant import PlantProcess
from faultloop.live.relay import RelayProcess
from faultloop.live.transmit_queue import TransmitQueue
from faultloop.loop.recording import MemorySink, Recorder
from faultloop.loop.scenario import Scenario
from faultloop.nodes import FOREVER
from faultloop.nodes.attacker import attacker_nodes

Decision = tuple[str, str, int, str, int, int]
"""Relay, function, zone, loop, poles, sample."""


@dataclass(frozen=True, slots=True)
class StandingClock(RunClock):
    """Shows one instant."""

    t_ns: int = 0

    def now_ns(self) -> int:
        return self.t_ns


class _Told(MemorySink):
    def __init__(self) -> None:
        super().__init__()
        self.trips: list[Decision] = []
        self.events: list[str] = []

    def message(self, topic: str, t_ns: int, message_name: str, **fields: Any) -> None:
        f, name = SimpleNamespace(**fields), topic.split("/")[2]
        if message_name == "Trip":
            self.trips.append((name, f.function, f.zone, f.loop, f.poles, f.sample_count))
        elif message_name == "foxglove.Log":
            self.events.append(f"{t_ns / 1e6:.1f} {name} {f.message}")


class _Wire:
    """What has been sent since."""

    def __init__(self) -> None:
        self.frames: list[Frame] = []

    def send(self, frame: Frame) -> bool:
        self.frames.append(frame)
        return True


class OneProcess:
    """Runs a scenario; the frames of each node go through its faults.

    Parameters
    ----------
    away : nodes that are killed, and when they start anew [ns].

    Attributes
    ----------
    trips : what was decided.
    events : with their times [ms] and nodes.
    relays : by name, those that are there at the end.
    """

    def __init__(self, scenario: Scenario, away: Mapping[str, tuple[int, int]] | None = None) -> None:
        self._scenario, self._away = scenario, dict(away or {})
        self._told = _Told()
        self._wire = _Wire()
        self._plant = PlantProcess(scenario)
        count = len(attacker_nodes(scenario))
        self._nodes: dict[str, Any] = {"plant": self._plant}
        self._nodes |= {place.name: RelayProcess(scenario, i) for i, place in enumerate(scenario.relay)}
        self._nodes |= {b.name: BreakerProcess(scenario, i) for i, b in enumerate(scenario.breaker)}
        attackers = [AttackerProcess(scenario, i) for i in range(count)]
        self._nodes |= {attacker.name: attacker for attacker in attackers}
        self._ways = {name: TransmitQueue(self._wire, scenario, name) for name in self._nodes}  # type: ignore[arg-type]

    def run(self) -> list[Decision]:
        """What was decided, in order."""
        for node in self._nodes.values():
            node.begin(Recorder([self._told]), StandingClock(0, self._start_ns))
        while not self._plant.node.done:
            t_ns = self._next_ns()
            assert t_ns < FOREVER
            self._kill(t_ns)
            for name, node in self._nodes.items():
                if node.next_ns <= t_ns:
                    for frame in node.poll(t_ns):
                        self._ways[name].send(t_ns, frame)
                self._ways[name].release(t_ns)
            sent, self._wire.frames = [(t_ns, frame) for frame in self._wire.frames], []
            for name, node in self._nodes.items():
                if sent and not self._ways[name].silent(t_ns):
                    node.receive(t_ns, sent)
        return self.trips

    @property
    def trips(self) -> list[Decision]:
        return sorted(self._told.trips)

    @property
    def events(self) -> list[str]:
        return self._told.events

    @property
    def relays(self) -> dict[str, RelayProcess]:
        return {name: node for name, node in self._nodes.items() if isinstance(node, RelayProcess)}

    @property
    def hits(self) -> dict[str, int]:
        """Frames hit, by the fault."""
        found: dict[str, int] = {}
        for way in self._ways.values():
            for name, count in way.hits.items():
                found[name] = found.get(name, 0) + count
        return found

    @property
    def _start_ns(self) -> int:
        return self._scenario.scenario.start_ns

    def _next_ns(self) -> int:
        due = [node.next_ns for node in self._nodes.values()]
        due += [way.next_ns for way in self._ways.values()]
        return min(due + [t_ns for times in self._away.values() for t_ns in times])

    def _kill(self, t_ns: int) -> None:
        """Who is killed is not there; who starts anew remembers nothing."""
        for name, (gone_ns, back_ns) in list(self._away.items()):
            if name in self._nodes and gone_ns <= t_ns < back_ns:
                del self._nodes[name]
                self._away[name] = (FOREVER, back_ns)
            elif name not in self._nodes and t_ns >= back_ns:
                del self._away[name]
                self._nodes[name] = self._anew(name)
                self._nodes[name].begin(Recorder([self._told]), StandingClock(0, self._start_ns, 1.0, t_ns))

    def _anew(self, name: str) -> Any:
        relays = [place.name for place in self._scenario.relay]
        if name in relays:
            return RelayProcess(self._scenario, relays.index(name))
        return BreakerProcess(self._scenario, [b.name for b in self._scenario.breaker].index(name))
