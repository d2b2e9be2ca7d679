"""Seed paper 003: the quick report, what it tracks, and what its figures rest on."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from faultloop.errors import InputError
from faultloop.study.papers import ckmc, rls
from faultloop.study.papers.ckmc.cases import (
    BAD,
    CKF,
    GOOD,
    ORACLE,
    Case,
    Plan,
    Q,
    R,
    better,
    data_folder,
    gaussian,
    linear_bound,
    mixture,
    monte_carlo,
    plan,
    predicted,
    realised,
)
from faultloop.study.papers.ckmc.machines import machine
from faultloop.study.report import Check, Report, write_html
from faultloop.study.suites import run_suite

pytestmark = pytest.mark.xdist_group("ckmc")  # the report is made once


@pytest.fixture(scope="module")
def what() -> Plan:
    return plan()


@pytest.fixture(scope="module")
def report() -> Report:
    return ckmc.report(quick=True)


def test_the_report_holds_but_for_what_nobody_could_reach(report: Report) -> None:
    assert report.held, [c.status for c in report.checks if not c.held]
    (beyond,) = [c for c in report.checks if not c.held]
    assert beyond.what.startswith("CKMC-CKF better than CKF")
    assert beyond.bound == pytest.approx(100 * (1 - 1 / (0.98 + 0.02 * 100)))
    assert all(isinstance(c.held, bool) for c in report.checks)
    numbers = [v for t in report.tables for row in t.rows for v in row if isinstance(v, float)]
    assert numbers and all(math.isfinite(v) for v in numbers)
    assert len(report.figures) == 5


def test_the_bound_of_the_gain() -> None:
    """1 - 1/sqrt(.98 + .02 x 100), and v1 = 1e-3 in place of 1e-4."""
    assert linear_bound(0.98, 1e-6, 1e-4) == pytest.approx(42.07, abs=0.01)
    assert linear_bound(0.98, 1e-6, 1e-4, power=2) == pytest.approx(66.44, abs=0.01)
    assert linear_bound(0.98, 1e-6, 1e-3) == pytest.approx(78.17, abs=0.01)


def test_nobody_passes_the_bound(what: Plan) -> None:
    """The filter that is told every variance comes near it, on either truth."""
    bound = linear_bound(0.98, GOOD, BAD)
    for state_noise in (None, Q):
        case = Case(mixture(0.98, GOOD, BAD), Q, R, state_noise=state_noise)
        errors = monte_carlo(what, case, [CKF, ORACLE], runs=5)
        assert bound - 15.0 < better(errors, ORACLE.name, CKF.name) < bound + 2.0  # the sample's own share


def test_the_state_noise_is_on_the_truth(what: Plan) -> None:
    """Each step of the realised truth leaves the model's by a draw of N(0, Q), and the sensors see it."""
    case = Case(gaussian(R), Q, R, state_noise=Q)
    states, measurements = realised(what, case, np.random.default_rng(1))
    steps = np.empty_like(states)
    for k in range(1, len(states)):
        machine.transition(states[k - 1], what.inputs[k], what.parameters, steps[k])
    w = (states - steps)[1:]
    assert w.var(axis=0) == pytest.approx(Q, rel=0.25)
    assert np.abs(w.mean(axis=0)).max() < 4 * np.sqrt(Q[0] / len(w))
    assert measurements[:, :2] == pytest.approx(states[:, :2])
    assert realised(what, Case(gaussian(R), Q, R), np.random.default_rng(1))[0] is what.states


def test_the_shipped_data_is_the_shared(shared: Path) -> None:
    for name in ("branches.csv", "buses.csv", "generators.csv"):
        assert (data_folder() / name).read_text() == (shared / "ieee39" / name).read_text()
    assert "Athay" in (data_folder() / "README.md").read_text()


