"""The nodes of a run and their bus: drives the compiled `exchange`, and does what cannot be compiled.

Keys, faults on the bus, attackers, breakers that are somebody else's devices, a bus with others on it: Python
has a part in them, between two steps of the same kernels.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Protocol

import numpy as np

from faultloop.config.bus_fault import PLANT, BusFault
from faultloop.io.can.confinement import STATES
from faultloop.io.can.frames import REJECTIONS, Frame
from faultloop.io.can.record import delivered, put
from faultloop.io.can.senders import Senders
from faultloop.io.can.table import PLANT_NODE, Kind
from faultloop.io.can.transport import Transport
from faultloop.loop import exchange
from faultloop.loop.bus_faults import Edge, Edges, counted, end_ns, without_effect
from faultloop.loop.bus_faults import describe as describe_fault
from faultloop.loop.recording import PLANT_EVENTS, Recorder
from faultloop.loop.scenario import Scenario
from faultloop.nodes import (
    BreakerNode,
    Command,
    Movement,
    RelayNode,
    Report,
    TimeMaster,
    breaker_follower,
    breaker_node,
    relay_node,
    time_master,
)
from faultloop.nodes.attacker import attacker_nodes
from faultloop.nodes.channel import Channels, new_channels
from faultloop.nodes.node import joined, replaced
from faultloop.nodes.tables import BusTables

CAN_EVENTS = "/can/events"
OF_BUS = tuple(sorted({*BusTables.model_fields, "breaker"} - {"scenario", "bus_fault"}))
"""Tables of a scenario that nodes and bus are made from."""


def is_same_bus(a: Scenario, b: Scenario) -> bool:
    """Whether the nodes and the bus of both begin alike, and everything of them is compiled."""
    if a.bus_fault or b.bus_fault or a.keys_path is not None or b.keys_path is not None:
        return False
    if a.scenario.seed != b.scenario.seed:
        return False
    return all(getattr(a, key) == getattr(b, key) for key in OF_BUS)


class Acts(Protocol):
    """What is done to plant and relays by what comes from the bus."""

    def obey(self, breaker: int, command: Command, closed: int) -> None:
        """A breaker's node has accepted a command, with these poles closed; the plant has it already."""
        ...

    def move(self, breaker: int, t_ns: int, movement: Movement) -> None:
        """A breaker that is somebody else's says that its poles have moved."""
        ...

    def restart(self, relay: int, t_ns: int, *, begins: bool) -> None:
        """A relay goes, or is back and remembers nothing."""
        ...

    def agreement(self, relay: int) -> int:
        """Hash of what the ends of a relay's line differential must have alike; 0 without one."""
        ...

    def closed(self, breaker: int) -> int:
        """Mask of the poles that conduct."""
        ...

    def changed(self, kind: str, index: int, t_ns: int, value: int) -> None:
        """A pole or a fault of the plant has."""
        ...


