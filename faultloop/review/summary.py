"""What happened in a log: the fault, what each relay saw and did, the breakers, the bus.

``summarize`` makes one JSON-able dict of it.  Times ``*_ns`` count from the start of the run and are the
log's own; ``*_ms`` count from the fault's inception (from the start of the run where there is none).
"""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

import numpy as np

from faultloop.io.mcap_reader import Entry, Log
from faultloop.io.messages import FAULT_STATE, LEVELS
from faultloop.loop.outcome import outcome_of
from faultloop.loop.recorded import recorded_scenario, recorded_settings
from faultloop.review.relay_summary import (
    after_ms,
    closed_poles,
    measured,
    relay_facts,
    relay_warnings,
    trip_report,
)
from faultloop.review.rows import change_before, relay_rows
from faultloop.review.survey import Survey, survey

Summary = dict[str, Any]
NEAR_CYCLES = 8  # before a pickup, in which its cause is looked for
RECORD = "record"
"""What a replayed record is called, as the source of an event and as a breaker."""


def summarize(log: Log) -> Summary:
    """Everything that ``faultloop review`` says of a log, as plain dicts, lists, numbers, texts and None.

    Keys: log, inception, faults, relays (by name), breakers (by name), can, events, digital, warnings.  A
    value that the log does not give is None; nothing is guessed in silence: ``inception["source"]`` says
    where time zero comes from.  Raises InputError where the log is damaged.
    """
    scenario, outcome = recorded_scenario(log), outcome_of(log)
    relays = {name: survey(log, name) for name in log.relays}
    nominal_hz = _nominal_hz(log, scenario, relays)
    cycle_ns = 1e9 / nominal_hz
    inception = _inception(log, relays, cycle_ns)
    zero = inception["t_ns"] or 0
    places = {place["name"]: place for place in scenario["relay"]}
    breakers = {name: _breaker(log, name, zero) for name in log.breakers}
    faults = _faults(log, scenario, zero)
    summary: Summary = {
        "log": _facts(log, scenario, relays) | {"nominal_hz": nominal_hz},
        "inception": inception,
        "faults": faults,
        "relays": {},
        "breakers": breakers,
        "can": {"frames": sum(outcome.can_frames.values()), "kinds": outcome.can_frames},
        "events": _events(log, zero),
        "digital": _digital(log, zero),
    }
    for name, whole in relays.items():
        own = {
            "line": places.get(name, {}).get("line"),
            "breaker": places.get(name, {}).get("breaker"),
            **relay_facts(whole),
        }
        own["trips"] = [trip_report(trip, zero, faults) for trip in outcome.trips if trip.relay == name]
        own |= measured(log, whole, summary, own, (cycle_ns, line_impedance(log, name)))
        summary["relays"][name] = own
    summary["warnings"] = _warnings(log, scenario, relays, summary)
    return summary


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


def line_impedance(log: Log, relay: str) -> complex | None:
    """Positive-sequence impedance of the whole line by the relay's settings [ohm, primary]."""
    settings = recorded_settings(log, relay)
    z1, header = settings["line"].get("z1_ohm"), settings["relay"]
    if z1 is None:
        return None
    ratio = 1.0
    if header.get("ohms") == "secondary":
        ratio = header.get("vt_ratio", 1.0) / header.get("ct_ratio", 1.0)
    return complex(*z1) * ratio


def find_inception(log: Log) -> dict[str, Any]:
    """When the fault began [ns since the start], and how that is known; ``t_ns`` None where none did."""
    relays = {name: survey(log, name) for name in log.relays}
    return _inception(log, relays, 1e9 / _nominal_hz(log, recorded_scenario(log), relays))


def _inception(log: Log, relays: dict[str, Survey], cycle_ns: float) -> dict[str, Any]:
    """Time zero: the truth where the plant wrote it, else from the samples before the first pickup."""
    applied = [entry.t_ns for entry in log.faults if entry.on]
    if applied:
        return {"t_ns": applied[0], "source": "plant", "text": "as the plant applied the fault"}
    pickups = [(first, name) for name, rows in relays.items() if (first := rows.first_pickup()) is not None]
    if not pickups:
        text = "no fault in the log and no pickup: times count from the log's start"
        return {"t_ns": None, "source": None, "text": text}
    (t_ns, element), name = min(pickups)
    near = relay_rows(log, name, t_ns - round(NEAR_CYCLES * cycle_ns), t_ns + round(cycle_ns))
    changed = change_before(near, t_ns, cycle_ns)
    if changed is not None:
        text = f"estimated: where the samples first changed before the first pickup ({name} {element})"
        return {"t_ns": changed, "source": "samples", "text": text}
    return {
        "t_ns": t_ns,
        "source": "pickup",
        "text": f"estimated: the first pickup ({name} {element}); the fault began before it",
    }


# -- the log, the faults, the breakers, the bus ----------------------------------------------------------


