"""Small scenarios and settings as dicts, for tests to change."""

from __future__ import annotations

import copy
from typing import Any

SCENARIO: dict[str, Any] = {
    "scenario": {"name": "test", "duration_s": 0.3},
    "system": {"frequency_hz": 50, "base_kv": 220},
    "source": [
        {"name": "SA", "bus": "A", "z1_ohm": [1.2, 14.0], "z0_ohm": [2.0, 11.0]},
        {"name": "SB", "bus": "B", "angle_deg": -10, "z1_ohm": [1.8, 20.0], "z0_ohm": [3.0, 17.0]},
    ],
    "line": [
        {
            "name": "AB",
            "from": "A",
            "to": "B",
            "length_km": 100,
            "r1_ohm_per_km": 0.06,
            "x1_ohm_per_km": 0.40,
            "b1_us_per_km": 2.8,
            "r0_ohm_per_km": 0.24,
            "x0_ohm_per_km": 1.20,
            "b0_us_per_km": 1.8,
        }
    ],
    "fault": [{"line": "AB", "at_pu": 0.5, "type": "AG", "start_s": 0.1}],
    "breaker": [
        {"name": "QA", "line": "AB", "end": "from"},
        {"name": "QB", "line": "AB", "end": "to"},
    ],
    "relay": [
        {"name": "RA", "line": "AB", "end": "from", "breaker": "QA", "settings": "settings/ab-mho.toml"},
        {"name": "RB", "line": "AB", "end": "to", "breaker": "QB", "settings": "settings/ab-mho.toml"},
    ],
}


def scenario(**tables: Any) -> dict[str, Any]:
    """A copy of the scenario; ``fault=[...]`` replaces a table, ``system={...}`` updates one."""
    data = copy.deepcopy(SCENARIO)
    for name, value in tables.items():
        if isinstance(value, dict) and isinstance(data.get(name), dict):
            data[name] |= value
        else:
            data[name] = value
    return data
