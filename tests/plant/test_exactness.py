"""The same bits whatever the blocks, and after going back."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from faultloop.loop.scenario import Scenario
from faultloop.plant import Change, Plant
from tests.plant.record import now_ns
from tests.plant.reference import build, network

TOTAL = 700


def eventful(model: str) -> Scenario:
    """Two faults, one removed, front ends with noise, transformers, breakers at both ends, one switches."""
    front = {"antialias_hz": 900.0, "antialias_order": 4, "voltage_noise_v": 50.0, "current_noise_a": 1.0}
    relays = network(model)["relay"]
    relays[0] |= {"ct": "T", "vt": "V"}
    ct = {"name": "T", "ratio": [500, 1], "model": "saturating", "vs_v": 60.0, "burden_ohm": [4.0, 1.0]}
    return build(
        model,
        front_end=front,
        relay=relays,
        ct=[ct | {"remanence_pu": 0.4}],
        vt=[{"name": "V", "ratio": [220e3, 110.0], "model": "cvt", "circuit": "A2"}],
        load=[{"name": "P", "bus": "B", "mw": 50.0, "mvar": -20.0, "connection": "delta"}],
        switching=[{"breaker": "QB", "operation": "close", "poles": "AB", "at_s": 0.11}],
        breaker=[
            {"name": "QA", "line": "L", "end": "from", "operate_ms": 20.3, "close_ms": 31.7},
            {"name": "QB", "line": "L", "end": "to", "operate_ms": 24.0, "close_ms": 31.7},
        ],
        fault=[
            {"name": "F1", "line": "L", "at_pu": 0.3, "type": "AG", "start_s": 0.02003, "duration_s": 0.06},
            {"name": "F2", "line": "L", "at_pu": 0.3, "type": "BC", "angle_deg": 30.0, "after_s": 0.025},
        ],
    )


COMMANDS = {180: [("QA", "open", 7)], 190: [("QB", "open", 3), ("QA", "open", 7)], 450: [("QA", "close", 7)]}
"""After so many samples."""


def play(plant: Plant, blocks: list[int]) -> tuple[np.ndarray, list[Change]]:
    """TOTAL samples in blocks of the given sizes in turn, with the commands at their times."""
    samples, changes, block = [], [], 0
    while plant.sample_count < TOTAL:
        stop = min([k for k in (*COMMANDS, TOTAL) if k > plant.sample_count])
        size = min(blocks[block % len(blocks)], stop - plant.sample_count)
        block += 1
        done = plant.advance(size)
        assert 1 <= done <= size
        assert done == size or plant.changes
        for change in plant.changes:  # all of them after the last sample but one
            assert now_ns(plant) - 10**9 // plant.sampling_hz - 1 <= change.t_ns <= now_ns(plant)
        samples.append(plant.samples.copy())
        changes += plant.changes
        for breaker, action, mask in COMMANDS.get(plant.sample_count, []):
            plant.command(breaker, action, mask, now_ns(plant))
    return np.concatenate(samples), changes


@pytest.fixture(scope="module", params=["pi", "bergeron"])
def expected(request: pytest.FixtureRequest) -> tuple[Scenario, np.ndarray, list[Change]]:
    scenario = eventful(request.param)
    samples, changes = play(Plant(scenario), [TOTAL])
    assert [c.value for c in changes if c.kind == "fault"] == [1, 1, 0]
    assert sum(c.kind == "pole" for c in changes) >= 6
    return scenario, samples, changes


@settings(max_examples=25, deadline=None, derandomize=True)
@given(blocks=st.lists(st.integers(1, 60), min_size=1, max_size=12))
def test_blocks_of_any_size_give_the_same_bits(
    expected: tuple[Scenario, np.ndarray, list[Change]], blocks: list[int]
) -> None:
    scenario, samples, changes = expected
    again, same_changes = play(Plant(scenario), blocks)
    assert samples.tobytes() == again.tobytes()
    assert changes == same_changes


@settings(max_examples=15, deadline=None, derandomize=True)
@given(at=st.integers(1, TOTAL - 1), ahead=st.integers(1, 400))
def test_going_back_gives_the_same_bits(
    expected: tuple[Scenario, np.ndarray, list[Change]], at: int, ahead: int
) -> None:
    scenario, samples, _ = expected
    plant = Plant(scenario)
    first: list[np.ndarray] = []
    while plant.sample_count < at:
        stop = min([k for k in (*COMMANDS, at) if k > plant.sample_count])
        plant.advance(stop - plant.sample_count)
        first.append(plant.samples.copy())
        for breaker, action, mask in COMMANDS.get(plant.sample_count, []):
            plant.command(breaker, action, mask, now_ns(plant))
    saved = plant.save()
    plant.advance(ahead)
    plant.command("QB", "open", 7, now_ns(plant))
    plant.advance(ahead)
    plant.restore(saved)
    rest, _ = play(plant, [37])
    assert np.concatenate([*first, rest]).tobytes() == samples.tobytes()


def test_a_plant_of_the_same_scenario_gives_the_same_bits() -> None:
    one, two = (play(Plant(eventful("bergeron")), [64]) for _ in range(2))
    assert one[0].tobytes() == two[0].tobytes() and one[1] == two[1]
