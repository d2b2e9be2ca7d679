"""A whole scenario as processes: started together, listened to, ended cleanly, one log."""

from __future__ import annotations

import json
import shutil
import time
from collections import Counter
from collections.abc import Callable, Collection, Sequence
from dataclasses import asdict, replace
from pathlib import Path

from faultloop.errors import InputError, nearest
from faultloop.io.can.authentication import read
from faultloop.io.can.frames import Frame, Rejection, State
from faultloop.io.can.link import Link, TimedLink
from faultloop.io.can.socketcan import open_link
from faultloop.io.can.table import BY_IDENTIFIER, PLANT_NODE, RELAYS, Kind
from faultloop.io.mcap_reader import Log, open_log
from faultloop.io.mcap_writer import LogWriter
from faultloop.io.output_file import new_folder, reserved
from faultloop.live.child import Child, ended_how
from faultloop.live.clock import RunClock
from faultloop.live.merge import merge
from faultloop.live.nodes import ATTACKERS, NodeOptions, Role, bus_of, check_pace
from faultloop.loop.bus_faults import Edges, end_ns
from faultloop.loop.bus_faults import describe as describe_fault
from faultloop.loop.doubts import scenario_doubts
from faultloop.loop.inputs import load_inputs
from faultloop.loop.outcome import Outcome, outcome_of
from faultloop.loop.pacing import Pacing, Percentiles
from faultloop.loop.recording import Recorder, check_log_path, describe
from faultloop.loop.result import Result
from faultloop.loop.runner import Interrupted, interruptible
from faultloop.loop.scenario import Scenario
from faultloop.nodes.clock import FOREVER
from faultloop.nodes.refusals import Refusals
from faultloop.plant import Plant

READY_WITHIN_S = 120.0
"""The first run of a version compiles, in every process."""
LEAD_S = 0.3
"""From the last node's being ready to time zero."""
DRAIN_S = 0.3
"""Silence on the bus after the plant's end that ends the run."""
LOOK_S = 0.05
"""How long the listener waits for a frame before it looks after its processes."""
PLANT = "plant"
CAN_EVENTS = "/can/events"


