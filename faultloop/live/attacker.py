"""The process of a node that should not be there."""

from __future__ import annotations

from typing import Any

from faultloop.io.can.frames import Frame
from faultloop.live.clock import RunClock
from faultloop.loop.recording import Recorder
from faultloop.loop.scenario import Scenario
from faultloop.nodes.attacker import Attacker, ForgingNode, attacker_nodes


def identifiers(scenario: Scenario, number: int) -> list[int]:
    """What it listens to: a forger, its victim."""
    node = attacker_nodes(scenario)[number]
    return [node.identifier] if isinstance(node, ForgingNode) else []


class AttackerProcess:
    """A babbling or a forging node.

    Parameters
    ----------
    number : of the fault, among those that are nodes of their own.
    """

    def __init__(self, scenario: Scenario, number: int) -> None:
        self._scenario, self._number = scenario, number
        self.node: Attacker = attacker_nodes(scenario)[number]
        self.name = self.node.name

    def begin(self, recorder: Recorder, clock: RunClock) -> None:
        self.node = attacker_nodes(clock.started(self._scenario))[self._number]

    @property
    def next_ns(self) -> int:
        return self.node.next_ns

    def poll(self, t_ns: int) -> list[Frame]:
        return self.node.poll(t_ns)

    def receive(self, t_ns: int, frames: list[tuple[int, Frame]]) -> None:
        for at_ns, frame in frames:
            self.node.receive(at_ns, frame)

    def done(self, t_ns: int) -> bool:
        return False  # its supervisor ends it

    def statistics(self, pace: float) -> dict[str, Any]:
        return {"offered": self.node.sent}
