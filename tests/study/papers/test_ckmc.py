"""Seed paper 003: the quick report, what it tracks, and what its figures rest on."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from faultloop.errors import InputError
from faultloop.study.papers import ckmc
from faultloop.study.papers.ckmc.cases import (
    CKF,
    GOOD,
    ORACLE,
    Case,
    Plan,
    Q,
    R,
    gaussian,
    monte_carlo,
    plan,
    predicted,
)
from faultloop.study.papers.ckmc.machines import read_system
from faultloop.study.report import Report


@pytest.fixture(scope="module")
def what(shared: Path) -> Plan:
    return plan(read_system(shared / "ieee39"))


@pytest.fixture(scope="module")
def report(shared: Path) -> Report:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("FAULTLOOP_IEEE39", str(shared / "ieee39"))
        return ckmc.report(quick=True)


def test_the_report_holds(report: Report) -> None:
    missed = [c.what for c in report.checks if not c.held]
    assert all("like for like (published)" in what for what in missed)  # what the report explains
    assert len(report.checks) == 10
    numbers = [v for t in report.tables for row in t.rows for v in row if isinstance(v, float)]
    assert numbers and all(math.isfinite(v) for v in numbers)
    assert len(report.figures) == 4


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
    errors = monte_carlo(what, Case("", gaussian(R), Q, R), [CKF, ckmc.ckmc(50.0), ORACLE], runs=3)
    assert errors[ORACLE.name].overall == errors[CKF.name].overall
    assert errors["CKMC-CKF, 50"].overall == pytest.approx(errors[CKF.name].overall, rel=0.02)
    assert (errors[CKF.name].j[:2] < math.sqrt(GOOD)).all()


def test_the_same_seed_gives_the_same_errors(what: Plan) -> None:
    a, b = (monte_carlo(what, Case("", gaussian(R), Q, R), [CKF], runs=2)[CKF.name] for _ in range(2))
    assert np.array_equal(a.by_frame, b.by_frame)


def test_missing_data_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FAULTLOOP_IEEE39", str(tmp_path))
    with pytest.raises(InputError, match=r"buses\.csv: no such file"):
        ckmc.report(quick=True)