class Supervisor:
    """Starts, watches and ends the processes of one scenario, and writes what is on the bus.

    Parameters
    ----------
    scenario : from a file: every process reads it itself.
    can : ``"INTERFACE:CHANNEL"`` in place of the scenario's.
    pace : run time in a second of wall time.
    without : names of relays and breakers whose place a device on the bus takes.
    folder : where the processes' logs go.
    overrides : of keys of the scenario, as on the command line.
    """

    def __init__(
        self,
        scenario: Scenario,
        can: str | None,
        pace: float,
        without: Collection[str],
        folder: Path,
        overrides: Sequence[str] = (),
    ) -> None:
        if scenario.path is None:
            raise InputError("processes read the scenario from its file: give a path, not a Scenario")
        self.scenario = scenario
        self.pace = pace
        self.folder = folder
        self.interrupted = False
        self.died: list[str] = []
        self.frames = 0
        self.closed = {i: 7 if breaker.closed else 0 for i, breaker in enumerate(scenario.breaker)}
        """Position of each breaker, as last heard."""
        self.bus = bus_of(scenario, can)
        self._overrides = overrides
        self._roles = _roles(scenario, without)
        self._children: dict[str, Child] = {}
        self._past: list[Child] = []
        self._joining: dict[str, int] = {}
        """Nodes that are starting, and when each may take part [ns of the run]."""
        self._edges = Edges(scenario.bus_fault)
        self.broken: InputError | None = None
        """Why the bus was lost, if it was."""
        self._names = _names(scenario)
        self.link: Link = open_link(self.bus, fd=True, scenario=scenario)
        self.clock: RunClock | None = None
        self._recorder = Recorder([])
        self._refusals = Refusals(self._tell)

    @property
    def names(self) -> list[str]:
        """Of the nodes that are processes."""
        return list(self._roles)

    # -- processes ------------------------------------------------------------------------------------------

    def spawn(self, name: str) -> Child:
        """Start the process of a node."""
        role = self._roles[name]
        breakers = [breaker.name for breaker in self.scenario.breaker]
        again = sum(child.name == name for child in self._past)
        assert self.scenario.path is not None
        options = NodeOptions(
            role,
            Path(self.scenario.path).resolve(),
            None if role == PLANT else name,
            self.bus,
            self.pace,
            (self.folder / f"{name}{f'-{again}' if again else ''}.mcap").resolve(),
            tuple(self._overrides),
            self.closed[breakers.index(name)] if role == "breaker" else 7,
        )
        child = Child(options)
        self._children[name] = child
        return child

    def begin(self) -> RunClock:
        """Start all processes, and the run when every one of them is ready."""
        self.folder.mkdir(parents=True, exist_ok=True)
        for name in self._roles:
            self.spawn(name)
        deadline = time.monotonic() + READY_WITHIN_S
        while not all(child.ready for child in self._children.values()):
            for child in self._children.values():
                child.listen()
                child.check()
            if self.interrupted:
                raise KeyboardInterrupt
            if time.monotonic() > deadline:
                waiting = ", ".join(n for n, child in self._children.items() if not child.ready)
                raise InputError(f"not ready within {READY_WITHIN_S:g} s: {waiting}")
            time.sleep(0.01)
        self.clock = clock = RunClock.starting_now(self.pace, LEAD_S)
        if isinstance(self.link, TimedLink):
            self.link.attend(clock)
        self._recorder = Recorder([LogWriter(self.folder / "bus.mcap", clock.start_ns)])
        for child in self._children.values():
            child.start(clock)
        return clock

    def restart(self, name: str, not_before_ns: int = 0) -> None:
        """Start a node that has ended again; it joins the run when it is ready."""
        old = self._children.pop(name)
        old.close()
        self._past.append(old)
        self._joining[name] = not_before_ns
        self.spawn(name)
        self.died = [other for other in self.died if other != name]

    def kill(self, name: str) -> None:
        """As ``kill -9`` does; it counts as meant."""
        child = self._children[name]
        child.kill()
        self.event("warning", f"{name} was killed")

    def ended(self, name: str) -> bool:
        """The node's process is not there."""
        return self._children[name].ended

    def event(self, level: str, text: str) -> None:
        """A line of the supervisor's own, in the event list of the bus."""
        assert self.clock is not None
        self._tell(self.clock.now_ns(), level, text)

    def _tell(self, t_ns: int, level: str, text: str) -> None:
        self._recorder.event(CAN_EVENTS, max(t_ns, 0), level, text, "supervisor")

    # -- the bus --------------------------------------------------------------------------------------------

    def listen(self, timeout_s: float = LOOK_S) -> list[tuple[int, Frame]]:
        """Take what is on the bus, log it, look after the processes; the frames with their run time [ns]."""
        clock = self.clock
        assert clock is not None
        frames = [(clock.at(at), frame) for at, frame in self.link.receive(timeout_s)]
        for t_ns, frame in frames:
            self._log(max(t_ns, 0), frame)
            if frame.id not in BY_IDENTIFIER:  # the nodes do not hear them: their kernel filters them out
                self._refusals.add(t_ns, frame.id, Rejection.UNKNOWN_ID)
        self.frames += len(frames)
        for child in self._children.values():
            child.listen()
            if child.ready and self._joining.get(child.name, FOREVER) <= clock.now_ns():
                del self._joining[child.name]
                child.start(clock)
        return frames

    def _log(self, t_ns: int, frame: Frame) -> None:
        self._recorder.can_frame(t_ns, frame, "rx", self._names.get(frame.id, ""))
        if frame.id & ~0xF == Kind.BREAKER_STATUS:
            message = read(frame)
            if isinstance(message, State):
                self.closed[message.number] = message.poles

    def run(self, progress: Callable[[float], None] | None = None) -> None:
        """Until the plant has published its last sample and the bus is silent, or until a signal."""
        try:
            self._run(progress)
        except InputError as error:  # the interface went down: what there is, is logged
            self.broken = error
            self.event("error", str(error))

    def _run(self, progress: Callable[[float], None] | None) -> None:
        assert self.clock is not None
        while not self.interrupted:
            self.listen()
            self._watch()
            self._disturb()
            if progress is not None:
                progress(min(max(self.clock.now_ns() / 1e9 / self.scenario.scenario.duration_s, 0.0), 1.0))
            if self._children[PLANT].ended:
                break
        until = time.monotonic() + DRAIN_S
        while not self.interrupted and time.monotonic() < until:
            if any(frame.id & ~0xF == Kind.SAMPLED_VALUES for _, frame in self.listen(0.02)):
                until = time.monotonic() + DRAIN_S

    def _watch(self) -> None:
        """A node that ends before the run does is told of once; the others go on."""
        for name, child in self._children.items():
            if child.ended and name not in self.died and not (name == PLANT and child.status == 0):
                self.died.append(name)
                why = f": {child.last_words}" if child.last_words else ""
                self.event("error", f"{name} ended before the run did: {ended_how(child.status or 0)}{why}")

    def _disturb(self) -> None:
        """Faults on the bus that begin or end: what befalls frames is their sender's business."""
        assert self.clock is not None
        for t_ns, fault, begins in self._edges.due(self.clock.now_ns()):
            told = f"{describe_fault(fault)} {'begins' if begins else 'is over'}"
            self._recorder.event(CAN_EVENTS, max(t_ns, 0), "warning", told, fault.name)
            if fault.kind == "restart" and fault.node in self._children and begins:
                self._children[fault.node].kill()
                self.restart(fault.node, end_ns(fault) or 0)

    def finish(self) -> None:
        """End all processes; each closes its log, or its log is recovered."""
        for child in self._children.values():
            child.end()
        for child in self._children.values():
            child.wait()
        hits: Counter[str] = Counter()
        for child in self._children.values():
            hits.update(child.statistics.get("bus_faults", {}))
        for name, count in hits.items():
            self.event("info", f"bus fault {name}: {count} frames hit")
        self._recorder.close()

    def close(self) -> None:
        """Whatever happened: nobody is left."""
        for child in self._children.values():
            child.close()
        self.link.close()

    @property
    def children(self) -> list[Child]:
        """All processes, in the order of their start where one node had several."""
        return [*self._past, *self._children.values()]

    @property
    def logs(self) -> list[Path]:
        """Of all processes, and of the bus."""
        return [*(child.log for child in self.children if child.log is not None), self.folder / "bus.mcap"]

    def pacing(self) -> Pacing:
        """How well the processes kept time; reactions are the result's."""
        statistics = {name: child.statistics for name, child in self._children.items()}
        plant = statistics[PLANT]
        none = Percentiles.of([])
        relays = {name: own for name, own in statistics.items() if "latency_ms" in own}
        return Pacing(
            pace=self.pace,
            samples=plant.get("samples", 0),
            missed=plant.get("deadlines_missed", 0),
            jitter=Percentiles(**plant["jitter_ms"]) if "jitter_ms" in plant else none,
            latency={name: Percentiles(**own["latency_ms"]) for name, own in relays.items()},
            lost={name: own["lost"] for name, own in relays.items()},
            dropped={name: own["dropped"] for name, own in statistics.items() if own}
            | {"supervisor": self.link.dropped},
            retries={name: own["retries"] for name, own in statistics.items() if own},
        )

    @property
    def locations(self) -> dict[str, float]:
        """Fault locations of the relays, per unit."""
        return {
            name: child.statistics.get("location", float("nan"))
            for name, child in self._children.items()
            if self._roles[name] == "relay"
        }


