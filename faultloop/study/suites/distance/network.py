"""The test network X - A - B - C and the relays at A, as tables of a scenario and of settings.

    SX --- X ===XA=== A --QA-- ===AB=== B ===BC=== C --- SC
                      |
                      SA

A - B is protected.  Most tests have no X - A: the source SA at A then is all that lies behind, and its ratio
to the line is the SIR.  The far source's impedance is that of the line, if nothing else is said.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

BASE_KV = 220.0
LINE = {
    "r1_ohm_per_km": 0.06, "x1_ohm_per_km": 0.40, "b1_us_per_km": 2.8,
    "r0_ohm_per_km": 0.24, "x0_ohm_per_km": 1.20, "b0_us_per_km": 1.8,
}  # fmt: skip
Z1_OHM_PER_KM = complex(LINE["r1_ohm_per_km"], LINE["x1_ohm_per_km"])
Z0_OHM_PER_KM = complex(LINE["r0_ohm_per_km"], LINE["x0_ohm_per_km"])
Z0_OVER_Z1_OF_SOURCE = 1.5
ANTIALIAS_HZ = 1500.0
ANTIALIAS_ORDER = 4
REACH = 0.8
"""Of zone 1, per unit of the line."""
FAULT_S = 0.06
"""The fault begins at the first point on wave after this time."""
NEVER_MS = 1e5
"""Operating time of the breaker: no test of a trip is cut short by what the trip does."""

Tables = dict[str, Any]


@dataclass(frozen=True)
class Network:
    """What differs from test to test; the rest is the same in all.

    Attributes
    ----------
    sir : source at A over the line; at the line's angle.
    far_sir : source at C over the line; None: the far end is open, nothing feeds from there.
    angle_deg : by which SA leads SC.
    behind_km, beyond_km : lines X - A and B - C; 0: there is none, and the source is at A, at B.
    more : further tables of the scenario.
    relay : further keys of every ``[[relay]]``.
    """

    sir: float = 1.0
    length_km: float = 100.0
    frequency_hz: int = 50
    model: str = "bergeron"
    far_sir: float | None = 1.0
    angle_deg: float = 8.0
    behind_km: float = 0.0
    beyond_km: float = 80.0
    source_hz: float | None = None
    duration_s: float = 0.2
    antialias_hz: float = ANTIALIAS_HZ
    breaker: Mapping[str, Any] = field(default_factory=dict)
    more: Mapping[str, Any] = field(default_factory=dict)
    relay: Mapping[str, Any] = field(default_factory=dict)
    front_end: Mapping[str, Any] = field(default_factory=dict)

    @property
    def z1_ohm(self) -> complex:
        """Of A - B."""
        return Z1_OHM_PER_KM * self.length_km

    @property
    def z0_ohm(self) -> complex:
        return Z0_OHM_PER_KM * self.length_km

    def scenario(self, relays: Mapping[str, Tables], fault: Mapping[str, Any] | None) -> Tables:
        """The scenario's tables; ``fault`` without its time where that is the usual one."""
        tables: Tables = {
            "scenario": {"name": "distance suite", "duration_s": self.duration_s, "seed": 1},
            "system": {"frequency_hz": self.frequency_hz, "base_kv": BASE_KV},
            "source": self._sources(),
            "line": self._lines(),
            "breaker": [{"name": "QA", "line": "AB", "end": "from", "operate_ms": NEVER_MS, **self.breaker}],
            "relay": [
                {"name": name, "line": "AB", "end": "from", "breaker": "QA", "settings": f"{name}.toml"}
                | dict(self.relay)
                for name in relays
            ],
            "front_end": {
                "antialias_hz": self.antialias_hz,
                "antialias_order": ANTIALIAS_ORDER,
                **self.front_end,
            },
        }
        if fault is not None:
            time = {} if "start_s" in fault else {"angle_deg": 0.0, "after_s": FAULT_S}
            tables["fault"] = [{"name": "F1", "type": "AG"} | time | dict(fault)]
        for name, own in self.more.items():
            tables[name] = [*tables.get(name, []), *own]
        return tables

    def _lines(self) -> list[Tables]:
        lengths = {"AB": self.length_km, "XA": self.behind_km, "BC": self.beyond_km}
        values = {key: x for key, x in LINE.items() if self.model != "rl" or not key.startswith("b")}
        return [
            {"name": name, "from": name[0], "to": name[1], "length_km": km, "model": self.model, **values}
            for name, km in lengths.items()
            if km
        ]

    def _sources(self) -> list[Tables]:
        own = {"frequency_hz": self.source_hz} if self.source_hz is not None else {}
        near = "X" if self.behind_km else "A"
        found = [{"name": "SA", "bus": near, "angle_deg": self.angle_deg, **self._impedance(self.sir), **own}]
        if self.far_sir is not None:
            far = "C" if self.beyond_km else "B"
            found.append({"name": "SC", "bus": far, "angle_deg": 0.0, **self._impedance(self.far_sir), **own})
        return found

    def _impedance(self, sir: float) -> Tables:
        z1 = sir * self.z1_ohm
        z0 = Z0_OVER_Z1_OF_SOURCE * z1
        return {"z1_ohm": [z1.real, z1.imag], "z0_ohm": [z0.real, z0.imag]}

    def settings(self, *zones: Tables, **tables: Any) -> Tables:
        """Settings of a relay of A - B with these zones; ``tables``: more of them, None for none.

        It is told that its voltage transformer is ideal where there is no other."""
        z1, z0 = self.z1_ohm, self.z0_ohm
        own: Tables = {
            "relay": {"frequency_hz": self.frequency_hz, "nominal_kv": BASE_KV},
            "line": {"z1_ohm": [z1.real, z1.imag], "z0_ohm": [z0.real, z0.imag]},
            "pdis": list(zones),
            "vt": None if "vt" in self.more else {"kind": "ideal"},
        }
        own |= tables
        return {name: table for name, table in own.items() if table is not None}

    def mho(self, reach_pu: float = REACH, **keys: Any) -> Tables:
        """A zone."""
        return {"zone": 1, "reach_pu": reach_pu, **keys}

    def quad(self, reach_pu: float = REACH, **keys: Any) -> Tables:
        """A zone whose resistive reach is half the line's reactance to three quarters of it."""
        x = self.z1_ohm.imag
        resistive = {"resistive_reach_ohm": 0.5 * x, "resistive_reach_ground_ohm": 0.75 * x}
        return {"zone": 1, "characteristic": "quad", "reach_pu": reach_pu, **resistive, **keys}
