"""Plant and relays ahead of the bus: the same bits as sample by sample, whatever comes from it and when."""

from __future__ import annotations

from pathlib import Path

import numba
import pytest

import faultloop
from faultloop.loop import closed_loop, drive
from faultloop.loop.case import Cases
from faultloop.loop.scenario import Scenario, load_scenario
from faultloop.plant import Plant
from tests.plant.test_mutual import parallel

SCENARIOS = Path(__file__).resolve().parents[2] / "scenarios"
SHIPPED = sorted(path.name for path in SCENARIOS.glob("*.toml"))


def told(result: faultloop.Result) -> tuple:
    arrays = [result.samples(n).tobytes() + result.phasors(n).tobytes() for n in ("RA", "RB")]
    elements = [result.elements(n).tobytes() for n in ("RA", "RB")]
    return result.trips, result.events, result.faults, result.can_frames, arrays, elements


@pytest.mark.parametrize("name", ["single-pole-trip", "evolving-fault", "lossy-bus"])
def test_a_run_is_the_same_sample_by_sample(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    path = SCENARIOS / f"{name}.toml"
    ahead = told(faultloop.run(path))
    monkeypatch.setattr(drive, "AHEAD", 1)
    assert told(faultloop.run(path)) == ahead


def test_a_node_that_restarts_in_the_middle_of_a_block(monkeypatch: pytest.MonkeyPatch) -> None:
    scenario = load_scenario(SCENARIOS / "ag-zone1.toml")
    data = scenario.model_dump(by_alias=True, exclude_none=True, mode="json")
    data["bus_fault"] = [
        {"kind": "restart", "node": "RA", "start_s": 0.0503, "duration_s": 0.0111},
        {"kind": "restart", "node": "QB", "start_s": 0.1091, "duration_s": 0.002},
    ]
    changed = type(scenario).from_dict(data, path=scenario.path)
    ahead = told(faultloop.run(changed))
    monkeypatch.setattr(drive, "AHEAD", 1)
    assert told(faultloop.run(changed)) == ahead


@pytest.mark.parametrize("operate_ms", [0.0, 3.1])
def test_what_is_told_in_small_portions_is_the_same(
    operate_ms: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Reclosing: commands come while poles move; with quick breakers the plant may hardly run ahead."""
    overrides = [f"breaker.{name}.operate_ms={operate_ms}" for name in ("QA", "QB")]
    path = SCENARIOS / "single-pole-trip.toml"
    whole = told(faultloop.run(path, overrides=overrides))
    monkeypatch.setattr(closed_loop, "ROWS", 7)
    monkeypatch.setattr(drive, "AHEAD", 1)
    assert told(faultloop.run(path, overrides=overrides)) == whole


def test_a_warm_state_is_taken_again_and_is_the_same() -> None:
    """Cases of one place, of another, and of the first again: each as `run` has it."""
    cases = Cases()
    for at_pu in (0.3, 0.6, 0.3):
        scenario = load_scenario(SCENARIOS / "ag-zone1.toml", [f"fault.F1.at_pu={at_pu}"])
        result, outcome = faultloop.run(scenario, keep=False), cases.prepare(scenario).run()
        assert (outcome.trips, outcome.events) == (result.trips, result.events)
        assert outcome.fault_locations == result.fault_locations


def test_every_plant_is_of_the_same_types() -> None:
    """The loop calls kernels by address: they know no other types than those of the first plant."""
    plants = {name: Plant(load_scenario(SCENARIOS / name)) for name in SHIPPED}
    plants["coupled pi"] = Plant(Scenario.from_dict(parallel("pi")))
    types = {name: numba.typeof(plant.parts) for name, plant in plants.items()}
    assert [name for name, own in types.items() if own != types["ag-zone1.toml"]] == []
