"""``[[swing]]``: beside the tables, what a source does before, between and after its points; wrong input."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from faultloop.errors import InputError
from faultloop.loop.scenario import Scenario
from faultloop.plant import Plant
from faultloop.study.suites.functions.plant_checks import between_two
from tests.examples import scenario
from tests.plant.record import record
from tests.plant.reference import build, network


def test_the_run_starts_steady_and_ends_steady() -> None:
    x, _ = record(between_two(1.0, [0.2, 0.4, 0.6], [-30.0, 60.0, 10.0]), 6720)
    assert np.abs(x[:96] - x[864:960]).max() < 1e-9 * np.abs(x).max()
    assert np.abs(x[-96:] - x[-192:-96]).max() < 1e-5 * np.abs(x).max()


def test_a_straight_line_is_a_source_of_another_frequency() -> None:
    """1 Hz of slip, from the start on, against ``frequency_hz``; behind the transient of its beginning, which
    the other does not have."""
    sources = network("rl")["source"]
    slipping = [sources[0] | {"frequency_hz": 51.0}, sources[1]]
    swing = [{"source": "A", "at_s": [0.0, 1.0], "angle_deg": [0.0, 360.0]}]
    expected, _ = record(Plant(build("rl", source=slipping)), 4800)
    found, _ = record(Plant(build("rl", swing=swing)), 4800)
    assert np.abs(found - expected)[2400:].max() < 1e-3 * np.abs(expected).max()


def test_it_goes_on_in_a_run_that_begins_later() -> None:
    tables = build("rl", swing=[{"source": "A", "at_s": [0.0, 1.0], "angle_deg": [0.0, 90.0]}])
    x, _ = record(Plant(tables), 4800)
    later, _ = record(Plant(tables.beginning_at(0.5)), 2400)
    assert np.abs(later[:, 0, :3] - x[2400:, 0, :3])[960:].max() < 1e-2 * np.abs(x).max()


@pytest.mark.parametrize(
    ("item", "message"),
    [
        ({"source": "SX"}, r"swing\[W1\].source: there is no source 'SX'; did you mean"),
        ({"at_s": [0.1]}, r"swing\[W1\]: at_s and angle_deg belong together"),
        ({"at_s": [0.2, 0.1]}, r"swing\[W1\]: at_s must ascend"),
        ({"at_s": [0.1, 0.11]}, r"swing\[W1\]: a slip of 25 Hz is no swing"),
        ({"at_s": [], "angle_deg": []}, r"swing\[W1\].at_s: at least 1 needed, 0 given"),
    ],
)
def test_wrong_swings(item: dict[str, Any], message: str) -> None:
    swing = {"source": "SA", "at_s": [0.1, 0.3], "angle_deg": [0.0, 90.0]} | item
    with pytest.raises(InputError, match=message):
        Scenario.from_dict(scenario(swing=[swing]))


def test_a_source_has_one_swing() -> None:
    swing = {"source": "SA", "at_s": [0.1, 0.3], "angle_deg": [0.0, 90.0]}
    with pytest.raises(InputError, match=r"swing\[W2\].source: source 'SA' already has the swing 'W1'"):
        Scenario.from_dict(scenario(swing=[swing, swing]))
