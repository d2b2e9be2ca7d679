"""Rows of a campaign, read back, over everything that a scenario may have: what `run` and its log say."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType

import pytest

from tests.load import load


def bench() -> ModuleType:
    return load("bench/equality.py")


def assert_equal(numbers: range, rows: int, folder: Path, estimators: tuple[str, ...]) -> None:
    equality = bench()
    equality.prepare(folder)
    for number in numbers:
        made = equality.campaign(number, 1, folder, rows, estimators)
        assert equality.row_differences(made, folder) == [], f"scenario {number}"


def test_random_rows(tmp_path: Path) -> None:
    assert_equal(range(2), 1, tmp_path, ("kalman-bank", "fourier"))


@pytest.mark.slow
def test_random_rows_of_all_kinds(tmp_path: Path) -> None:
    assert_equal(range(200), 3, tmp_path, bench().ESTIMATORS)
