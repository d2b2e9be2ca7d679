"""Every validation case of the suite of functions, and what the suite makes of them."""

from __future__ import annotations

import numpy as np
import pytest

from faultloop.study.suites import run_suite
from faultloop.study.suites.functions import PARTS
from faultloop.study.suites.functions.cases import Case, compare, tables
from faultloop.study.suites.functions.parallel_lines import CASES, expected_reach, reach

ALL = [pytest.param(case, id=f"{table}: {case.name}") for table, (_, own) in tables().items() for case in own]


@pytest.mark.parametrize("case", ALL)
def test_validation(case: Case) -> None:
    compared = case.compared()
    assert case.origin and compared
    assert [f"{one.key}: {one.got} is not {one.expected}" for one in compared if not one.held] == []


def test_every_part_has_cases() -> None:
    assert {part for part, _ in tables().values()} == set(PARTS)


def test_what_is_wrong_is_off() -> None:
    assert compare("x", [1.0, 2.0], [1.0, 2.2], 0.1).off == pytest.approx(2.0)
    assert compare("x", 10.0, 10.1, "1 %").held
    assert not compare("x", 10.0, 10.2, "1 %").held
    assert not compare("x", 1.0, np.nan, 0.1).held
    assert not compare("x", [1.0], [1.0, 1.0], 0.1).held
    assert compare("x", ["a", "b"], ["a", "b"], None).held
    assert not compare("x", ["a", "b"], ["a"], None).held
    with pytest.raises(ValueError, match="a number needs a tolerance"):
        compare("x", 1.0, 1.0, None)


def test_a_part_is_a_report() -> None:
    (report,) = run_suite("functions", ["curves"], quick=True)
    assert report.held, [check.what for check in report.checks if not check.held]
    assert report.tables[0].rows and report.diagrams
    assert all(diagram.plotly().data for diagram in report.diagrams)


@pytest.mark.slow  # 56 runs of the plant and a relay
@pytest.mark.parametrize("compensated", [False, True])
@pytest.mark.parametrize("state", CASES)
def test_zone_1_reaches_as_far_as_the_closed_form_says(state: str, compensated: bool) -> None:
    found = reach(*CASES[state], compensated)
    assert found == pytest.approx(expected_reach(*CASES[state], compensated), abs=0.01)
