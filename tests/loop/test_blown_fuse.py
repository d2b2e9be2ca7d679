"""A fuse that blows in a run, and what two ends of a line then make of faults."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import faultloop
from faultloop.loop.scenario import Scenario

SETTINGS = """
[relay]
frequency_hz = 50
nominal_kv = 220
[vt]
kind = "ideal"
[line]
z1_ohm = [6.0, 40.0]
z0_ohm = [24.0, 120.0]
[[pdis]]
zone = 1
reach_pu = 0.8
[[pdis]]
zone = 2
reach_pu = 1.4
delay_ms = 350
[[pdis]]
zone = 3
reach_pu = 0.5
direction = "reverse"
delay_ms = 1500
[tvtr]
[[ptoc]]
quantity = "residual"
pickup_a = 250.0
delay_ms = 60.0
when = "fuse-failure"
"""
LINE = {"model": "rl", "r1_ohm_per_km": 0.06, "x1_ohm_per_km": 0.4,
        "r0_ohm_per_km": 0.24, "x0_ohm_per_km": 1.2}  # fmt: skip


def run(folder: Path, scheme: str = "", **tables: Any) -> faultloop.Result:
    """A line of two ends whose RB loses what ``vt`` or ``ct`` says; with a scheme over a channel of 8 ms."""
    settings = folder / "ab.toml"
    settings.write_text(SETTINGS + scheme)
    ends = (("RA", "from", {}), ("RB", "to", {key: "T" for key in ("ct", "vt") if key in tables}))
    data: dict[str, Any] = {
        "scenario": {"name": "a blown fuse", "duration_s": 0.7},
        "system": {"frequency_hz": 50, "base_kv": 220},
        "source": [
            {"name": "SA", "bus": "A", "angle_deg": 12, "z1_ohm": [1.2, 14.0], "z0_ohm": [2.0, 11.0]},
            {"name": "SB", "bus": "B", "z1_ohm": [1.8, 20.0], "z0_ohm": [3.0, 17.0]},
        ],
        "line": [{"name": "AB", "from": "A", "to": "B", "length_km": 100, **LINE}],
        "breaker": [{"name": f"Q{name[1]}", "line": "AB", "end": end} for name, end, _ in ends],
        "relay": [
            {"name": name, "line": "AB", "end": end, "breaker": f"Q{name[1]}", "settings": str(settings)}
            | transformer
            for name, end, transformer in ends
        ],
    }
    if scheme:
        data["channel"] = [{"from": "RA", "to": "RB", "delay_ms": 8.0}]
    return faultloop.run(Scenario.from_dict(data | tables), user_code=False)


def vt(phases: str) -> list[dict[str, Any]]:
    return [{"name": "T", "ratio": [220e3, 110.0], "open_at_s": 0.2, "open_phases": phases}]


def fault(**keys: Any) -> list[dict[str, Any]]:
    return [{"type": "AG", "start_s": 0.45} | keys]


@pytest.mark.parametrize("phases", ["A", "B", "CA", "ABC"])
def test_a_blown_fuse_is_told_and_trips_nothing_and_a_fault_after_it_trips(
    tmp_path: Path, phases: str
) -> None:
    quiet = run(tmp_path, vt=vt(phases))
    assert not quiet.trips
    assert [e.text for e in quiet.events if "TVTR1 FuFail: voltage of phase" in e.text] == [
        f"TVTR1 FuFail: voltage of phase {''.join(sorted(phases))} without a fault's current; "
        "what needs it is blocked"
    ]
    trips = run(tmp_path, vt=vt(phases), fault=fault(line="AB", at_pu=0.5)).trips
    assert {(trip.relay, trip.function) for trip in trips} == {("RA", "PDIS1"), ("RB", "PTOC1")}


BLIND = {"vt": vt("A")}, {"ct": [{"name": "T", "ratio": [1000.0, 1.0], "open_at_s": 0.2}]}


@pytest.mark.parametrize("lost", BLIND)
@pytest.mark.parametrize(
    "scheme",
    ['[psch]\ntype = "pott"\nweak_infeed = "echo-and-trip"', '[psch]\ntype = "dcb"\ncoordination_ms = 15.0'],
)
def test_a_fault_behind_the_blind_end_is_not_tripped_by_the_scheme(
    tmp_path: Path, scheme: str, lost: dict[str, Any]
) -> None:
    """It is ahead of the other end, in zone 2: after 350 ms and not before."""
    result = run(tmp_path, scheme, **lost, fault=fault(bus="B", resistance_ohm=2.0))
    assert [trip for trip in result.trips if trip.function.startswith("PSCH")] == []
    sound = run(tmp_path, scheme, fault=fault(line="AB", at_pu=0.95))
    assert any(trip.function == "PSCH1" for trip in sound.trips)
