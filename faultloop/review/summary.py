"""What happened in a log: the fault, what each relay saw and did, the breakers, the bus.

``summarize`` gathers it as one ``Summary``; nothing is guessed in silence: ``inception.source`` says where
time zero comes from.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable, Iterator
from dataclasses import replace
from datetime import UTC, datetime
from typing import Any

import numpy as np

from faultloop.io.mcap_reader import Entry, Log
from faultloop.io.messages import BREAKER_STATUS, CAN_FRAME, EVENT, FAULT_STATE, LEVELS, RECORD_DIGITAL, TRIP
from faultloop.loop.outcome import outcome_of
from faultloop.loop.recorded import recorded_scenario, recorded_settings
from faultloop.review.facts import (
    BreakerFacts,
    BusFacts,
    DigitalFacts,
    Event,
    FaultFacts,
    Inception,
    LogFacts,
    Network,
    Operation,
    RelayFacts,
    Summary,
)
from faultloop.review.relay_summary import after_ms, closed_poles, relay_facts, relay_warnings, trip_facts
from faultloop.review.rows import change_before, relay_rows
from faultloop.review.survey import Survey, survey

NEAR_CYCLES = 8  # before a pickup, in which its cause is looked for
MOST_EVENTS = 5000
"""So many events are told of a log, and so many changes of a record's channels: the page has a row each."""
RECORD = "record"
"""What a replayed record is called, as the source of an event and as a breaker."""


def summarize(log: Log) -> Summary:
    """Everything that ``faultloop review`` says of a log.  Raises InputError where the log is damaged."""
    scenario, outcome = recorded_scenario(log), outcome_of(log, texts=False)
    surveys = {name: survey(log, name) for name in log.relays}
    nominal_hz = _nominal_hz(log, scenario, surveys)
    inception = _inception(log, surveys, 1e9 / nominal_hz)
    zero = inception.zero_ns
    network = Network(
        inception=inception,
        faults=_faults(log, scenario, zero),
        breakers={name: _breaker(log, name, zero) for name in log.breakers},
        events=_events(log, zero),
        nominal_hz=nominal_hz,
    )
    places = {place["name"]: (place.get("line"), place.get("breaker")) for place in scenario["relay"]}
    relays = {}
    for name, whole in surveys.items():
        trips = [trip_facts(trip, zero, network.faults) for trip in outcome.trips if trip.relay == name]
        relays[name] = relay_facts(log, whole, network, places.get(name, (None, None)), trips)
    facts = _facts(log, scenario, surveys, nominal_hz)
    return Summary(
        log=facts,
        inception=inception,
        faults=network.faults,
        relays=relays,
        breakers=network.breakers,
        can=BusFacts(sum(outcome.can_frames.values()), outcome.can_frames),
        events=network.events,
        digital=_digital(log, zero),
        warnings=[
            *_warnings(log, facts, scenario["scenario"].get("duration_s"), surveys),
            *_relay_warnings(log, surveys, relays, inception),
            *_noted(log, network.events),
        ],
    )


# -- where and when --------------------------------------------------------------------------------------


def _nominal_hz(log: Log, scenario: dict[str, Any], relays: dict[str, Survey]) -> float:
    """Nominal frequency [Hz]: as the scenario or the settings have it, else 50 or 60 by what was measured."""
    given = [scenario["system"].get("frequency_hz")]
    given += [recorded_settings(log, name)["relay"].get("frequency_hz") for name in relays]
    for value in given:
        if value is not None:
            return float(value)
    measured = [own.frequency_hz for own in relays.values() if np.isfinite(own.frequency_hz)]
    return 60.0 if measured and float(np.median(measured)) > 55 else 50.0


def find_inception(log: Log) -> Inception:
    """When the fault began, and how that is known."""
    told = _told_inception(log)
    if told is not None:
        return told
    surveys = {name: survey(log, name) for name in log.relays}
    return _inception(log, surveys, 1e9 / _nominal_hz(log, recorded_scenario(log), surveys))


def _told_inception(log: Log) -> Inception | None:
    """As the plant wrote it."""
    first = next((entry.t_ns for entry in log.walk(FAULT_STATE) if entry.on), None)
    return None if first is None else Inception(first, "plant", "as the plant applied the fault")


