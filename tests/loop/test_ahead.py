"""Plant and relays ahead of the bus: the same bits as sample by sample, whatever comes from it and when."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import faultloop
from faultloop.loop import closed_loop
from faultloop.loop.ahead import Ahead
from faultloop.loop.case import Cases
from faultloop.loop.scenario import load_scenario
from faultloop.plant import Plant
from faultloop.relay import Relay, RelayInputs

SCENARIOS = Path(__file__).resolve().parents[2] / "scenarios"


def told(result: faultloop.Result) -> tuple:
    arrays = [result.samples(n).tobytes() + result.phasors(n).tobytes() for n in ("RA", "RB")]
    elements = [result.elements(n).tobytes() for n in ("RA", "RB")]
    return result.trips, result.events, result.faults, result.can_frames, arrays, elements


@pytest.mark.parametrize("name", ["single-pole-trip", "evolving-fault", "lossy-bus"])
def test_a_run_is_the_same_sample_by_sample(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    path = SCENARIOS / f"{name}.toml"
    ahead = told(faultloop.run(path))
    monkeypatch.setattr(closed_loop, "BLOCK", 1)
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
    monkeypatch.setattr(closed_loop, "BLOCK", 1)
    assert told(faultloop.run(changed)) == ahead


def test_what_was_run_too_far_is_forgotten() -> None:
    """Inputs and commands at random instants: samples and states as of one who never ran ahead."""
    path = SCENARIOS / "ag-zone1.toml"
    settings = faultloop.load_settings(SCENARIOS / "settings" / "ab-mho.toml")
    random = np.random.default_rng(1)
    cuts = np.cumsum(random.integers(1, 60, 40)).tolist()
    taken: list[list[np.ndarray]] = []
    for block in (240, 1):
        plant, relay = Plant(load_scenario(path)), Relay(settings)
        ahead, rows = Ahead(plant, [relay]), []
        for number, stop in enumerate(cuts):
            while ahead.sample_count < stop:
                if not ahead.left:
                    ahead.make(block)
                piece = ahead.take(stop - ahead.sample_count)
                ((rows_of_piece, _, _),) = piece.relays.values()
                rows.append(np.hstack([rows_of_piece.samples, rows_of_piece.phasors]))
            ahead.settle()
            assert plant.sample_count == relay.sample_count == stop
            if number % 3 == 0:
                relay.inputs = RelayInputs(breaker_closed=7 - number % 4)
            if number == 25:
                plant.command("QA", "open", 7, stop * 1_000_000_000 // 4800)
        taken.append([np.concatenate(rows)])
    assert np.array_equal(taken[0][0], taken[1][0], equal_nan=True)


def test_a_warm_state_is_taken_again_and_is_the_same() -> None:
    """Cases of one place, of another, and of the first again: each as `run` has it."""
    cases = Cases()
    for at_pu in (0.3, 0.6, 0.3):
        scenario = load_scenario(SCENARIOS / "ag-zone1.toml", [f"fault.F1.at_pu={at_pu}"])
        result, outcome = faultloop.run(scenario, keep=False), cases.prepare(scenario).run()
        assert (outcome.trips, outcome.events) == (result.trips, result.events)
        assert outcome.fault_locations == result.fault_locations
