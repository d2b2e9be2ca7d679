"""Two relays that decide together, as their processes run them, on a bus where much goes wrong."""

from __future__ import annotations

from pathlib import Path

import pytest

import faultloop
from faultloop.loop.scenario import Scenario
from tests.live.in_one_process import OneProcess
from tests.vcan import needs_vcan, passes_on_vcan

SCENARIOS = Path(__file__).resolve().parents[2] / "scenarios"
MS = 1_000_000
FAULT_S = 0.45
FAULTS = """
[[bus_fault]]
kind = "loss"
node = "RA"
message = "{message}"
probability = 0.2
duration_s = 0.4

[[bus_fault]]
kind = "forging"
node = "RB"
message = "{message}"
content = "{content}"
rate_hz = 1000
"""


def disturbed(folder: Path, name: str, message: str, content: str, keys: bool = False) -> Scenario:
    """The shipped scenario with a late, bolted fault near B, losses of one end and a forger of the other."""
    path = folder / f"{name}.toml"
    text = (SCENARIOS / f"{name}.toml").read_text(encoding="utf-8")
    text = text.replace('"settings/', f'"{SCENARIOS.as_posix()}/settings/')
    path.write_text(text + FAULTS.format(message=message, content=content), encoding="utf-8")
    fault = [f"fault.F1.after_s={FAULT_S}", "fault.F1.at_pu=0.9", "fault.F1.resistance_ohm=1.0"]
    overrides = [*fault, "scenario.duration_s=0.56", "can.heartbeat_s=0.05", "can.fd=true"]
    if keys:
        secret = folder / "keys.toml"
        secret.write_text(f'default = "{bytes(range(16)).hex()}"\n', encoding="utf-8")
        secret.chmod(0o600)
        overrides.append("can.keys='keys.toml'")
    return faultloop.load_scenario(path, overrides)


@pytest.mark.parametrize(
    ("name", "message", "content", "keys", "far"),
    [
        ("line-differential", "differential", "crafted", True, "PDIF1"),
        pytest.param("line-differential", "differential", "random", False, "PDIF1", marks=pytest.mark.slow),
        pytest.param("line-differential", "differential", "replayed", False, "PDIF1", marks=pytest.mark.slow),
        pytest.param("pott", "pilot", "random", False, "PSCH1", marks=pytest.mark.slow),
        pytest.param("pott", "pilot", "replayed", False, "PSCH1", marks=pytest.mark.slow),
        pytest.param("pott", "pilot", "crafted", True, "PSCH1", marks=pytest.mark.slow),
    ],
)
def test_killed_lossy_and_forged_only_the_fault_trips(
    tmp_path: Path, name: str, message: str, content: str, keys: bool, far: str
) -> None:
    """RB is away from 50 to 150 ms, RA's frames are lost, somebody sends in RB's name; the fault comes when
    RB has been back for a while, and both ends trip, RA by what it hears of RB."""
    scenario = disturbed(tmp_path, name, message, content, keys)
    run = OneProcess(scenario, away={"RB": (50 * MS, 150 * MS)})
    trips = run.run()
    assert {trip[0] for trip in trips} == {"RA", "RB"}, trips
    assert all(trip[5] > FAULT_S * 4800 for trip in trips), trips
    assert far in {trip[1] for trip in trips if trip[0] == "RA"}
    assert run.hits["B1"] > 0
    assert sum(run.relays["RA"].node.rejected.values()) > 50  # the forger's


def test_a_forger_who_knows_the_line_is_why_there_are_keys(tmp_path: Path) -> None:
    """Without keys a set of the right line with a right CRC, sent before the true one, is taken: what was
    said of trip frames holds."""
    run = OneProcess(disturbed(tmp_path, "line-differential", "differential", "crafted"))
    assert any(trip[5] < FAULT_S * 4800 for trip in run.run())


def test_clocks_that_the_plant_sets(tmp_path: Path) -> None:
    """100 ms apart and drifting: by TIME_SYNC the processes have one time, and the fault trips both ends."""
    text = (SCENARIOS / "line-differential.toml").read_text(encoding="utf-8")
    text = text.replace('"settings/', f'"{SCENARIOS.as_posix()}/settings/')
    clocks = "".join(
        f'\n[[clock]]\nnode = "{node}"\noffset_us = {offset}\ndrift_ppm = {ppm}\n'
        for node, offset, ppm in (("RA", -20_000.0, 100.0), ("RB", 80_000.0, -100.0))
    )
    (tmp_path / "s.toml").write_text(text + clocks + "\n[time_sync]\nperiod_s = 0.05\n", encoding="utf-8")
    keys = ["scenario.duration_s=0.18", "fault.F1.resistance_ohm=100.0"]  # which no zone sees
    run = OneProcess(faultloop.load_scenario(tmp_path / "s.toml", keys))
    trips = run.run()
    assert {trip[0] for trip in trips} == {"RA", "RB"}
    assert {trip[1] for trip in trips} >= {"PDIF1"}
    assert all(trip[5] > 0.1 * 4800 for trip in trips)


@needs_vcan
@pytest.mark.slow
def test_on_vcan(root: Path) -> None:
    passes_on_vcan(root, Path(__file__).with_name("both_ends_on_vcan.py"), 900)
