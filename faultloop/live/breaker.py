"""The process of a breaker: accepts commands, moves after its time, publishes its position."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from faultloop.io.can.frames import Frame
from faultloop.live.clock import RunClock
from faultloop.loop.outcome import pole_names
from faultloop.loop.recording import Recorder
from faultloop.loop.scenario import Scenario
from faultloop.nodes import FOREVER, Command, breaker_node
from faultloop.nodes.breaker import commands_of
from faultloop.nodes.roster import commanders
from faultloop.plant.elements.switch import Action
from faultloop.plant.mechanism import Pending, commanded


def identifiers(scenario: Scenario, number: int) -> list[int]:
    """What a breaker listens to: the commands of its relays."""
    return [kind + i for kind, i in commands_of(*commanders(scenario, number))]


class BreakerProcess:
    """A breaker whose contacts part `operate_ms` after the command, and make `close_ms` after it.

    Parameters
    ----------
    number : of the breaker in the scenario.
    closed : mask of closed poles as its contacts are: a process that begins anew does not move them.  None:
        as the scenario says.
    """

    def __init__(self, scenario: Scenario, number: int, closed: int | None = None) -> None:
        self.breaker = scenario.breaker[number]
        self.name = self.breaker.name
        self._number = number
        self.scenario = scenario
        self.closed = (7 if self.breaker.closed else 0) if closed is None else closed
        self.node = breaker_node(scenario, number, self.closed, self._report)
        self._motions: Pending = ()
        self._recorder = Recorder([])
        self._end_ns = round(scenario.scenario.duration_s * 1e9)

    def begin(self, recorder: Recorder, clock: RunClock) -> None:
        self._recorder = recorder
        start_ns = max(clock.now_ns(), 0)
        started = clock.started(self.scenario)
        self.node = breaker_node(started, self._number, self.closed, self._report, start_ns=start_ns)
        own = [s for s in self.scenario.switching if s.breaker == self.name]
        planned = [self._motion(round(s.at_s * 1e9), s.operation, s.mask, planned=True) for s in own]
        self._motions = tuple(motion for motion in planned if motion.step >= start_ns)

    def _motion(self, at_ns: int, operation: str, poles: int, *, planned: bool = False) -> Action:
        return Action(at_ns, "part" if operation == "open" else "make", self._number, poles, planned)

    @property
    def next_ns(self) -> int:
        return min(self.node.next_ns, min((motion.step for motion in self._motions), default=FOREVER))

    def poll(self, t_ns: int) -> list[Frame]:
        due = sorted(motion for motion in self._motions if motion.step <= t_ns)
        self._motions = tuple(motion for motion in self._motions if motion.step > t_ns)
        for motion in due:
            parts = motion.kind == "part"
            self.closed = self.closed & ~motion.mask if parts else self.closed | motion.mask
            self.node.set(t_ns, self.closed)
        return self.node.poll(t_ns)

    def receive(self, t_ns: int, frames: Sequence[tuple[int, Frame]]) -> None:
        for at_ns, frame in frames:
            command = self.node.receive(at_ns, frame)
            if command is not None:
                self._obey(command)

    def _obey(self, command: Command) -> None:
        opens = command.operation == "open"
        delay_ms = self.breaker.operate_ms if opens else self.breaker.close_ms
        at_ns = command.t_ns + round(delay_ms * 1e6)
        self._motions = commanded(self._motions, self._motion(at_ns, command.operation, command.poles))
        relay = self.scenario.relay[command.relay].name
        self._recorder.breaker(self.name, command.t_ns, self.closed, command.operation, relay)
        text = f"{command.operation} poles {pole_names(command.poles)} received from {relay}"
        self._report(command.t_ns, "info", text)

    def done(self, t_ns: int) -> bool:
        return t_ns >= self._end_ns

    def statistics(self, pace: float) -> dict[str, Any]:
        return {"rejected": {cause.name: count for cause, count in self.node.rejected.items()}}

    def _report(self, t_ns: int, level: str, text: str) -> None:
        self._recorder.event(f"/breaker/{self.name}/events", t_ns, level, text, self.name)