def _inception(log: Log, relays: dict[str, Survey], cycle_ns: float) -> Inception:
    """Time zero: the truth where the plant wrote it, else from the samples before the first pickup."""
    told = _told_inception(log)
    if told is not None:
        return told
    pickups = [(first, name) for name, rows in relays.items() if (first := rows.first_pickup()) is not None]
    if not pickups:
        return Inception(None, None, "no fault in the log and no pickup: times count from the log's start")
    (t_ns, element), name = min(pickups)
    near = relay_rows(log, name, t_ns - round(NEAR_CYCLES * cycle_ns), t_ns + round(cycle_ns))
    changed = change_before(near, t_ns, cycle_ns)
    if changed is not None:
        text = f"estimated: where the samples first changed before the first pickup ({name} {element})"
        return Inception(changed, "samples", text)
    text = f"estimated: the first pickup ({name} {element}); the fault began before it"
    return Inception(t_ns, "pickup", text)


# -- the log, the faults, the breakers, the bus ----------------------------------------------------------


def _facts(log: Log, scenario: dict[str, Any], surveys: dict[str, Survey], nominal_hz: float) -> LogFacts:
    ends = [own.last_ns for own in surveys.values() if own.last_ns is not None]
    ends += log.last_ns(BREAKER_STATUS, FAULT_STATE, CAN_FRAME, TRIP)
    start = datetime.fromtimestamp(log.start_ns // 10**9, UTC).strftime("%Y-%m-%dT%H:%M:%S")
    return LogFacts(
        path=str(log.path),
        size_bytes=log.path.stat().st_size,
        scenario=scenario["scenario"].get("name"),
        record=log.metadata.get("replay", {}).get("record"),
        start=f"{start}.{log.start_ns % 10**9:09d}Z",
        start_ns=log.start_ns,
        duration_s=max(ends, default=0) / 1e9,
        relays=list(log.relays),
        breakers=list(log.breakers),
        topics=len(log.topics),
        attachments=sorted(log.attachments),
        versions=log.metadata.get("versions", {}),
        recovered="recovered" in log.metadata,
        nominal_hz=nominal_hz,
    )


def _faults(log: Log, scenario: dict[str, Any], zero: int) -> list[FaultFacts]:
    """Each application of a fault: what, where (from the scenario), on and off."""
    known = scenario["fault"]
    keys = ("name", "line", "bus", "at_pu", "at_km", "resistance_ohm", "ground_ohm")
    out: list[FaultFacts] = []
    for entry in log.walk(FAULT_STATE):
        if entry.on:
            told = known[entry.fault] if entry.fault < len(known) else {}
            on_ms = after_ms(entry.t_ns, zero)
            place = {key: told.get(key) for key in keys}
            out.append(FaultFacts(entry.fault, entry.type, entry.t_ns, on_ms, None, None, **place))
            continue
        for k, fault in enumerate(out):
            if fault.fault == entry.fault and fault.off_ns is None:
                out[k] = replace(fault, off_ns=entry.t_ns, off_ms=after_ms(entry.t_ns, zero))
    return out


def _breaker(log: Log, name: str, zero: int) -> BreakerFacts:
    """A breaker's state at the start, and every command and change since."""
    states = [entry for entry in log.walk(BREAKER_STATUS) if entry.source == name]
    operations = []
    for before, entry in zip([None, *states], states, strict=False):
        was, now = ("" if before is None else closed_poles(before)), closed_poles(entry)
        if before is None and not entry.command:
            continue
        operations.append(
            Operation(
                t_ns=entry.t_ns,
                ms=after_ms(entry.t_ns, zero),
                command=entry.command or None,
                opened="".join(p for p in was if p not in now),
                closed="".join(p for p in now if p not in was) if before is not None else "",
                poles_closed=now,
            )
        )
    return BreakerFacts(
        initially_closed=closed_poles(states[0]) if states else None,
        finally_closed=closed_poles(states[-1]) if states else None,
        operations=operations,
    )


def _nearest(log: Log, entries: Iterable[Entry], zero: int, what: str) -> list[Entry]:
    """Those around time zero where there are very many; what is left out is told."""
    before, after, count = deque[Entry](maxlen=MOST_EVENTS // 2), list[Entry](), 0
    for entry in entries:
        count += 1
        if entry.t_ns < zero:
            before.append(entry)
        elif len(before) + len(after) < MOST_EVENTS:
            after.append(entry)
    kept = [*before, *after]
    if len(kept) < count:
        log.warn(f"of {count} {what} the {len(kept)} around time zero are shown")
    return kept


def _events(log: Log, zero: int) -> list[Event]:
    """What nodes and relays said, and what a replayed record's own digital channels did, by time."""
    changes = [
        Event(
            entry.t_ns,
            after_ms(entry.t_ns, zero),
            RECORD,
            "INFO",
            f"{entry.name} {'on' if entry.on else 'off'}",
        )
        for entry in _nearest(log, _digital_changes(log), zero, "changes of the record's channels")
    ]
    told = [
        Event(
            t_ns=entry.t_ns,
            ms=after_ms(entry.t_ns, zero),
            source=entry.name or entry.source,
            level=LEVELS[entry.level] if entry.level < len(LEVELS) else str(entry.level),
            text=entry.message,
        )
        for entry in _nearest(log, log.walk(EVENT), zero, "events")
    ]
    return sorted(told + changes, key=lambda event: event.t_ns)


def _digital_changes(log: Log) -> Iterator[Entry]:
    """The changes of a replayed record's digital channels, without the states at the beginning."""
    known: set[int] = set()
    for entry in log.walk(RECORD_DIGITAL):
        if entry.number in known:
            yield entry
        known.add(entry.number)


def _digital(log: Log, zero: int) -> list[DigitalFacts]:
    """A replayed record's digital channels that changed, but for those that always do."""
    found: dict[int, DigitalFacts] = {}
    counts: Counter[int] = Counter()
    for entry in log.walk(RECORD_DIGITAL):
        spans = found.setdefault(entry.number, DigitalFacts(entry.name, [])).on_ms
        counts[entry.number] += 1
        if counts[entry.number] > MOST_EVENTS:
            spans.clear()
            continue
        ms = after_ms(entry.t_ns, zero)
        if entry.on:
            spans.append((ms, None))
        elif spans:
            spans[-1] = (spans[-1][0], ms)
    restless = [own.name for number, own in found.items() if counts[number] > MOST_EVENTS]
    if restless:
        names = f"{', '.join(restless[:5])}{' and others' if len(restless) > 5 else ''}"
        log.warn(f"channels of the record that change more than {MOST_EVENTS} times are left out: {names}")
    return [own for number, own in found.items() if 1 < counts[number] <= MOST_EVENTS]


# -- what a reader should be warned of -------------------------------------------------------------------


def _warnings(log: Log, facts: LogFacts, wanted_s: float | None, surveys: dict[str, Survey]) -> list[str]:
    """Of the log as a whole; ``wanted_s``: how long the run was to be."""
    out = []
    if facts.recovered:
        out.append("this log was recovered from one that was cut off; its end is missing")
    if wanted_s is not None:
        step = max((own.interval_ns for own in surveys.values() if len(own) > 1), default=0.0)
        if facts.duration_s < wanted_s - 2 * step / 1e9:
            out.append(
                f"the run ended early: {facts.duration_s:g} s of the scenario's {wanted_s:g} s are in the log"
            )
    if not log.relays:
        out.append("the log has no relay")
    return out


def _relay_warnings(
    log: Log, surveys: dict[str, Survey], relays: dict[str, RelayFacts], inception: Inception
) -> list[str]:
    out = [text for name, own in relays.items() for text in relay_warnings(surveys[name], own, inception)]
    if relays and FAULT_STATE.topic not in log.topics and inception.t_ns is not None:
        out.append("the log does not say when the fault began: time zero is estimated")
    return out


ORDINARY = ("PTRC", "LPHD1 not ready, zones blocked: a pole has opened")
"""How warnings begin that are in the log of every trip, the second of older ones: nothing to warn of."""


def _noted(log: Log, events: list[Event]) -> list[str]:
    """What was found damaged, and what the run itself warned of."""
    serious = [event for event in events if event.level in ("WARNING", "ERROR", "FATAL")]
    told = Counter(
        f"{event.source}: {event.text}" for event in serious if not event.text.startswith(ORDINARY)
    )
    return [*log.warnings, *(text if n == 1 else f"{text} ({n} times)" for text, n in told.items())]
