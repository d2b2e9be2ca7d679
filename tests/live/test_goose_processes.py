"""The same scenario over CAN and over GOOSE: plant, relays and breakers as processes on a virtual
Ethernet."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

import faultloop
from faultloop.errors import InputError
from faultloop.live.supervisor import Supervisor
from faultloop.loop.scenario import load_scenario
from tests.veth import needs_veth, veth_pair

pytest.importorskip("open61850")

PACES = (0.2, 0.05, 0.0125)
LATE_MS = 50.0
FAULTS = """
[[bus_fault]]
kind = "loss"
probability = 0.2
message = "trip"

[[bus_fault]]
kind = "delay"
probability = 0.3
delay_ms = 1.0
jitter_ms = 2.0
message = "trip"

[[bus_fault]]
kind = "duplication"
probability = 0.3
"""
FIELDS = "[t.relay, t.function, t.zone, t.loop, t.poles, t.sample_count, t.received_ns is not None]"
Trips = list[list[object]]


def over_goose(scenario: Path, log: Path, overrides: tuple[str, ...] = ()) -> tuple[Trips, dict[str, int]]:
    """Its trips as processes decide them, and how many frames each kind of fault hit.

    In a program of its own: the nodes' fork server has the environment in which it was started.
    """
    with veth_pair() as (interface, _):
        program = f"""
import json
from pathlib import Path
from faultloop.io.mcap_reader import open_log
from faultloop.live.supervisor import run_processes
for pace in {PACES}:
    result = run_processes(Path({str(scenario)!r}), can="goose:{interface}", pace=pace,
                           log=Path({str(log)!r}), overrides={overrides!r})
    if max(late.greatest * pace for late in result.pacing.latency.values()) < {LATE_MS}:
        break
trips = [{FIELDS} for t in result.trips]
told = [e.message for e in open_log(Path({str(log)!r})).events]
texts = [text for text in told if text.startswith("bus fault")]
print(json.dumps([sorted(trips), texts]))
"""
        done = subprocess.run([sys.executable, "-c", program], check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    trips, texts = json.loads(done.stdout.splitlines()[-1])
    return trips, {text.split(":")[0].split()[-1]: int(text.split(":")[1].split()[0]) for text in texts}


def simulated(scenario: Path, overrides: tuple[str, ...] = ()) -> Trips:
    """The same over the model of CAN."""
    result = faultloop.run(scenario, overrides=overrides, keep=False)
    return sorted(
        [t.relay, t.function, t.zone, t.loop, t.poles, t.sample_count, t.received_ns is not None]
        for t in result.trips
    )


@needs_veth
def test_processes_trip_over_goose_as_over_can(root: Path, tmp_path: Path) -> None:
    scenario = root / "scenarios" / "ag-zone1.toml"
    trips, _ = over_goose(scenario, tmp_path / "run.mcap")
    assert trips == simulated(scenario)
    assert len(trips) >= 2


@needs_veth
@pytest.mark.slow
@pytest.mark.parametrize("name", ["clearing-both-ends", "single-pole-trip", "bc-60-percent"])
def test_every_kind_of_scenario_decides_the_same(name: str, root: Path, tmp_path: Path) -> None:
    scenario = root / "scenarios" / f"{name}.toml"
    trips, _ = over_goose(scenario, tmp_path / "run.mcap")
    assert trips == simulated(scenario)


@needs_veth
@pytest.mark.slow
def test_a_pilot_scheme_decides_the_same(root: Path, tmp_path: Path) -> None:
    """When it trips depends on when the other end's signal comes, which on a real network is not to the
    sample."""
    scenario = root / "scenarios" / "pott.toml"
    trips, _ = over_goose(scenario, tmp_path / "run.mcap")
    wanted = simulated(scenario)
    assert [trip[:5] for trip in trips] == [trip[:5] for trip in wanted]
    assert any(trip[1] == "PSCH1" for trip in trips)


@needs_veth
@pytest.mark.slow
def test_loss_delay_and_duplication_befall_goose_too(root: Path, tmp_path: Path) -> None:
    """What they hit is told; the decisions are those of a run without them, as every trip is repeated."""
    (tmp_path / "settings").symlink_to(root / "scenarios" / "settings")
    scenario = tmp_path / "faulty.toml"
    scenario.write_text((root / "scenarios" / "ag-zone1.toml").read_text() + FAULTS)
    trips, hits = over_goose(scenario, tmp_path / "run.mcap")
    clean = simulated(root / "scenarios" / "ag-zone1.toml")
    assert trips == clean
    assert hits["B1"] > 0 < hits["B2"]
    assert hits["B3"] > 300


@needs_veth
@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (["system.sampling_hz=5000"],
         r"system\.sampling_hz: 5000 is the rate of no Sampled Values at 50 Hz; it can be 4000 "),
        (["iec61850.sampled_values=\"9-2LE\""],
         r"system\.sampling_hz: 4800 is the rate of no Sampled Values at 50 Hz; it can be 4000 "),
    ],
)  # fmt: skip
def test_a_scenario_that_goose_cannot_carry_is_one_line(
    overrides: list[str], words: str, root: Path, tmp_path: Path
) -> None:
    scenario = load_scenario(root / "scenarios" / "ag-zone1.toml", overrides)
    with pytest.raises(InputError, match=words):
        Supervisor(scenario, "goose:lo", 1.0, (), tmp_path)


@needs_veth
def test_bus_faults_that_are_of_can_are_one_line(root: Path, tmp_path: Path) -> None:
    scenario = tmp_path / "s.toml"
    (tmp_path / "settings").symlink_to(root / "scenarios" / "settings")
    text = (root / "scenarios" / "ag-zone1.toml").read_text()
    scenario.write_text(text + '\n[[bus_fault]]\nkind = "corruption"\nprobability = 0.1\n')
    words = r"bus_fault\[B1\]\.kind: corruption is of the frames of CAN; on GOOSE there can be loss, delay, "
    with pytest.raises(InputError, match=words):
        Supervisor(load_scenario(scenario), "goose:lo", 1.0, (), tmp_path)
