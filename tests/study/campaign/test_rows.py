"""Rows of a campaign, read back, over everything that a scenario may have: what `run` and its log say."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

import pytest


def bench() -> Any:
    path = Path(__file__).resolve().parents[3] / "bench" / "equality.py"
    spec = importlib.util.spec_from_file_location("equality_rows_bench", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


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
