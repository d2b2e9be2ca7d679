"""Every function against outside references: one runner for the tables in ``validation/``."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.relay.checks import CHECKS

TABLES = sorted((Path(__file__).parent / "validation").glob("*.toml"))
CASES = [
    pytest.param(case, id=f"{table.stem}: {case['name']}")
    for table in TABLES
    for case in tomllib.loads(table.read_text(encoding="utf-8"))["case"]
]


@pytest.mark.parametrize("case", CASES)
def test_validation(case: dict[str, Any]) -> None:
    found = CHECKS[case["check"]](case["input"])
    assert case["origin"] and case["expected"]
    for key, expected in case["expected"].items():
        np.testing.assert_allclose(found[key], expected, rtol=0, atol=case["tolerance"][key], err_msg=key)