def test_every_table_has_a_row_a_filter(report: Report) -> None:
    titles = {t.title: t for t in report.tables}
    for number in (2, 3, 4):
        tables = [t for title, t in titles.items() if title.startswith(f"Table {number}")]
        assert len(tables) == 2
        for table in tables:
            names = [str(row[0]).split(",")[0] for row in table.rows]
            assert {"CKF", "MCC-CKF", "CKMC-CKF"} <= set(names)
            assert all(len(row) == len(table.columns) for row in table.rows)


def test_the_model_of_the_filters_is_the_machine(what: Plan) -> None:
    """A 20 ms step from a true state ends where the ten machines' simulation does, but for its own order."""
    assert np.abs(predicted(what) - what.states).max() < 2e-3  # rad/s, while omega moves by 3
    assert what.states[0] == pytest.approx(predicted(what)[1], abs=1e-9)


def test_normal_noise_as_told_is_filtered_as_told(what: Plan) -> None:
    """Every filter about alike; better than the bare measurement; told the same, the oracle is the CKF."""
    errors = monte_carlo(what, Case(gaussian(R), Q, R), [CKF, ckmc.ckmc(50.0), ORACLE], runs=3)
    assert errors[ORACLE.name].overall == errors[CKF.name].overall
    assert errors["CKMC-CKF, 50"].overall == pytest.approx(errors[CKF.name].overall, rel=0.02)
    assert (errors[CKF.name].j[:2] < math.sqrt(GOOD)).all()


def test_the_same_seed_gives_the_same_errors(what: Plan) -> None:
    a, b = (monte_carlo(what, Case(gaussian(R), Q, R), [CKF], runs=2)[CKF.name] for _ in range(2))
    assert np.array_equal(a.by_frame, b.by_frame)


def test_missing_data_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FAULTLOOP_IEEE39", str(tmp_path))
    with pytest.raises(InputError, match=r"buses\.csv: no such file"):
        ckmc.report(quick=True)


def test_missing_data_costs_its_own_report_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In either order: the other's results are there, the suite does not hold, and the page says why."""
    monkeypatch.setenv("FAULTLOOP_IEEE39", str(tmp_path))
    lost, other = run_suite("seeds", ["ckmc", "rls"], quick=True)
    assert other.held and other.checks and other.tables
    assert not lost.held and "buses.csv: no such file" in lost.failed
    assert lost.as_dict()["held"] is False and "no such file" in str(lost.as_dict()["failed"])
    page = write_html([lost, other], tmp_path / "page.html").read_text()
    assert "buses.csv: no such file" in page and "Recursive least squares" in page


@pytest.mark.parametrize("name", ["buses.csv", "branches.csv", "generators.csv"])
@pytest.mark.parametrize(
    "damage", ["missing", "a folder", "binary", "empty", "a column less", "no number", "zero"]
)
def test_an_unreadable_input_is_one_line(
    name: str, damage: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each input of the suite, each way: its own report says so, the other one's results stand."""
    for each in ("buses.csv", "branches.csv", "generators.csv"):
        (tmp_path / each).write_bytes((data_folder() / each).read_bytes())
    path = tmp_path / name
    lines = path.read_text().splitlines()
    path.unlink()
    if damage == "a folder":
        path.mkdir()
    elif damage != "missing":
        cells = [line.split(",") for line in lines]
        path.write_bytes(
            {
                "binary": bytes(range(256)),
                "empty": b"",
                "a column less": "\n".join(",".join(row[1:]) for row in cells).encode(),
                "no number": "\n".join([lines[0], *("x" + line for line in lines[1:])]).encode(),
                "zero": "\n".join([lines[0], *(",".join(["0"] * len(row)) for row in cells[1:])]).encode(),
            }[damage]
        )
    monkeypatch.setenv("FAULTLOOP_IEEE39", str(tmp_path))
    monkeypatch.setattr(rls, "report", lambda quick: Report("rls", "R", checks=[Check("a", 0.0, 1.0)]))
    lost, other = run_suite("seeds", ["ckmc", "rls"], quick=True)
    assert not lost.held and name in lost.failed and "\n" not in lost.failed
    assert other.held and other.checks
