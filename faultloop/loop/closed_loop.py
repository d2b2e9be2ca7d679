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
from operator import itemgetter
from typing import Any

import numpy as np

from faultloop.config.place import measured_rows, more_rows
from faultloop.errors import InputError, nearest
from faultloop.io.can.transport import Transport
from faultloop.loop import drive, exchange
from faultloop.loop.drive import new_course
from faultloop.loop.outcome import pole_names
from faultloop.loop.pacing import Deadlines
from faultloop.loop.recording import PLANT_EVENTS, Recorder
from faultloop.loop.scenario import Scenario
from faultloop.loop.traffic import Traffic
from faultloop.loop.warm import warm_up
from faultloop.nodes import Command, Movement, with_followed_breakers
from faultloop.nodes.block import RelayBlock
from faultloop.nodes.clock import SampleClock
from faultloop.nodes.tables import BusTables
from faultloop.plant import Plant
from faultloop.relay import Event, Relay
from faultloop.relay.bank import bank_of
from faultloop.relay.functions.pdif import agreement

ROWS = 960
"""Samples that are run before they are told, at most."""


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
    plant_of : makes the plant.
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
        plant_of: Callable[[BusTables], Plant] = Plant,
    ) -> None:
        self._warm_up = warm_up
        left_out = _breakers_left_out(scenario, without)
        self.relays = [relays[place.name] for place in scenario.relay]
        self._breaker_names = [b.name for b in scenario.breaker]
        self._relay_names = [place.name for place in scenario.relay]
        self._set_up(
            scenario, recorder, plant_of(with_followed_breakers(scenario, left_out) if left_out else scenario)
        )
        self._traffic = Traffic(scenario, bus, recorder, self, left_out)
        for number, seat in self._traffic.seats.items():
            self._course.breaker["seat"][number] = seat
        self._cold: list[Any] = []  # the relays' states before anything was measured
        self.deadlines = Deadlines(self.clock.ns(1))
        """Of the blocks, in a run that is paced."""
        self.began_s = time.perf_counter()
        """When the first sample was begun, on `time.perf_counter`: relays warm, everything compiled."""
        self._pace = pace
        # In real time a block must not keep anybody waiting; in simulated time it may be long.
        self._block = ROWS if pace is None else max(1, self.clock.sampling_hz // 1000)

    def _set_up(self, scenario: Scenario, recorder: Recorder, plant: Plant) -> None:
        self.scenario, self.recorder, self.plant = scenario, recorder, plant
        self.interrupted = False
        self.clock = SampleClock(plant.sampling_hz)
        self.total = self.clock.first_from(round(scenario.scenario.duration_s * 1e9))
        self._bank = bank_of(self.relays, ROWS)
        for own, rows in zip(self._bank.relay, more_rows(scenario.relay), strict=True):
            own["across"], own["beside"] = rows
        closed = [plant.closed(name) for name in self._breaker_names]
        self._course = new_course(closed, measured_rows(scenario.relay), self.clock, ROWS)
        self._course.clock["end"] = self.total
        self._now = self._course.clock[0]

    # -- the clock ------------------------------------------------------------------------------------------

    def run(self, progress: Callable[[float], None] | None = None) -> None:
        """From the first sample to the last."""
        self._start()
        started = time.monotonic()
        while self.sample_count < self.total and not self.interrupted:
            self._run_to(min(self.sample_count + self._block, self.total))
            if progress is not None:
                progress(self.sample_count / self.total)
            if self._pace is not None:
                self.deadlines.keep(self.clock.ns(self.sample_count), started, self._pace)
        self.simulated_ns = self.clock.ns(self.sample_count)
        self._traffic.end(self.simulated_ns)

    def _start(self) -> None:
        """All that comes before the first block."""
        self._begin()
        self.compile()
        self.began_s = time.perf_counter()

    @property
    def bus_load(self) -> float:
        """Part of the time so far in which the bus was busy, 0 to 1."""
        return self._traffic.bus.load(self.simulated_ns)

    @property
    def sample_count(self) -> int:
        """Number of the next sample."""
        return int(self._now["sample"])

    def _run_to(self, stop: int) -> None:
        """Until the next sample is number `stop`, and the bus has followed to its time."""
        self._now["stop"] = stop
        code = 0
        while code != drive.STOPPED:
            code = drive.go_on(self._course, self._traffic.x, self.plant.parts, self._bank)
            if code == drive.ESTIMATE:
                self._estimate()
            elif code == drive.ORDERS:
                self.plant.take_orders()
            else:
                if code != exchange.FAULT_OF_WIRE:
                    self._tell()
                if code not in (drive.STOPPED, drive.FLUSH):
                    self._traffic.answer(code)
            for relay in self.relays:
                relay.check_elements()

    def compile(self, *, backwards: bool = False) -> None:
        """What is to run (`drive.compile_loop`)."""
        loop = (self._course, self._traffic.x, self.plant.parts, self._bank)
        drive.compile_loop(*loop, backwards=backwards)

    def _estimate(self) -> None:
        """What the plant has made, by estimators that are not compiled."""
        first, end = (int(self._now[key] - self._now["base"]) for key in ("sample", "made"))
        for i, relay in enumerate(self.relays):
            own = self._bank.relay[i]
            if not own["step"] and not own["away"] and own["made"] <= self.sample_count:
                samples = np.ascontiguousarray(self._course.samples[first:end, i])
                relay.estimate(samples, self._bank.phasors[i, first:end], self._bank.loops[i, first:end])
                own["made"] = self._now["made"]

    def _begin(self) -> None:
        for place, relay in zip(self.scenario.relay, self.relays, strict=True):
            self.recorder.add_relay(place.name, relay.bits, relay.characteristics())
        self._warm()
        for note in self.plant.notes:
            self._event(0, "plant", "info", note, PLANT_EVENTS)
        for name in self._breaker_names:
            self.recorder.breaker(name, 0, self.plant.closed(name))
        for i, relay in enumerate(self.relays):
            self._record_events(i, relay.events)

    def _warm(self) -> None:
        """The relays have been in service."""
        if any(fault.kind == "restart" for fault in self.scenario.bus_fault):
            self._cold = [relay.save() for relay in self.relays]
        self._warm_up(self.scenario, self.relays)
        for i, relay in enumerate(self.relays):
            self._set(i, relay)

    def _set(self, number: int, relay: Relay) -> None:
        """Its node, as the warm-up has left it."""
        node, outputs = self._traffic.relays[number], relay.outputs
        node.set(0, *outputs.masks)
        node.measured[:14] = relay.phasors[-1]
        node.measured[14] = relay.fault_location
        relay.set_inputs(relay.inputs)

    # -- what has happened ----------------------------------------------------------------------------------

    def _tell(self) -> None:
        """Everything since the last time, to the recorder, and room for more."""
        now, bank = self._now, self._bank
        base, sample = int(now["base"]), int(now["sample"])
        for i, name in enumerate(self._relay_names):
            if self.recorder.wants_blocks and not bank.relay["away"][i] and sample > base:
                block = RelayBlock.of_bank(bank, self._course.samples, i, sample - base)
                self.recorder.block(name, self.clock, base, block)
        told: list[tuple[int, int, Any]] = [(event[0], -1, event) for event in self._traffic.events()]
        now["heard"] = 0
        notices = bank.notice[: int(bank.notices[0])].tolist()
        for i in range(len(self.relays)):
            told += [(event.sample_count, i, event) for event in self._events_of(i, sample - base, notices)]
        bank.notices[0] = 0
        for _, relay, event in sorted(told, key=itemgetter(0, 1)):
            if relay < 0:
                self._traffic.tell(event)
            else:
                self._record_events(relay, (event,))
        self._make_room(sample - base)

    def _events_of(self, number: int, count: int, notices: Sequence[Sequence[int]]) -> Sequence[Event]:
        """What a relay has to tell of the samples in its first `count` rows; ``notices``: whose, at which
        sample, the records in the bank are."""
        bank = self._bank
        own = bank.relay[number]
        told = [(at, bank.told[k : k + 1]) for k, (relay, at) in enumerate(notices) if relay == number]
        if not own["changed"] and not told:
            return ()
        own["changed"] = 0
        first, words = int(self._now["base"]), bank.words[number, :count]
        return self.relays[number].told(first, words, told, texts=self.recorder.wants_texts)

    def _make_room(self, count: int) -> None:
        """The rows after the first `count` are the first ones from now on."""
        bank, end = self._bank, int(self._now["made"] - self._now["base"])
        self._now["base"] += count
        if end == count:
            return
        for rows in (self._course.samples, *bank.phasors, *bank.loops):
            rows[: end - count] = rows[count:end]

    def changed(self, kind: str, index: int, t_ns: int, value: int) -> None:
        """A pole or a fault of the plant has."""
        if kind == "pole":
            self.recorder.breaker(self._breaker_names[index], t_ns, value)
        else:
            fault = self.scenario.fault[index]
            self.recorder.fault(t_ns, index, fault.name, fault.type, bool(value))

    def _record_events(self, number: int, events: Iterable[Event]) -> None:
        name = self._relay_names[number]
        for event in events:
            at_ns = self.clock.ns(event.sample_count)
            self._event(at_ns, name, event.level, event.text, f"/relay/{name}/events")
            if event.trip is not None:
                self.recorder.trip(name, at_ns, event.sample_count, event.trip)

    def _event(self, t_ns: int, source: str, level: str, text: str, topic: str) -> None:
        self.recorder.event(topic, t_ns, level, text, source)

    # -- what comes from the bus ----------------------------------------------------------------------------

    def obey(self, breaker: int, command: Command, closed: int) -> None:
        """A breaker acts on an accepted command; this is the time that a trip's report states."""
        name = self._breaker_names[breaker]
        relay = self.scenario.relay[command.relay].name
        self.recorder.breaker(name, command.t_ns, closed, command.operation, relay)
        text = f"{command.operation} poles {pole_names(command.poles)} received from {relay}"
        self._event(command.t_ns, name, "info", text, f"/breaker/{name}/events")

    def move(self, breaker: int, t_ns: int, movement: Movement) -> None:
        """The status of a breaker that is somebody else's moves the plant."""
        name = self._breaker_names[breaker]
        self.plant.order(breaker, movement.operation == "open", movement.poles, t_ns)
        text = f"status {movement.operation}, poles {pole_names(movement.poles)}"
        self._event(t_ns, name, "info", text, f"/breaker/{name}/events")

    def restart(self, relay: int, t_ns: int, *, begins: bool) -> None:
        """A relay goes, or is back: cold, and remembers nothing."""
        own = self._bank.relay[relay]
        own["away"], own["made"], own["last"] = begins, self.sample_count, -1
        if not begins:
            again = self.relays[relay]
            again.restore(self._cold[relay])
            again.sample_count = self.sample_count
            again.set_inputs(again.inputs)

    def agreement(self, relay: int) -> int:
        """Of a relay's line differential; 0 without one."""
        return agreement(self.relays[relay].settings)

    def closed(self, breaker: int) -> int:
        """Mask of a breaker's poles that conduct."""
        return int(self._course.breaker["closed"][breaker])


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