class Traffic:
    """Who is on the bus, and what goes over it.

    Parameters
    ----------
    scenario : relays and breakers are numbered in its order.
    bus : carries the frames.
    recorder : told of frames and of what a person reads.
    acts : plant and relays.
    left_out : names of the breakers that are somebody else's.
    """

    def __init__(
        self,
        scenario: Scenario,
        bus: Transport,
        recorder: Recorder,
        acts: Acts,
        left_out: Collection[str],
    ) -> None:
        self.scenario, self.bus, self.recorder = scenario, bus, recorder
        self._acts = acts
        breakers = [i for i, breaker in enumerate(scenario.breaker) if breaker.name not in left_out]
        self.relays = [self._relay_node(i) for i in range(len(scenario.relay))]
        self.breakers = {i: self._breaker_node(i, 0) for i in breakers}
        self._followers = {
            i: breaker_follower(scenario, i, acts.closed(i), self._report_of("breaker", breaker.name))
            for i, breaker in enumerate(scenario.breaker)
            if breaker.name in left_out
        }
        self._seats: list[RelayNode | BreakerNode | TimeMaster] = [*self.relays, *self.breakers.values()]
        self._numbers = [*range(len(self.relays)), *breakers]
        """Of each seat's relay or breaker."""
        self._names = [place.name for place in scenario.relay]
        self._names += [scenario.breaker[i].name for i in breakers]
        master = self._time_master(0)
        if master is not None:
            self._seats.append(master)
            self._numbers.append(PLANT_NODE)
            self._names.append(PLANT)
        self._attackers = attacker_nodes(scenario)
        self._senders = Senders(bus, scenario.scenario.seed, scenario.bus_fault, self._names)
        self._edges = Edges(scenario.bus_fault)
        self._remembered, self._new = list[np.ndarray](), list[np.ndarray]()
        self._sealed = scenario.keys_path is not None
        self.seats = {number: len(self.relays) + k for k, number in enumerate(self.breakers)}
        """The place of each breaker's node."""
        self.x = exchange.new_exchange(joined(self._seats), bus.model.state, self._channels())
        self._control = self.x.control[0]
        self._control["quiet"] = recorder.counts is not None
        self._control["sends"] = self._sealed or bool(scenario.bus_fault)
        alone = bus.bus is None
        self._control["hears"] = (
            2 if not alone else int(self._sealed or bool(self._attackers) or bool(self._followers))
        )
        for seat, name, node in zip(self.x.seats, self._names, self._seats, strict=True):
            seat["sender"], seat["breaker"] = bus.model.number_of(name), isinstance(node, BreakerNode)
        self.x.seats["number"] = self._numbers
        self._renew()

    def keep(self) -> None:
        """To `begin_again` from the state that it has now."""
        self._remembered, self._kept_bus = exchange.remembered(self.x), self.x.bus
        self._new = self.save()

    def begin_again(
        self, scenario: Scenario, recorder: Recorder, state: Sequence[np.ndarray] | None = None
    ) -> None:
        """As a new one of `scenario`, which has the same bus (`is_same_bus`), or from what `save` gave."""
        self.scenario, self.recorder = scenario, recorder
        self.bus.model.begin_again(self._kept_bus)
        self.x = self.x._replace(bus=self._kept_bus)
        for array, kept in zip(self._remembered, state or self._new, strict=True):
            array[:] = kept
        self._control["quiet"] = recorder.counts is not None
        for seat in self._seats:
            seat.refusals.clear()

    def save(self) -> list[np.ndarray]:
        """A copy of everything that changes, of one that is quiet."""
        return [array.copy() for array in self._remembered]

    @property
    def is_quiet(self) -> bool:
        """Whether nodes and bus have what they began with, and nothing has been refused."""
        return self.x.bus is self._kept_bus and not any(seat.refusals.causes for seat in self._seats)

    def _channels(self) -> Channels:
        names = [place.name for place in self.scenario.relay]
        return new_channels(self.scenario.channel, names, self.scenario.scenario.seed)

    def _relay_node(self, number: int, start_ns: int = 0) -> RelayNode:
        report = self._report_of("relay", self.scenario.relay[number].name)
        agreement = self._acts.agreement(number)
        return relay_node(self.scenario, number, report, start_ns=start_ns, agreement=agreement)

    def _time_master(self, start_ns: int) -> TimeMaster | None:
        def report(t_ns: int, level: str, text: str) -> None:
            self.recorder.event(PLANT_EVENTS, t_ns, level, text, PLANT)

        return time_master(self.scenario, report, start_ns=start_ns)

    def _breaker_node(self, number: int, start_ns: int) -> BreakerNode:
        report = self._report_of("breaker", self.scenario.breaker[number].name)
        closed = self._acts.closed(number)
        return breaker_node(self.scenario, number, closed, report, start_ns=start_ns)

    def _report_of(self, kind: str, name: str) -> Report:
        def report(t_ns: int, level: str, text: str) -> None:
            self.recorder.event(f"/{kind}/{name}/events", t_ns, level, text, name)

        return report

    # -- time passes ----------------------------------------------------------------------------------------

    def answer(self, code: int) -> None:
        """Do what the exchange has stopped for; what it has told before was taken."""
        if code == exchange.FAULT_OF_WIRE:
            self.bus.model.answer()
            return
        now_ns = int(self._control["now_ns"])
        if code == exchange.RECEIVED:
            self._receive(now_ns)
        elif code == exchange.DUE:
            self._turn(now_ns)
        elif code == exchange.OFFERED:
            self._send(now_ns)
        self._renew()

    def _renew(self) -> None:
        """What Python has done may be due earlier, and the bus may have more room."""
        due = [self._senders.next_ns, self._edges.next_ns, *(a.next_ns for a in self._attackers)]
        self._control["python_ns"] = min(due)
        self.bus.model.reserve(len(self.x.offers))
        self.x = self.x._replace(bus=self.bus.model.state)

    def _send(self, t_ns: int) -> None:
        x, control = self.x, self._control
        for k in range(control["offered"]):
            seat = int(x.offered_by[k])
            frame = self._seats[seat].wired(t_ns, x.offers, k)
            self._senders.send(t_ns, frame, self._names[seat])
        control["offered"] = 0
        for attacker in self._attackers:
            for frame in attacker.poll(t_ns):
                self._senders.send_one(t_ns, frame, attacker.name)

    def _receive(self, now_ns: int) -> None:
        """What was received goes to the nodes, and to whom only Python knows."""
        x = self.x
        scratch = x.scratch[0]
        for t_ns, frame, sender in self.bus.shared(self.bus.model.received()):
            put(scratch, 0, frame)
            scratch["t_ns"], scratch["sender"] = t_ns, self.bus.model.number_of(sender)
            if self._sealed:
                for seat, node in enumerate(self._seats):
                    if not self._is_deaf(seat, now_ns):
                        x.seats["objection"][seat], plain = node.opened(t_ns, frame)
                        put(x.plain, seat, plain)
            exchange.hear(x, scratch[0], self._sealed)
            for attacker in self._attackers:
                attacker.receive(t_ns, frame)
            for number, follower in self._followers.items():
                for movement in follower.receive(t_ns, frame):
                    self._acts.move(number, t_ns, movement)

    def _is_deaf(self, seat: int, t_ns: int) -> bool:
        return bool(self.x.seats["deaf"][seat]) or self._names[seat] in self.bus.bus_off(t_ns)

    # -- what there is to tell ------------------------------------------------------------------------------

    def events(self) -> list[tuple[int, ...]]:
        """What has happened since, each to be handed to `tell` before anything else does; it begins with the
        number of the sample that it was before, or in whose interval."""
        count = int(self._control["events"])
        self._control["events"] = self._control["frames"] = 0
        return self.x.events[:count].tolist()

    def tell(self, event: tuple[int, ...]) -> None:
        """Of one of the events."""
        _, t_ns, what, node, identifier, value, closed = event
        if what == exchange.FRAME_SEEN:
            _, number, fields = delivered(self.x.frames, value)
            sender = self.bus.model.sender(number)
            direction = "tx" if sender in self._names else "rx"
            self.recorder.can_frame(t_ns, Frame(*fields), direction, str(sender or ""))
        elif what == exchange.STATE_TAKEN:
            if value and isinstance(self._seats[node], BreakerNode):
                operation = "close" if identifier & ~0xF == Kind.CLOSE else "open"
                command = Command(t_ns, operation, value, identifier & 0xF)
                self._acts.obey(self._numbers[node], command, closed)
        elif what == exchange.REFUSED:
            self._seats[node].refusals.add(t_ns, identifier, REJECTIONS[value - 1])
        elif what == exchange.BEAT:
            self._seats[node].refusals.beat(t_ns)
        elif what == exchange.CONTROLLER:
            sender = self.bus.model.sender(node)
            self.recorder.event(CAN_EVENTS, t_ns, "warning", f"is {STATES[value]}", str(sender))
        elif what != exchange.SILENCE:
            self._acts.changed("pole" if what == exchange.POLES_CHANGED else "fault", node, t_ns, value)

    # -- faults on the bus ----------------------------------------------------------------------------------

    def _turn(self, t_ns: int) -> None:
        """Faults begin or end, and late frames go to the bus."""
        for edge in self._edges.due(t_ns):
            self._turned(edge)
        self._senders.release(t_ns)

    def _turned(self, edge: Edge) -> None:
        t_ns, fault = edge.t_ns, edge.fault
        self._tell(t_ns, fault, "begins" if edge.begins else "is over")
        for seat, name in enumerate(self._names):
            self.x.seats["deaf"][seat] = self._senders.silent(name, t_ns)
        if fault.kind != "restart" or fault.node not in self._names:
            return
        seat = self._names.index(fault.node)
        number, node = self._numbers[seat], self._seats[seat]
        self.x.seats["away"][seat] = edge.begins
        if isinstance(node, RelayNode):
            self._acts.restart(number, t_ns, begins=edge.begins)
        if not edge.begins:
            self._rejoin(t_ns, seat)

    def _rejoin(self, t_ns: int, seat: int) -> None:
        """A node starts anew and remembers nothing; a breaker's poles are as they are."""
        number = self._numbers[seat]
        node: RelayNode | BreakerNode | TimeMaster | None
        if isinstance(self._seats[seat], RelayNode):
            node = self.relays[number] = self._relay_node(number, t_ns)
        elif isinstance(self._seats[seat], TimeMaster):
            node = self._time_master(t_ns)
            assert node is not None
        else:
            node = self.breakers[number] = self._breaker_node(number, t_ns)
        self._seats[seat] = node
        replaced(self.x.nodes, seat, node)

    def end(self, t_ns: int) -> None:
        """The run is over."""
        if self.recorder.counts is not None:
            self.recorder.counts(self.x.counted)
        for fault in self.scenario.bus_fault:
            if end_ns(fault) > t_ns:
                self._tell(t_ns, fault, "still there at the end of the run")

    def _tell(self, t_ns: int, fault: BusFault, what: str) -> None:
        hits = f", {self._senders.hits[fault.name]} frames hit" if counted(fault) and what != "begins" else ""
        what += " and has no effect: samples go by no frames" if without_effect(fault) else hits
        self.recorder.event(CAN_EVENTS, t_ns, "warning", f"{describe_fault(fault)} {what}", fault.name)
