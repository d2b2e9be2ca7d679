"""What a run put into its log about itself, as far as it can be read.

A log may come from anybody, and its metadata has no checksum: what is not as it should be counts as absent,
with a warning of the log's.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from typing import Any, TypeGuard

from faultloop.io.mcap_reader import Log

Tables = dict[str, Any]


def _is_number(value: object) -> TypeGuard[float]:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


def _is_text(value: object) -> bool:
    return isinstance(value, str)


def _is_frequency(value: object) -> bool:
    return _is_number(value) and 1 <= value <= 1000


def _is_positive(value: object) -> bool:
    return _is_number(value) and value > 0


def _is_impedance(value: object) -> bool:
    return isinstance(value, list) and len(value) == 2 and all(map(_is_number, value))


def _is_flag(value: object) -> bool:
    return isinstance(value, bool)


Kinds = Mapping[str, Callable[[object], bool]]
SCENARIO: Mapping[str, Kinds] = {
    "scenario": {"name": _is_text, "duration_s": _is_number},
    "system": {"frequency_hz": _is_frequency, "sampling_hz": _is_positive},
    "can": {"heartbeat_s": _is_positive, "keys": _is_text},
    "iec61850": {
        "sampled_values": _is_text,
        "vlan_id": _is_number,
        "vlan_priority": _is_number,
        "simulation": _is_flag,
    },
}
SCENARIO_LISTS: Mapping[str, Kinds] = {
    "relay": {"name": _is_text, "line": _is_text, "breaker": _is_text},
    "breaker": {"name": _is_text},
    "fault": {"name": _is_text, "line": _is_text, "bus": _is_text, "type": _is_text, "at_pu": _is_number,
              "at_km": _is_number, "resistance_ohm": _is_number, "ground_ohm": _is_number},
    "line": {"name": _is_text, "length_km": _is_positive, "r1_ohm_per_km": _is_number,
             "x1_ohm_per_km": _is_positive, "b1_us_per_km": _is_number},
}  # fmt: skip
SETTINGS: Mapping[str, Kinds] = {
    "relay": {"frequency_hz": _is_frequency, "ohms": _is_text, "ct_ratio": _is_positive,
              "vt_ratio": _is_positive},
    "line": {"z1_ohm": _is_impedance},
}  # fmt: skip


def recorded_scenario(log: Log) -> Tables:
    """Of the scenario what a reader of the log needs: [scenario], [system], [can], [iec61850] as dicts,
    [[relay]], [[breaker]], [[fault]], [[line]] as lists of dicts; a relay that has no name is not in it."""
    found = _json(log, "scenario", "json")
    out: Tables = {
        name: _checked(log, "scenario", name, found.get(name), kinds) for name, kinds in SCENARIO.items()
    }
    for name, kinds in SCENARIO_LISTS.items():
        tables = found.get(name) or []
        if not isinstance(tables, list):
            _warn(log, "scenario", name)
            tables = []
        out[name] = [_checked(log, "scenario", name, table, kinds) for table in tables]
    out["relay"] = [place for place in out["relay"] if "name" in place]
    return out


def recorded_settings(log: Log, relay: str) -> Tables:
    """Of a relay's settings [relay] and [line], as dicts."""
    found = _json(log, "settings", relay)
    what = f"settings.{relay}"
    return {name: _checked(log, what, name, found.get(name), kinds) for name, kinds in SETTINGS.items()}


def _json(log: Log, record: str, key: str) -> Tables:
    text = log.metadata.get(record, {}).get(key)
    if text is None:
        return {}
    try:
        found = json.loads(text)
    except (ValueError, RecursionError):
        found = None
    if not isinstance(found, dict):
        log.warn(f"metadata {record}.{key} cannot be read and counts as absent")
        return {}
    return found


def _checked(log: Log, what: str, name: str, table: object, kinds: Kinds) -> Tables:
    if table is None:
        return {}
    if not isinstance(table, dict):
        _warn(log, what, name)
        return {}
    out = {}
    for key, fits in kinds.items():
        value = table.get(key)
        if value is None:
            continue
        if fits(value):
            out[key] = value
        else:
            _warn(log, what, f"{name}.{key}")
    return out


def _warn(log: Log, what: str, key: str) -> None:
    log.warn(f"metadata {what}: {key} is not as it should be and counts as absent")
