"""Networks with relays at both ends, and a case on one of them: what is expected of each relay, what it did.

line      SA --- A ===AB=== B ===BC=== C --- SC          relays RA, RB on AB
parallel  SA --- A ===L1=== B --- SB                     relays R1A, R1B, R2A, R2B
                 A ===L2=== B
tee       A, B, C each with a source, 40 km to T         relays RA, RB, RC
"""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from faultloop.loop.case import CaseOutcome, Cases
from faultloop.loop.recording import Sink
from faultloop.loop.scenario import Scenario
from faultloop.relay import RelaySettings
from faultloop.study.suites.distance.network import BASE_KV, LINE, Z0_OVER_Z1_OF_SOURCE

Tables = dict[str, Any]
LENGTH_KM, BEYOND_KM = 100.0, 80.0
Z1 = complex(LINE["r1_ohm_per_km"], LINE["x1_ohm_per_km"]) * LENGTH_KM
Z0 = complex(LINE["r0_ohm_per_km"], LINE["x0_ohm_per_km"]) * LENGTH_KM
FAULT_S = 0.06
"""The fault begins at the first point on wave after this time."""
TYPES = ("AG", "BG", "CG", "AB", "BC", "CA", "ABG", "BCG", "CAG", "ABC")
NEVER_MS = 1e5
CHANNEL_MS = 5.0
ZONES: list[Tables] = [
    {"zone": 1, "direction": "forward", "reach_pu": 0.8},
    {"zone": 2, "direction": "forward", "reach_pu": 1.5, "delay_ms": 350.0},
    {"zone": 3, "direction": "reverse", "reach_pu": 1.5, "delay_ms": 1e6},
]


def source(name: str, bus: str, ohm: float, angle_deg: float = 0.0) -> Tables:
    """A source of so many ohms, at the line's angle."""
    z1 = ohm * Z1 / abs(Z1)
    z0 = Z0_OVER_Z1_OF_SOURCE * z1
    own = {"z1_ohm": [z1.real, z1.imag], "z0_ohm": [z0.real, z0.imag]}
    return {"name": name, "bus": bus, "angle_deg": angle_deg, **own}


def line(name: str, start: str, end: str, km: float = LENGTH_KM) -> Tables:
    """A line of the suite."""
    return {"name": name, "from": start, "to": end, "length_km": km, "model": "bergeron", **LINE}


def end(relay: str, on: str, which: str, operate_ms: float = NEVER_MS) -> tuple[Tables, Tables]:
    """A relay and its breaker."""
    breaker = {"name": f"Q{relay[1:]}", "line": on, "end": which, "operate_ms": operate_ms}
    return {"name": relay, "line": on, "end": which, "breaker": breaker["name"],
            "settings": "none.toml"}, breaker  # fmt: skip


def settings(**tables: Any) -> Tables:
    """Of every relay of a case; ``psch`` and the like, None for none."""
    own: Tables = {
        "relay": {"frequency_hz": 50, "nominal_kv": BASE_KV},
        "line": {"z1_ohm": [Z1.real, Z1.imag], "z0_ohm": [Z0.real, Z0.imag]},
        "vt": {"kind": "ideal"},
        "pdis": ZONES,
        "ptrc": {"zones": [1, 2]},
    }
    own |= tables
    return {name: table for name, table in own.items() if table is not None}


def single_line(
    sources: tuple[float | None, float | None] = (14.0, 20.0),
    channel: Mapping[str, Any] | None = None,
    duration_s: float = 0.3,
    length_km: float = LENGTH_KM,
    source_hz: float | None = None,
    **more: Any,
) -> Tables:
    """The one line; a source that is None is not there."""
    ends = [end("RA", "AB", "from"), end("RB", "AB", "to")]
    near, far = sources
    own = {} if source_hz is None else {"frequency_hz": source_hz}
    return {
        "scenario": {"name": "schemes", "duration_s": duration_s, "seed": 1},
        "system": {"frequency_hz": 50, "base_kv": BASE_KV},
        "source": [
            *([source("SA", "A", near, 8.0) | own] if near is not None else []),
            *([source("SC", "C", far) | own] if far is not None else []),
        ],
        "line": [line("AB", "A", "B", length_km), line("BC", "B", "C", BEYOND_KM)],
        "relay": [relay for relay, _ in ends],
        "breaker": [breaker for _, breaker in ends],
        "channel": [{"from": "RA", "to": "RB", "delay_ms": CHANNEL_MS, **(channel or {})}],
        **more,
    }


def parallel_lines(
    ohms: tuple[float, float],
    breaker_ms: tuple[float, float] = (NEVER_MS, NEVER_MS),
    delay_ms: float = CHANNEL_MS,
    duration_s: float = 0.25,
    load_deg: float = 8.0,
    **more: Any,
) -> Tables:
    """Two equal lines; the breakers of both at A and at B take so long; A's source is so far ahead."""
    ends = [
        end(f"R{n}{bus}", f"L{n}", which, breaker_ms[k])
        for n in (1, 2)
        for k, (bus, which) in enumerate((("A", "from"), ("B", "to")))
    ]
    return {
        "scenario": {"name": "schemes", "duration_s": duration_s, "seed": 1},
        "system": {"frequency_hz": 50, "base_kv": BASE_KV},
        "source": [source("SA", "A", ohms[0], load_deg), source("SB", "B", ohms[1])],
        "line": [line("L1", "A", "B"), line("L2", "A", "B")],
        "relay": [relay for relay, _ in ends],
        "breaker": [breaker for _, breaker in ends],
        "channel": [{"from": f"R{n}A", "to": f"R{n}B", "delay_ms": delay_ms} for n in (1, 2)],
        **more,
    }


