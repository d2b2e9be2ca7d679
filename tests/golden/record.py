"""What of a run a golden log keeps, and how two of them differ."""

from __future__ import annotations

import hashlib
import json
import math
from typing import Any

import numpy as np

from faultloop import Log, Result

EVERY = 97
"""One row in so many is kept: no multiple of a cycle, so that all phases of it come up."""
TOLERANCE = 1e-9
"""Of the largest value in a row: other processors round the last digits otherwise."""
DIGITS = 12


def golden(result: Result, log: Log) -> dict[str, Any]:
    """The outcome, a digest of the messages of each rare topic and of the elements, and rows of numbers."""
    return {
        "outcome": _outcome(result),
        "messages": {topic: _digest(log, topic) for topic in log.topics if _is_rare(topic)},
        "elements": {name: _elements(log, name) for name in log.relays},
        "rows": {name: _rows(log, name) for name in log.relays},
    }


def differences(before: Any, now: Any, where: str = "") -> list[str]:
    """One line for each place that differs; numbers of ``rows`` may differ by `TOLERANCE` of their row."""
    if isinstance(before, dict) and isinstance(now, dict):
        keys = dict.fromkeys([*before, *now])
        return [
            line
            for key in keys
            for line in differences(before.get(key), now.get(key), f"{where}.{key}" if where else key)
        ]
    if isinstance(before, list) and isinstance(now, list) and len(before) == len(now):
        if where.startswith("rows.") and before and not isinstance(before[0], list):
            return _row_differences(before, now, where)
        return [
            line
            for i, (a, b) in enumerate(zip(before, now, strict=True))
            for line in differences(a, b, f"{where}[{i}]")
        ]
    return [] if before == now else [f"{where}: {_short(before)} -> {_short(now)}"]


def _row_differences(before: list[Any], now: list[Any], where: str) -> list[str]:
    largest = max((abs(x) for x in before if x is not None), default=0.0)
    return [
        f"{where}[{i}]: {a} -> {b}"
        for i, (a, b) in enumerate(zip(before, now, strict=True))
        if (a is None) != (b is None) or (a is not None and abs(a - b) > TOLERANCE * largest)
    ]


def _outcome(result: Result) -> dict[str, Any]:
    return {
        "trips": [
            {
                "relay": trip.relay,
                "function": trip.function,
                "zone": trip.zone,
                "loop": trip.loop,
                "poles": trip.pole_names,
                "decided_ns": trip.t_ns,
                "received_ns": trip.received_ns,
                "opened_ns": trip.opened_ns,
            }
            for trip in result.trips
        ],
        "faults": [[change.fault, change.type, change.on, change.t_ns] for change in result.faults],
        "events": [f"{event.t_ns} {event.source} {event.level} {event.text}" for event in result.events],
        "expectations": [[verdict.held, verdict.why] for verdict in result.expectations],
        "locations": {name: _number(value, 6) for name, value in result.fault_locations.items()},
        "can_frames": result.can_frames,
    }


def _is_rare(topic: str) -> bool:
    return topic.rpartition("/")[2] not in ("samples", "phasors", "loops", "elements")


def _digest(log: Log, topic: str) -> list[Any]:
    """How many messages, and a digest of their decoded fields; frames' bytes as hex."""
    rows = log.array(topic)
    names = rows.dtype.names or ()
    text = "\n".join(
        json.dumps(dict(zip(names, row, strict=True)), default=_plain, sort_keys=True)
        for row in rows.tolist()
    )
    return [len(rows), hashlib.sha256(text.encode()).hexdigest()[:16]]


def _plain(value: Any) -> Any:
    return value.hex() if isinstance(value, bytes) else str(value)


def _elements(log: Log, relay: str) -> str:
    rows = log.elements(relay)
    digest = hashlib.sha256()
    for name in ("t_ns", "pickup", "operate"):
        digest.update(np.ascontiguousarray(rows[name]).tobytes())
    return digest.hexdigest()[:16]


def _rows(log: Log, relay: str) -> dict[str, list[list[float | None]]]:
    kept = {}
    for what in ("samples", "phasors"):
        rows = getattr(log, what)(relay)[::EVERY]
        columns = [name for name in rows.dtype.names if rows[name].dtype.kind == "f"]
        kept[what] = [[_number(float(row[name])) for name in columns] for row in rows]
    return kept


def _number(value: float, digits: int = DIGITS) -> float | None:
    return None if math.isnan(value) else float(f"{value:.{digits}g}")


def _short(value: Any) -> str:
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) < 100 else f"{text[:97]}..."
