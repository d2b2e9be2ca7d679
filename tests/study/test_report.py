"""Checks: held, missed, and published beyond a bound; the JSON of them."""

from __future__ import annotations

import json
import re
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from faultloop.cli import call
from faultloop.cli.output import print_json
from faultloop.study.papers import rls
from faultloop.study.papers.mstukf.readings import half_digit
from faultloop.study.papers.published import Published, state
from faultloop.study.report import Check, Report, check_table, write_page
from faultloop.study.suites import SUITES


@pytest.mark.parametrize(
    ("check", "status", "counts"),
    [
        (Check("a", 1.0, 2.0), "held", True),
        (Check("a", 3.0, 2.0), "MISSED", False),
        (
            Check("a", 30.0, 78.0, "%", True, 42.0, "by hand"),
            "published, not reached: bound 42 % (by hand)",
            True,
        ),
        (Check("a", 3.0, 2.0, bound=2.5, because="x"), "published, not reached: bound 2.5 (x)", True),
        # A bound that does not exclude the figure excuses nothing, on either side.
        (Check("a", 30.0, 78.0, "%", True, 90.0, "x"), "MISSED", False),
        (Check("a", 3.0, 2.0, bound=1.5, because="x"), "MISSED", False),
        (Check("a", float("nan"), 2.0, bound=2.5, because="x"), "MISSED", False),
        (Check("a", 80.0, 78.0, "%", True, 42.0, "wrong bound"), "held", True),
        (Check.none_of("a", 0.0, 3), "held", True),
        (Check.none_of("a", 1.0, 3), "MISSED", False),
        # Over no cases it is neither.
        (Check.none_of("a", 0.0, 0), "not asked", True),
        (Check("a", float("nan"), 2.0, cases=0), "not asked", True),
    ],
)
def test_a_check_is_held_missed_or_beyond_a_bound(check: Check, status: str, counts: bool) -> None:
    report = Report("r", "R", checks=[check])
    assert check.status == status
    assert report.held is counts
    shown = check_table(report)
    assert status.startswith(str(shown.rows[0][0]))
    assert (check.because in shown.note) is check.out_of_reach or not check.because
    assert report.as_dict()["checks"][0]["status"] == status
    assert report.as_dict()["checks"][0]["held"] is (status == "held")


def test_held_is_a_boolean_in_json(capsys: pytest.CaptureFixture[str]) -> None:
    """NumPy figures too: as text, "False" would be true to every reader."""
    checks = [Check("a", np.float64(v), np.float64(1.0)) for v in (0.5, 2.0)]
    print_json(Report("r", "R", checks=checks).as_dict() | {"more": [np.bool_(False), np.int64(3)]})
    read = json.loads(capsys.readouterr().out)
    assert [c["held"] for c in read["checks"]] == [True, False]
    assert read["held"] is False and read["more"] == [False, 3]


def test_a_published_figure_is_taken_to_the_digits_that_are_printed() -> None:
    assert half_digit(0.13) == 0.005 and half_digit(0.026) == 0.0005 and half_digit(2.0) == 0.5
    by_size = [Published("e", 0.13, {"": v}, rounding=0.005).check().held for v in (0.1349, 0.1351)]
    assert by_size == [True, False]
    assert Published("e", 78.0, {"": 77.6}, "%", True, rounding=0.5).check().held


def test_a_published_figure_names_the_reading_that_reaches_it() -> None:
    report = Report("r", "R")
    state(report, [Published("t1", 2.5, {"as printed": 3.9, "radians": 2.4, "other": 1.0}, "ms")])
    state(report, [Published("gain", 78.0, {"as printed": 30.0, "squared": 50.0}, "%", True, 66.0, "why")])
    assert [row[-3:] for row in report.tables[0].rows] == [
        ("radians", "", "reached"),
        ("squared", "", "published, not reached: bound 66 %"),
    ]
    assert len(report.tables) == 1 and report.held
    state(report, [Published("t2", 1.0, {"a": 3.0, "b": float("nan")}, "ms")])
    assert not report.held and report.tables[0].rows[-1][-1] == "MISSED"


def test_ours_is_no_reading_of_a_paper() -> None:
    """It stands beside; where it alone reaches a figure, the status says so."""
    report = Report("r", "R")
    found = [Published("t1", 2.5, {"as printed": v}, "ms", ours=1.0) for v in (2.0, 3.0)]
    state(report, [*found, Published("t1", 2.5, {"as printed": 3.0}, "ms", ours=4.0)])
    assert [row[3:] for row in report.tables[0].rows] == [
        ("2", "as printed", "1", "reached"),
        ("3", "as printed", "1", "reached by ours only"),
        ("3", "as printed", "4", "MISSED"),
    ]
    assert [check.value for check in report.checks] == [2.0, 1.0, 3.0]


def test_pages_lead_to_nobodys_cloud(tmp_path: Path) -> None:
    """No link but plotly's own licence notes within its script; no logo, no button that would send."""
    import plotly.graph_objects as go

    path = tmp_path / "x.html"
    write_page([Report("x", "X", figures=[("a", go.Figure(go.Scatter(y=[1, 2])))])], path)
    text = path.read_text(encoding="utf-8")
    assert '"displaylogo": false' in text and '"showSendToCloud": false' in text
    outside = re.sub(r"<script.*?</script>", "", text, flags=re.S)
    assert "http" not in outside and "href" not in outside


@pytest.mark.parametrize(
    ("check", "status"),
    [
        (Check("a", 1.0, 2.0), 0),
        (Check("a", 30.0, 78.0, "%", True, 42.0, "by hand"), 0),
        (Check("a", 30.0, 78.0, "%", True), 3),
        (Check("a", 30.0, 78.0, "%", True, 90.0, "a bound that excuses nothing"), 3),
    ],
)
def test_the_exit_status_of_a_suite(
    check: Check, status: int, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A figure beyond its bound does not fail it; one that is missed does.  JSON says so by booleans."""
    monkeypatch.setattr(rls, "report", lambda quick: Report("rls", "R", checks=[check]))
    assert call(["suite", "seeds", "rls", "--json"]) == status
    told = json.loads(capsys.readouterr().out)
    assert told["held"] is told["reports"][0]["held"] is (status == 0)
    assert told["reports"][0]["checks"][0]["held"] is check.held


@pytest.mark.parametrize("name", SUITES)
def test_held_is_a_boolean_in_every_suite_s_json(
    name: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """What a suite computes are NumPy's numbers; what is printed are JSON's."""
    checks = [Check("a", np.float64(v), np.float64(1.0), at_least=np.bool_(False)) for v in (0.5, 2.0)]
    module = import_module(f"faultloop.study.suites.{name}")
    monkeypatch.setattr(module, "run", lambda parts, *, quick, progress: [Report(name, "R", checks=checks)])
    assert call(["suite", name, "--json"]) == 3
    told = json.loads(capsys.readouterr().out)
    assert told["held"] is False and told["reports"][0]["held"] is False
    assert [c["held"] for c in told["reports"][0]["checks"]] == [True, False]
    assert [c["at_least"] for c in told["reports"][0]["checks"]] == [False, False]