PAIRS = (("RA", "RB"), ("RB", "RC"), ("RA", "RC"))
"""Of the relays of three ends."""
LEG_KM = 40.0


def three_ended(
    faults: list[Tables],
    channels: Mapping[tuple[str, str], Mapping[str, Any]] | None = None,
    duration_s: float = 0.2,
    **more: Any,
) -> Tables:
    """A line with a tee, 40 km to each end; relays RA, RB, RC, every two of them with a channel of 2 ms."""
    ends = [end(f"R{bus}", f"{bus}T", "from") for bus in "ABC"]
    ohms = (14.0, 20.0, 40.0)
    return {
        "scenario": {"name": "three ends", "duration_s": duration_s, "seed": 1},
        "system": {"frequency_hz": 50, "base_kv": BASE_KV},
        "source": [
            source(f"S{bus}", bus, ohm, 4.0 * k) for k, (bus, ohm) in enumerate(zip("ABC", ohms, strict=True))
        ],
        "line": [line(f"{bus}T", bus, "T", LEG_KM) for bus in "ABC"],
        "relay": [relay for relay, _ in ends],
        "breaker": [breaker for _, breaker in ends],
        "channel": [
            {"from": a, "to": b, "delay_ms": 2.0} | dict((channels or {}).get((a, b), {})) for a, b in PAIRS
        ],
        "fault": faults,
        **more,
    }


def fault(on: str, at_pu: float, kind: str, angle_deg: float = 0.0, **more: Any) -> Tables:
    """A fault at a point on wave, at the usual time."""
    own = {"line": on, "at_pu": at_pu, "type": kind}
    return own | ({"angle_deg": angle_deg, "after_s": FAULT_S} if "start_s" not in more else {}) | more


class Expected(NamedTuple):
    """Of one relay: whether it trips, by which function, when [ms after the first fault], which poles, and a
    text that one of its events must have."""

    trips: bool
    function: str | None = None
    within_ms: float = math.inf
    after_ms: float = 0.0
    poles: str | None = None
    event: str | None = None
    never: str | None = None
    """A text that none of its events may have."""

    def __str__(self) -> str:
        if not self.trips:
            said = f", {self.event}" if self.event else ""
            return "no trip" + said + (f", no {self.never}" if self.never else "")
        parts = ["trip", self.function or "", f"poles {self.poles}" if self.poles else ""]
        parts.append(f"> {self.after_ms:g} ms" if self.after_ms else "")
        parts.append(f"< {self.within_ms:g} ms" if self.within_ms < math.inf else "")
        return " ".join(part for part in (*parts, self.event or "") if part)


@dataclass(frozen=True)
class Case:
    """A scenario, what its relays are set to, and what is expected of each of those named."""

    name: str
    scenario: Tables
    settings: Tables
    expected: Mapping[str, Expected]
    own: Mapping[str, Tables] = field(default_factory=dict)
    """Settings of single relays, in place of the common ones."""


class Row(NamedTuple):
    """What one relay did in a case."""

    case: str
    relay: str
    expected: Expected
    got: str
    ms: float
    """From the first fault to the trip's reception at the breaker; NaN without one."""
    right: bool

    @property
    def cells(self) -> tuple[object, ...]:
        """For a table."""
        return (
            self.case,
            self.relay,
            str(self.expected),
            self.got,
            self.ms,
            "right" if self.right else "WRONG",
        )


COLUMNS = ("case", "relay", "expected", "got", ">ms", "verdict")


class Bench:
    """Runs cases one after the other; relays and networks are kept."""

    def __init__(self) -> None:
        self._cases = Cases()
        self._settings: dict[str, RelaySettings] = {}

    def outcome(self, case: Case, sinks: Sequence[Sink] = ()) -> CaseOutcome:
        """What happens in a case; `sinks` get all of it."""
        scenario = Scenario.from_dict(copy.deepcopy(case.scenario))
        own = {place.name: self._parsed(case.own.get(place.name, case.settings)) for place in scenario.relay}
        return self._cases.prepare(scenario, own).run(sinks)

    def run(self, case: Case) -> list[Row]:
        """A row for each relay of which something is expected."""
        outcome = self.outcome(case)
        start_ns = outcome.fault_start_ns or 0
        return [
            self._row(case, relay, expected, outcome, start_ns) for relay, expected in case.expected.items()
        ]

    def _parsed(self, tables: Tables) -> RelaySettings:
        key = repr(tables)
        if key not in self._settings:
            self._settings[key] = RelaySettings.from_dict(copy.deepcopy(tables))
        return self._settings[key]

    @staticmethod
    def _row(case: Case, relay: str, expected: Expected, outcome: CaseOutcome, start_ns: int) -> Row:
        trips = [trip for trip in outcome.trips if trip.relay == relay]
        first = trips[0] if trips else None
        ms = math.nan
        got = "no trip"
        right = (first is not None) == expected.trips
        if first is not None:
            at_ns = first.received_ns if first.received_ns is not None else first.t_ns
            ms = (at_ns - start_ns) / 1e6
            got = f"{first.function} poles {first.pole_names}"
            right &= expected.function in (None, first.function)
            right &= expected.after_ms <= ms <= expected.within_ms
            right &= expected.poles in (None, first.pole_names)
        if expected.event is not None:
            said = any(expected.event in e.text for e in outcome.events if e.source == relay)
            right &= said
            got += f", {expected.event}" if said else f", nothing of {expected.event}"
        if expected.never is not None and any(
            expected.never in e.text for e in outcome.events if e.source == relay
        ):
            right, got = False, f"{got}, {expected.never}"
        return Row(case.name, relay, expected, got, ms, right)