def _facts(log: Log, scenario: dict[str, Any], relays: dict[str, Survey]) -> dict[str, Any]:
    header = scenario["scenario"]
    ends = [own.last_ns for own in relays.values() if own.last_ns is not None]
    ends += [entry.t_ns for entry in (*log.breaker_states, *log.faults, *log.can[-1:], *log.trips)]
    return {
        "path": str(log.path),
        "size_bytes": log.path.stat().st_size,
        "scenario": header.get("name"),
        "start": datetime.fromtimestamp(log.start_ns // 10**9, UTC).strftime("%Y-%m-%dT%H:%M:%S")
        + f".{log.start_ns % 10**9:09d}Z",
        "start_ns": log.start_ns,
        "duration_s": max(ends, default=0) / 1e9,
        "relays": list(log.relays),
        "breakers": list(log.breakers),
        "topics": len(log.topics),
        "attachments": sorted(log.attachments),
        "versions": log.metadata.get("versions", {}),
        "recovered": "recovered" in log.metadata,
    }


def _faults(log: Log, scenario: dict[str, Any], zero: int) -> list[dict[str, Any]]:
    """Each application of a fault: what, where (from the scenario), on and off."""
    known = scenario["fault"]
    out: list[dict[str, Any]] = []
    for entry in log.faults:
        if not entry.on:
            for fault in out:
                if fault["fault"] == entry.fault and fault["off_ns"] is None:
                    fault["off_ns"], fault["off_ms"] = entry.t_ns, after_ms(entry.t_ns, zero)
            continue
        told = known[entry.fault] if entry.fault < len(known) else {}
        keys = ("name", "line", "bus", "at_pu", "at_km", "resistance_ohm", "ground_ohm")
        out.append(
            {
                "fault": entry.fault,
                "type": entry.type,
                "on_ns": entry.t_ns,
                "on_ms": after_ms(entry.t_ns, zero),
                "off_ns": None,
                "off_ms": None,
            }
            | {key: told[key] for key in keys if told.get(key) is not None}
        )
    return out


def _breaker(log: Log, name: str, zero: int) -> dict[str, Any]:
    """A breaker's state at the start, and every command and change since."""
    states = [entry for entry in log.breaker_states if entry.source == name]
    operations = []
    for before, entry in zip([None, *states], states, strict=False):
        was, now = ("" if before is None else closed_poles(before)), closed_poles(entry)
        if before is None and not entry.command:
            continue
        operations.append(
            {
                "t_ns": entry.t_ns,
                "ms": after_ms(entry.t_ns, zero),
                "command": entry.command or None,
                "opened": "".join(p for p in was if p not in now),
                "closed": "".join(p for p in now if p not in was) if before is not None else "",
                "poles_closed": now,
            }
        )
    return {
        "initially_closed": closed_poles(states[0]) if states else None,
        "finally_closed": closed_poles(states[-1]) if states else None,
        "operations": operations,
    }


def _events(log: Log, zero: int) -> list[dict[str, Any]]:
    """What nodes and relays said, and what a replayed record's own digital channels did, by time."""
    changes = [
        {
            "t_ns": entry.t_ns,
            "ms": after_ms(entry.t_ns, zero),
            "source": RECORD,
            "level": "INFO",
            "text": f"{entry.name} {'on' if entry.on else 'off'}",
        }
        for entry in _digital_changes(log)
    ]
    told = [
        {
            "t_ns": entry.t_ns,
            "ms": after_ms(entry.t_ns, zero),
            "source": entry.name or entry.source,
            "level": LEVELS[entry.level] if entry.level < len(LEVELS) else str(entry.level),
            "text": entry.message,
        }
        for entry in log.events
    ]
    return sorted(told + changes, key=lambda event: event["t_ns"])


def _digital_changes(log: Log) -> list[Entry]:
    """The changes of a replayed record's digital channels, without the states at the beginning."""
    known: set[int] = set()
    changes = []
    for entry in log.digital:
        if entry.number in known:
            changes.append(entry)
        known.add(entry.number)
    return changes


def _digital(log: Log, zero: int) -> list[dict[str, Any]]:
    """A replayed record's digital channels that changed: when each was on; an end of None is the log's."""
    changed = {entry.number for entry in _digital_changes(log)}
    found: dict[int, dict[str, Any]] = {}
    for entry in log.digital:
        if entry.number not in changed:
            continue
        spans = found.setdefault(entry.number, {"name": entry.name, "on_ms": []})["on_ms"]
        if entry.on:
            spans.append([after_ms(entry.t_ns, zero), None])
        elif spans:
            spans[-1][1] = after_ms(entry.t_ns, zero)
    return list(found.values())


# -- what a reader should be warned of -------------------------------------------------------------------


def _warnings(log: Log, scenario: dict[str, Any], relays: dict[str, Survey], summary: Summary) -> list[str]:
    out = []
    if summary["log"]["recovered"]:
        out.append("this log was recovered from one that was cut off; its end is missing")
    wanted = scenario["scenario"].get("duration_s")
    if wanted is not None:
        step = max((rows.interval_ns for rows in relays.values() if len(rows) > 1), default=0.0)
        if summary["log"]["duration_s"] < wanted - 2 * step / 1e9:
            got = summary["log"]["duration_s"]
            out.append(f"the run ended early: {got:g} s of the scenario's {wanted:g} s are in the log")
    if not relays:
        out.append("the log has no relay")
    for name, whole in relays.items():
        out += relay_warnings(whole, summary["relays"][name], summary["inception"])
    if relays and FAULT_STATE.topic not in log.topics and summary["inception"]["t_ns"] is not None:
        out.append(f"the log does not say when the fault began; {summary['inception']['text']}")
    noted = [e for e in summary["events"] if e["level"] in ("WARNING", "ERROR", "FATAL")]
    out += [text for text in log.warnings if text not in out]
    return out + [f"{e['source']}: {e['text']}" for e in noted if not e["text"].startswith("PTRC")]
