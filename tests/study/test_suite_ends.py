"""The suites of both ends: a part of each; whole ones behind `slow`."""

from __future__ import annotations

import math

import pytest

from faultloop.study.suites import run_suite
from faultloop.study.suites.schemes import MOST_ROWS, report_of
from faultloop.study.suites.schemes.network import Expected, Row


def test_a_weak_end_and_one_end_alone() -> None:
    for name, part in (("schemes", "weak-end"), ("differential", "one-end")):
        (report,) = run_suite(name, [part], quick=True)
        assert report.held, [row for row in report.tables[0].rows if row[-1] != "right"]
        assert len(report.tables[0].rows) >= 5
        assert report.diagrams


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "part"),
    [
        *(("schemes", part) for part in ("internal", "speed", "external", "channel", "beginning")),
        *(("schemes", part) for part in ("reversal", "poles", "three-ends", "bus")),
        *(("differential", part) for part in ("internal", "external", "saturation", "channel", "three-ends")),
    ],
)
def test_a_part_holds(name: str, part: str) -> None:
    (report,) = run_suite(name, [part])
    assert report.held, [row for row in report.tables[0].rows if row[-1] != "right"]


def test_a_part_without_a_wrong_row_shows_no_table() -> None:
    """Of many rows only the wrong ones are listed."""
    rows = [Row("case", "RA", Expected(False), "no trip", math.nan, True)] * (MOST_ROWS + 1)
    right = report_of("part", "Part", rows)
    assert right.tables == [] and right.checks[0].value == 0.0
    wrong = report_of("part", "Part", [*rows, rows[0]._replace(right=False)])
    assert len(wrong.tables[0].rows) == 1 and wrong.checks[0].value == 1.0