def _roles(scenario: Scenario, without: Collection[str]) -> dict[str, Role]:
    roles: dict[str, Role] = {PLANT: "plant"}
    roles |= {place.name: "relay" for place in scenario.relay}
    for breaker in scenario.breaker:
        if breaker.name in roles:
            raise InputError(
                f"a relay and a breaker are both called '{breaker.name}': processes need names of their own",
                file=scenario.path,
                key=f"breaker[{breaker.name}].name",
            )
        roles[breaker.name] = "breaker"
    for fault in scenario.bus_fault:
        if fault.kind == "bit_error":
            raise InputError(
                "an error on the wire needs the bus model: SocketCAN's virtual bus has no wire",
                file=scenario.path,
                key=f"bus_fault[{fault.name}].kind",
            )
        if fault.kind in ATTACKERS:
            roles[fault.name] = "attacker"
    for name in without:
        if name not in roles:
            raise InputError(f"there is no node '{name}'; {nearest(name, roles)}", key="--without")
        if name == PLANT:
            raise InputError("a run without the plant has no end: run the nodes one by one", key="--without")
        del roles[name]
    return roles


def _names(scenario: Scenario) -> dict[int, str]:
    """Who sends which identifier."""
    relays = {i: place.name for i, place in enumerate(scenario.relay)}
    breakers = {i: breaker.name for i, breaker in enumerate(scenario.breaker)}
    everybody = relays | {RELAYS + i: name for i, name in breakers.items()} | {PLANT_NODE: PLANT}
    names = {}
    for identifier, (kind, number) in BY_IDENTIFIER.items():
        owners = {Kind.BREAKER_STATUS: breakers, Kind.HEARTBEAT: everybody}.get(kind, relays)
        if kind == Kind.TIME_SYNC or (kind == Kind.SAMPLED_VALUES and number in relays):
            names[identifier] = PLANT
        elif number in owners:
            names[identifier] = owners[number]
    return names


