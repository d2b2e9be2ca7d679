"""Two relays that decide together, as processes on a real bus: run by test_both_ends.py where vcan0 is."""

from __future__ import annotations

from pathlib import Path

import pytest

import faultloop
from faultloop.live.merge import merge
from faultloop.live.supervisor import Supervisor
from faultloop.loop.outcome import Cast, Outcome, outcome_of

SCENARIOS = Path(__file__).resolve().parents[2] / "scenarios"
CAN = "socketcan:vcan0"
PACE = 0.05
FAULT_S = 3.0
"""RB is back by then: its process takes 15 to 50 s of wall time to start in the tests' guest."""
FAULTS = """
[[bus_fault]]
kind = "loss"
node = "RA"
message = "{message}"
probability = 0.2
duration_s = 2.9

[[bus_fault]]
kind = "forging"
node = "RB"
message = "{message}"
content = "{content}"
rate_hz = 100
"""


def run(folder: Path, name: str, message: str, content: str) -> tuple[Outcome, Supervisor]:
    """RB is killed at 0.05 s of the run and started anew, RA loses frames, somebody forges RB's."""
    path = folder / f"{name}.toml"
    text = (SCENARIOS / f"{name}.toml").read_text(encoding="utf-8")
    text = text.replace('"settings/', f'"{SCENARIOS.as_posix()}/settings/')
    text = text.replace("duration_s = 0.5", "duration_s = 3.6").replace(
        "after_s = 0.1", f"after_s = {FAULT_S}"
    )
    text = text.replace("at_pu = 0.5", "at_pu = 0.9")
    text = text.replace("resistance_ohm = 300.0", "resistance_ohm = 1.0").replace(
        "[can]", "[can]\nheartbeat_s = 0.05"
    )
    if "[can]" not in text:
        text += "\n[can]\nheartbeat_s = 0.05\n"
    path.write_text(text + FAULTS.format(message=message, content=content), encoding="utf-8")
    scenario = faultloop.load_scenario(path)
    supervisor = Supervisor(scenario, CAN, PACE, (), folder / "nodes")
    try:
        clock = supervisor.begin()
        while clock.now_ns() < 50_000_000:
            supervisor.listen()
        supervisor.kill("RB")
        supervisor.restart("RB")
        supervisor.run()
        supervisor.finish()
    finally:
        supervisor.close()
    out = folder / "merged.mcap"
    merge(supervisor.logs, out, clock.start_ns, {}, {})
    return outcome_of(faultloop.open_log(out), Cast.of_scenario(scenario)), supervisor


@pytest.mark.parametrize(
    ("name", "message", "content"),
    [
        ("line-differential", "differential", "random"),
        ("line-differential", "differential", "replayed"),
        ("pott", "pilot", "random"),
        ("pott", "pilot", "replayed"),
    ],
)
def test_only_the_fault_trips(tmp_path, name, message, content):
    """By which function is a question of time: under load zone 2 may be sooner than the channel."""
    result, supervisor = run(tmp_path, name, message, content)
    assert supervisor.died == []
    assert {trip.relay for trip in result.trips} == {"RA", "RB"}
    assert all(trip.t_ns > FAULT_S * 1e9 for trip in result.trips)
    hits = [child.statistics.get("bus_faults", {}).get("B1", 0) for child in supervisor.children]
    assert sum(hits) > 0
    refused = [child.statistics.get("rejected", {}) for child in supervisor.children if child.name == "RA"]
    assert sum(sum(own.values()) for own in refused) > 20
