"""The result of a run as processes, from its log: what the simulation has at hand is read back here."""

from __future__ import annotations

from pathlib import Path

from faultloop.io.can.frames import Frame, State, decode
from faultloop.io.can.table import Kind
from faultloop.io.mcap_reader import Log, open_log
from faultloop.io.messages import LEVELS
from faultloop.loop.result import EventText, FaultChange, Result, TripReport, judge
from faultloop.loop.scenario import Scenario


def read_trips(log: Log, scenario: Scenario) -> list[TripReport]:
    """Every trip, with when its breaker took it and when its poles were open.

    A breaker that is somebody else's writes no log: it has a trip when the first frame that tells it is on
    the bus.
    """
    places = {place.name: place for place in scenario.relay}
    trips = [
        TripReport(
            entry.source,
            entry.function,
            entry.zone,
            entry.loop,
            entry.poles,
            entry.sample_count,
            entry.t_ns,
            places[entry.source].breaker,
        )
        for entry in log.trips
        if entry.source in places
    ]
    states = log.breaker_states
    commands = {entry.source for entry in states if entry.command}
    told = _trip_frames(log, scenario)
    for trip in trips:
        own = [entry for entry in states if entry.source == trip.breaker and entry.t_ns >= trip.t_ns]
        if trip.breaker in commands:
            trip.received_ns = next((entry.t_ns for entry in own if entry.command == "open"), None)
        elif trip.breaker is not None:
            trip.received_ns = next((t for t, relay in told if relay == trip.relay and t >= trip.t_ns), None)
        if trip.received_ns is None:
            continue
        for entry in own:
            closed = entry.pole_a | entry.pole_b << 1 | entry.pole_c << 2
            if not entry.command and entry.t_ns >= trip.received_ns and not closed & trip.poles:
                trip.opened_ns = entry.t_ns
                break
    return trips


def _trip_frames(log: Log, scenario: Scenario) -> list[tuple[int, str]]:
    if "/can" not in log.topics:
        return []
    frames = log.array("/can")
    found = []
    for number, place in enumerate(scenario.relay):
        for row in frames[frames["id"] == Kind.TRIP + number]:
            message = decode(Frame(int(row["id"]), bytes(row["data"])[:8]))
            if isinstance(message, State) and message.poles:
                found.append((int(row["t_ns"]), place.name))
    return sorted(found)


def read_result(path: Path, scenario: Scenario, wall_s: float, locations: dict[str, float]) -> Result:
    """What `faultloop.run` would give for the run in the log at `path`."""
    log = open_log(path)
    trips = read_trips(log, scenario)
    faults = [
        FaultChange(scenario.fault[entry.fault].name, entry.type, entry.on, entry.t_ns)
        for entry in log.faults
    ]
    events = [
        EventText(entry.t_ns, entry.name, LEVELS[entry.level].lower(), entry.message) for entry in log.events
    ]
    fault_ns = next((change.t_ns for change in faults if change.on), None)
    ends = [int(log.samples(relay)["t_ns"][-1]) for relay in log.relays if len(log.samples(relay))]
    return Result(
        scenario=scenario,
        trips=trips,
        faults=faults,
        events=events,
        expectations=[judge(expect, trips, fault_ns) for expect in scenario.expect],
        log=path,
        simulated_s=max(ends, default=0) / 1e9 + 1 / scenario.system.sampling_hz if ends else 0.0,
        wall_s=wall_s,
        can_frames=len(log.array("/can")) if "/can" in log.topics else 0,
        bus_load=None,
        fault_locations=locations,
    )
