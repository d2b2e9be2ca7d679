"""The suites of both ends: a part of each; whole ones behind `slow`."""

from __future__ import annotations

import pytest

from faultloop.study.suites import run_suite


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
