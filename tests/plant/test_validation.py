"""Every component against outside references: one runner for the tables in ``validation/``."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.plant.checks import CHECKS

TABLES = sorted((Path(__file__).parent / "validation").glob("*.toml"))
CASES = [
    pytest.param(case, id=f"{table.stem}: {case['name']}")
    for table in TABLES
    for case in tomllib.loads(table.read_text(encoding="utf-8"))["case"]
]


@pytest.mark.parametrize("case", CASES)
def test_validation(case: dict[str, Any]) -> None:
    found = CHECKS[case["check"]](case["input"])
    wrong = [
        f"{key}: {found[key]} is not {expected} within {case['tolerance'].get(key, 'nothing')}"
        for key, expected in case["expected"].items()
        if not agrees(found[key], expected, case["tolerance"].get(key))
    ]
    assert case["expected"] and not wrong, "\n".join(wrong)


def agrees(found: Any, expected: Any, tolerance: float | None) -> bool:
    """Numbers within an absolute tolerance, each of a list; anything else is equal."""
    if isinstance(expected, str):
        return found == expected
    assert tolerance is not None, "a number needs a tolerance"
    found, expected = np.asarray(found, dtype=float), np.asarray(expected, dtype=float)
    return found.shape == expected.shape and bool(np.all(np.abs(found - expected) <= tolerance))
