"""The closed loop: one clock, plant, relays, bus, breakers, recorder.

Causality is exact: no frame acts before it has arrived. Plant and relays run ahead in blocks (`ahead`), which
end at the first sample at which anything changed that another part can hear of: a relay's output, a breaker's
pole, a fault. So Python is paid per change and not per sample, and the result is the same, bit for bit, as
sample by sample.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterable, Mapping
from typing import Any

import numpy as np

from faultloop.config.bus_fault import BusFault
from faultloop.errors import InputError, nearest
from faultloop.io.can.frames import Frame
from faultloop.io.can.senders import Senders
from faultloop.io.can.table import Kind
from faultloop.io.can.transport import Transport
from faultloop.loop.ahead import Ahead
from faultloop.loop.bus_faults import Edge, Edges, counted, end_ns, without_effect
from faultloop.loop.bus_faults import describe as describe_fault
from faultloop.loop.outcome import pole_names
from faultloop.loop.pacing import Deadlines
from faultloop.loop.recording import PLANT_EVENTS, Recorder
from faultloop.loop.scenario import Scenario
from faultloop.nodes import (
    FOREVER,
    BreakerFollower,
    BreakerNode,
    Command,
    Movement,
    RelayNode,
    Report,
    breaker_follower,
    breaker_node,
    relay_node,
    with_followed_breakers,
)
from faultloop.nodes.attacker import attacker_nodes
from faultloop.nodes.clock import SampleClock
from faultloop.plant import Plant
from faultloop.relay import Event, Relay, RelayInputs

BLOCK = 240
"""Samples that plant and relays run ahead at most."""

CAN_EVENTS = "/can/events"


class Simulation:
    """One run of a scenario.

    Parameters
    ----------
    scenario : validated.
    relays : the relays, in the order of `scenario.relay`.
    recorder : gets everything.
    bus : carries the frames.
    pace : simulated seconds per second of wall time; None runs as fast as it can.
    without : breakers that are not simulated: the plant follows the status that somebody else on the bus
        publishes for them.
    warm_up : runs a relay over the samples before sample 0.
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
        warm_up: Callable[[Relay, np.ndarray], None] = Relay.warm_up,
    ) -> None:
        self.scenario = scenario
        self._warm_up = warm_up
        left_out = _breakers_left_out(scenario, without)
        self.plant = Plant(with_followed_breakers(scenario, left_out))
        self.relays = [relays[place.name] for place in scenario.relay]
        self.recorder = recorder
        self.bus = bus
        self.clock = SampleClock(self.plant.sampling_hz)
        self.total = self.clock.first_from(round(scenario.scenario.duration_s * 1e9))
        self._ahead = Ahead(self.plant, self.relays)
        self._breaker_names = [b.name for b in scenario.breaker]
        self._relay_nodes = [self._relay_node(i) for i in range(len(scenario.relay))]
        numbers = range(len(scenario.breaker))
        self._breaker_nodes = {
            i: self._breaker_node(i) for i in numbers if self._breaker_names[i] not in left_out
        }
        self._followers = {i: self._follower(i) for i in numbers if self._breaker_names[i] in left_out}
        self._relay_names = [place.name for place in scenario.relay]
        self._names = (*self._relay_names, *(self._breaker_names[i] for i in self._breaker_nodes))
        self._attackers = attacker_nodes(scenario)
        self._senders = Senders(bus, scenario.scenario.seed, scenario.bus_fault, self._names)
        self._edges = Edges(scenario.bus_fault)
        self._deaf: frozenset[str] = frozenset()  # off the bus
        self._away: frozenset[str] = frozenset()  # restarting
        self._cold: list[Any] = []  # the relays' states before anything was measured
        self._seat()
        self.deadlines = Deadlines(self.clock.ns(1))
        """Of the blocks, in a run that is paced."""
        self.interrupted = False
        self._pace = pace
        # In real time a block must not keep anybody waiting; in simulated time it may be long.
        self._block = BLOCK if pace is None else max(1, self.clock.sampling_hz // 1000)

    # -- who is on the bus ----------------------------------------------------------------------------------

    def _relay_node(self, number: int, start_ns: int = 0) -> RelayNode:
        name = self.scenario.relay[number].name
        report = self._reports_of(name, f"/relay/{name}/events")
        return relay_node(self.scenario, number, report, start_ns=start_ns)

    def _breaker_node(self, number: int, start_ns: int = 0) -> BreakerNode:
        name = self._breaker_names[number]
        closed, report = self.plant.closed(name), self._reports_of(name, f"/breaker/{name}/events")
        return breaker_node(self.scenario, number, closed, report, start_ns=start_ns)

    def _follower(self, number: int) -> BreakerFollower:
        name = self._breaker_names[number]
        report = self._reports_of(name, f"/breaker/{name}/events")
        return breaker_follower(self.scenario, number, self.plant.closed(name), report)

    def _reports_of(self, name: str, topic: str) -> Report:
        def report(t_ns: int, level: str, text: str) -> None:
            self._event(t_ns, name, level, text, topic)

        return report

    def _seat(self) -> None:
        """Who is asked for frames, and by which way they go."""
        nodes = (*self._relay_nodes, *self._breaker_nodes.values())
        own = [
            (node, name, self._senders.send)
            for node, name in zip(nodes, self._names, strict=True)
            if name not in self._away
        ]
        self._seats = (
            *own,
            *((attacker, attacker.name, self._senders.send_one) for attacker in self._attackers),
        )

    # -- the clock ------------------------------------------------------------------------------------------

    def run(self, progress: Callable[[float], None] | None = None) -> None:
        """From the first sample to the last."""
        self._begin()
        started = time.monotonic()
        k = 0
        while k < self.total and not self.interrupted:
            self._serve_bus(self.clock.ns(k))
            k += self._advance(k)
            if progress is not None:
                progress(k / self.total)
            if self._pace is not None:
                self._keep_time(self.clock.ns(k), started, self._pace)
        self._serve_bus(self.clock.ns(k))
        self.simulated_ns = self.clock.ns(k)
        for fault in self.scenario.bus_fault:
            if end_ns(fault) > self.simulated_ns:
                self._tell(self.simulated_ns, fault, "still there at the end of the run")

    def _keep_time(self, t_ns: int, started: float, pace: float) -> None:
        """Sleep until `t_ns`; note how late it has become."""
        ahead_s = t_ns / 1e9 / pace - (time.monotonic() - started)
        if ahead_s > 0:
            time.sleep(ahead_s)
        self.deadlines.note(t_ns, round((time.monotonic() - started) * pace * 1e9))

    def _begin(self) -> None:
        before = self.plant.history(self.clock.sampling_hz)  # a second: whole cycles at any nominal frequency
        for i, (place, relay) in enumerate(zip(self.scenario.relay, self.relays, strict=True)):
            self.recorder.add_relay(place.name, relay.bits, relay.characteristics())
            self._cold.append(relay.save())
            self._warm_up(relay, before[:, i])
        for note in self.plant.notes:
            self._event(0, "plant", "info", note, PLANT_EVENTS)
        for name in self._breaker_names:
            self.recorder.breaker(name, 0, self.plant.closed(name))
        for i, relay in enumerate(self.relays):
            self._record_events(i, relay.events)
            self._set(i, 0, relay.phasors[-1])

    def _next_ns(self) -> int:
        """When something on the bus may act or must be sent; no piece may pass it."""
        acting = self.bus.next_event_ns() if self._acting_frame_pending() else None
        due = min(self._next_poll_ns(), self._senders.next_ns, self._edges.next_ns)
        return due if acting is None else min(acting, due)

    def _acting_frame_pending(self) -> bool:
        """Measurements and heartbeats act on nobody: they need not be waited for."""
        return any(frame.id < Kind.SAMPLED_VALUES for frame in self.bus.pending())

    def _until(self, t_ns: int, k: int) -> int:
        """Samples from `k` on that are before `t_ns`: at least one, at most a block, none after the run."""
        n = min(self._block, self.total - k)
        return n if t_ns >= self.clock.ns(k + n) else max(1, self.clock.first_from(t_ns) - k)

    # -- one piece ------------------------------------------------------------------------------------------

    def _advance(self, k: int) -> int:
        """Run plant and relays from sample `k` to what is next on the bus; returns how many samples.

        What a relay measures is shown as it is at the end of a block: none passes the next showing.
        """
        shown_ns = min((node.shown_ns for node in self._relay_nodes), default=FOREVER)
        piece = self._ahead.take(self._until(self._next_ns(), k), self._until(shown_ns, k))
        for i, (block, _) in piece.relays.items():
            self.recorder.block(self._relay_names[i], self.clock, piece.first, block)
        if piece.ends:
            self._record_plant(self.clock.ns(k + piece.length - 1))
        for i, (block, events) in piece.relays.items():
            self._record_events(i, events)
            if piece.ends:
                self._set(i, self.clock.ns(k + piece.length - 1), block.phasors[-1])
        return piece.length

    def _record_plant(self, t_ns: int) -> None:
        """Poles and faults that the block, which ends at `t_ns`, changed.

        A breaker's node scans its contacts once a sample, so its frame is of the sample after the change.
        """
        for change in self.plant.changes:
            if change.kind == "pole":
                self.recorder.breaker(self._breaker_names[change.index], change.t_ns, change.value)
                if change.index in self._breaker_nodes:
                    self._breaker_nodes[change.index].set(t_ns, change.value)
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
        relay, node = self.relays[number], self._relay_nodes[number]
        outputs = relay.outputs
        node.set(t_ns, outputs.trip_poles, outputs.close_poles, outputs.pilot)
        node.measured[:14] = phasors
        node.measured[14] = relay.fault_location

    def _event(self, t_ns: int, source: str, level: str, text: str, topic: str) -> None:
        self.recorder.event(topic, t_ns, level, text, source)

    # -- the bus --------------------------------------------------------------------------------------------

    def _next_poll_ns(self) -> int:
        return min((node.next_ns for node, _, _ in self._seats), default=FOREVER)

    def _serve_bus(self, t_ns: int) -> None:
        """Send what is due and deliver what arrives, in order of time, up to and including `t_ns`."""
        while True:
            arrival = self.bus.next_event_ns()
            own = min(self._next_poll_ns(), self._senders.next_ns, self._edges.next_ns)
            now = min(own, FOREVER if arrival is None else arrival)
            if now > t_ns:
                break
            self._deliver(now)
            for edge in self._edges.due(now):
                self._turn(edge)
            self._senders.release(now)
            for node, name, send in self._seats:
                for frame in node.poll(now):
                    send(now, frame, name)
        self._deliver(t_ns)

    def _deliver(self, until_ns: int) -> None:
        received = self.bus.advance(until_ns)
        for change in self.bus.controller_changes():
            self._event(change.t_ns, str(change.sender), "warning", f"is {change.state}", CAN_EVENTS)
        deaf = self._deaf | self.bus.bus_off(until_ns)  # no frame is received earlier, see `_serve_bus`
        for t_ns, frame, sender in received:
            direction = "tx" if sender in self._names else "rx"
            self.recorder.can_frame(t_ns, frame, direction, str(sender or ""))
            for name, node, relay in zip(self._relay_names, self._relay_nodes, self.relays, strict=True):
                if name not in deaf and node.receive(t_ns, frame):
                    inputs = RelayInputs(node.breaker_closed, node.pilot_received)
                    if inputs != relay.inputs:
                        self._ahead.settle()
                        relay.inputs = inputs
            for attacker in self._attackers:
                attacker.receive(t_ns, frame)
            for number, node in self._breaker_nodes.items():
                if self._breaker_names[number] in deaf:
                    continue
                command = node.receive(t_ns, frame)
                if command is not None:
                    self._obey(number, command)
            if self._followers:
                self._follow(t_ns, frame)

    def _obey(self, number: int, command: Command) -> None:
        """A breaker acts on an accepted command; this is the time that a trip's report states."""
        name = self._breaker_names[number]
        self._ahead.settle()
        self.plant.command(name, command.operation, command.poles, command.t_ns)
        relay = self.scenario.relay[command.relay].name
        self.recorder.breaker(name, command.t_ns, self.plant.closed(name), command.operation, relay)
        text = f"{command.operation} poles {pole_names(command.poles)} received from {relay}"
        self._event(command.t_ns, name, "info", text, f"/breaker/{name}/events")

    # -- faults on the bus ----------------------------------------------------------------------------------

    def _turn(self, edge: Edge) -> None:
        """A fault begins or ends: who is off the bus, who goes and who comes back."""
        t_ns, fault = edge.t_ns, edge.fault
        self._tell(t_ns, fault, "begins" if edge.begins else "is over")
        self._deaf = frozenset(name for name in self._names if self._senders.silent(name, t_ns))
        if fault.kind != "restart" or fault.node not in self._names:
            return
        self._ahead.settle()
        if edge.begins:
            self._away |= {fault.node}
        else:
            self._away -= {fault.node}
            self._rejoin(t_ns, fault.node)
        self._ahead.run_only([i for i, name in enumerate(self._relay_names) if name not in self._away])
        self._seat()

    def _tell(self, t_ns: int, fault: BusFault, what: str) -> None:
        hits = f", {self._senders.hits[fault.name]} frames hit" if counted(fault) and what != "begins" else ""
        what += " and has no effect: samples go by no frames" if without_effect(fault) else hits
        self._event(t_ns, fault.name, "warning", f"{describe_fault(fault)} {what}", CAN_EVENTS)

    def _rejoin(self, t_ns: int, name: str) -> None:
        """A node starts anew and remembers nothing; a relay cold, a breaker with its poles as they are."""
        if name not in self._relay_names:
            number = self._breaker_names.index(name)
            self._breaker_nodes[number] = self._breaker_node(number, t_ns)
            return
        number = self._relay_names.index(name)
        self._relay_nodes[number] = self._relay_node(number, t_ns)
        self.relays[number].restore(self._cold[number])
        self.relays[number].sample_count = self.clock.first_from(t_ns)

    # -- breakers that are somebody else's ------------------------------------------------------------------

    def _follow(self, t_ns: int, frame: Frame) -> None:
        """Their status moves the plant."""
        for number, follower in self._followers.items():
            for movement in follower.receive(t_ns, frame):
                self._move(t_ns, number, movement)

    def _move(self, t_ns: int, number: int, movement: Movement) -> None:
        name = self._breaker_names[number]
        self._ahead.settle()
        self.plant.command(name, movement.operation, movement.poles, t_ns)
        text = f"status {movement.operation}, poles {pole_names(movement.poles)}"
        self._event(t_ns, name, "info", text, f"/breaker/{name}/events")


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
