"""A campaign's case, a run and its log say the same, to the nanosecond and bit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import ModuleType

import pytest

from faultloop.loop.case import Cases
from faultloop.loop.scenario import load_scenario
from tests.load import load


def bench() -> ModuleType:
    return load("bench/equality.py")


def assert_equal(numbers: range, folder: Path, estimators: tuple[str, ...]) -> None:
    equality, cases = bench(), Cases()
    equality.prepare(folder)
    for number in numbers:
        scenario, settings = equality.draw(number, 1, folder, estimators)
        found = equality.differences(scenario, settings, cases, folder)
        assert found == [], f"case {number}"


def test_random_cases(tmp_path: Path) -> None:
    assert_equal(range(8), tmp_path, ("kalman-bank", "fourier"))


@pytest.mark.slow
def test_random_cases_of_all_kinds(tmp_path: Path) -> None:
    assert_equal(range(500), tmp_path, bench().ESTIMATORS)


def test_without_texts_a_case_is_the_same(root: Path) -> None:
    """The lines for a person are not made for a table."""
    scenario, cases = load_scenario(root / "scenarios" / "single-pole-trip.toml"), Cases()
    whole, bare = cases.prepare(scenario).run(), cases.prepare(scenario).run(texts=False)
    assert whole.trips
    assert whole.events
    assert bare == replace(whole, events=[])
    assert cases.prepare(scenario).run() == whole