def run_processes(
    scenario: Path | str | Scenario,
    *,
    can: str | None = None,
    pace: float = 1.0,
    without: Collection[str] = (),
    log: Path | str | None = None,
    overrides: Sequence[str] = (),
    user_code: bool = True,
    progress: Callable[[float], None] | None = None,
) -> Result:
    """Run a scenario with the plant, every relay and every breaker as a process of its own.

    Parameters
    ----------
    scenario : its file (or a `Scenario` that was read from one, without overrides).
    can : ``"INTERFACE:CHANNEL"`` in place of the scenario's, as in ``"socketcan:vcan0"``.
    pace : run time in a second of wall time: below 1 in slow motion, for a machine that is too slow.
    without : relays and breakers whose place a device of your own takes.
    log : where the merged log goes; ``logs/NAME.mcap`` where not given.
    overrides : ``"fault.F1.at_pu=0.7"`` and the like.
    user_code : whether the relays' settings may name code.

    Raises
    ------
    InputError : something in the scenario, the bus or the arguments is wrong.
    """
    checked, settings = load_inputs(scenario, None, overrides, user_code=user_code)
    check_pace(pace)
    path = Path(log) if log is not None else Path("logs") / f"{Path(checked.path or 'run').stem}.mcap"
    check_log_path(path)
    started = time.perf_counter()
    with reserved(path):
        folder = new_folder(path.with_name(path.name + ".nodes"))
        try:
            supervisor = Supervisor(checked, can, pace, without, folder, overrides)
        except BaseException:
            folder.rmdir()
            raise
        try:
            with interruptible(supervisor):
                clock = supervisor.begin()
                supervisor.run(progress)
                supervisor.finish()
            pacing = supervisor.pacing()
        finally:
            supervisor.close()
            if supervisor.clock is None:  # it never began: there is nothing to keep
                shutil.rmtree(folder, ignore_errors=True)
        metadata, attachments = describe(checked, settings, overrides, without)
        metadata["processes"] = {"pace": f"{pace:g}", "bus": supervisor.bus, "without": " ".join(without)}
        metadata["pacing"] = {"json": json.dumps(asdict(pacing))}
        merge(supervisor.logs, folder / path.name, clock.start_ns, metadata, attachments)
        (folder / path.name).replace(path)
        shutil.rmtree(folder)
    if supervisor.broken is not None:
        raise supervisor.broken
    merged = open_log(path)
    outcome = outcome_of(merged)
    result = Result.of(
        checked,
        outcome,
        log=path,
        simulated_s=_simulated_s(merged, checked),
        wall_s=time.perf_counter() - started,
        bus_load=None,
        fault_locations=supervisor.locations,
        interrupted=supervisor.interrupted,
        died=tuple(supervisor.died),
        pacing=_with_reactions(pacing, outcome),
        warnings=tuple(scenario_doubts(checked, settings, Plant(checked))),
    )
    if result.interrupted:
        raise Interrupted(result)
    return result


def _simulated_s(log: Log, scenario: Scenario) -> float:
    """To the end of the last sample's interval."""
    ends = [int(log.samples(relay)["t_ns"][-1]) for relay in log.relays if len(log.samples(relay))]
    return max(ends) / 1e9 + 1 / scenario.system.sampling_hz if ends else 0.0


def _with_reactions(pacing: Pacing, outcome: Outcome) -> Pacing:
    reactions = [trip.received_ns - trip.t_ns for trip in outcome.trips if trip.received_ns is not None]
    return replace(pacing, reaction=Percentiles.of(reactions, pacing.pace))
