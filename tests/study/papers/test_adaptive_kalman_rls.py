"""Seed papers 000 and 004: their equations against closed forms, and their reports."""

from __future__ import annotations

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter

from faultloop.study.papers import adaptive_kalman, rls
from faultloop.study.papers.adaptive_kalman import filter as kf
from faultloop.study.papers.adaptive_kalman import line
from faultloop.study.report import Report


def missed(report: Report) -> list[str]:
    return [check.what for check in report.checks if not check.held]


def test_rls_report_holds() -> None:
    report = rls.report(quick=True)
    assert report.held
    (beyond,) = [check for check in report.checks if not check.held]
    assert beyond.what.startswith("5.2, consistent, x0")
    assert beyond.bound == pytest.approx(beyond.value, rel=0.1)
    assert report.figures
    assert all(len(row) == len(table.columns) for table in report.tables for row in table.rows)


@pytest.mark.parametrize("forgetting", [1.0, 0.9])
def test_the_recursion_is_regularised_weighted_least_squares(forgetting: float) -> None:
    """(lambda^N / alpha^2 I + H'WH) X = H'Wz, at every N: what P0 = alpha^2 I means, exactly."""
    rows = rls.model(60, 24)
    z = rls.samples(rows, 1, seed=1)
    found = rls.estimates(rows, z, rls.gains(rows, 1e3, forgetting))[:, :, 0]
    for n in range(1, 61):
        weight = forgetting ** np.arange(n - 1, -1, -1)
        normal = rows[:n].T @ (weight[:, None] * rows[:n]) + forgetting**n / 1e3 * np.eye(3)
        wanted = np.linalg.solve(normal, rows[:n].T @ (weight * z[:n, 0]))
        np.testing.assert_allclose(found[n - 1], wanted, rtol=0, atol=1e-8 * np.abs(wanted).max())


def test_the_paper_s_alpha_does_not_reach_the_batch_estimate_at_2n_plus_1() -> None:
    """96 samples per cycle: even 1e10 is 6e-5 away, and eq. 2 cannot take more."""
    paper, _ = rls.deviations(96, 1, 1e10, 2 * 96)
    assert paper.first > 10 * rls.EXACT
    paper, root = rls.deviations(96, 1, rls.WIDE, 2 * 96)
    assert paper.later > 100 * rls.EXACT
    assert max(root) < rls.EXACT


def test_adaptive_kalman_report_and_what_the_rule_lacks() -> None:
    """The rule as written never arrives."""
    report = adaptive_kalman.report(quick=True)
    assert report.held, missed(report)
    assert report.tables[0].title.startswith("What was published")
    assert any(check.what.startswith("eq. 10 unbiased") and check.held for check in report.checks)
    assert all(len(row) == len(table.columns) for table in report.tables for row in table.rows)
    assert len(report.figures) == 5
    voltages = next(table for table in report.tables if table.title == "Voltages").rows
    assert all(row[1:4] == ("never / never",) * 3 for row in voltages)
    assert not any("never" in str(cell) for row in voltages for cell in row[4:])


def test_the_figure_over_the_decay_constant_has_a_colour_for_each_current() -> None:
    """Three currents at full size, two in the quick one; the paper's second form alone."""
    finer = [
        (f"current {k}", form, criterion, "9.2", "inf", "7.9", "20.0")
        for k in range(3)
        for form in (kf.DECAYING, kf.INITIAL_VALUE)
        for criterion in ("vector", "magnitude")
    ]
    figure = adaptive_kalman._over_factor(finer, (1.0, 1.2, 1.5))
    assert len(figure.data) == 6
    assert len({line.line.color for line in figure.data}) == 3
    assert all(len(line.y) == 3 for line in figure.data)


def test_the_290_km_current_by_decay_constant_and_criterion() -> None:
    """As a vector late with L / R, not from 1.1 to 1.5 L / R; by magnitude in time; the paper's hint late."""
    records = [line.record("AG", 290.0, turn / 12) for turn in range(12)]
    s = adaptive_kalman.signals(records, "AG", current=True)
    rule = adaptive_kalman.rules_of(kf.DECAYING)[adaptive_kalman.FADING]
    true, own = line.time_constant_s("AG", 290.0), line.line_time_constant_s("AG")
    assert own == pytest.approx(0.0204, abs=1e-4)

    def late(time_constant: float, error: adaptive_kalman.Error) -> float:
        phasors = adaptive_kalman.filtered(s, rule, kf.DECAYING, time_constant)
        return float(np.median(adaptive_kalman.stays_ms(phasors, s, error)))

    assert late(true, adaptive_kalman.vector) > 10
    assert all(late(factor * true, adaptive_kalman.vector) <= 10 for factor in (1.1, 1.2, 1.5))
    assert late(true, adaptive_kalman.magnitude) <= 10
    assert late(own, adaptive_kalman.vector) > 15


@pytest.mark.parametrize("form", [kf.DECAYING, kf.INITIAL_VALUE])
def test_the_ordinary_filter_is_filterpys(form: str) -> None:
    count, decay = 60, 0.97
    z = np.random.default_rng(6).normal(size=(count, 1))
    rule = kf.Rule(kf.KNOWN, renewed=False, spread=1.5, floor=0.1, peak=1.0)
    found = kf.run_filter(z, rule, form, 0, 24.0, np.array([decay])).phasors[:, 0]
    peer = KalmanFilter(dim_x=3, dim_z=1)
    peer.P, peer.R[:], peer.Q[:] = 1.5**2 * np.eye(3), 0.01, 0.0
    peer.F = np.diag([1.0, 1.0, decay if form == kf.DECAYING else 1.0])
    for k in range(count):
        peer.predict()
        angle = 2 * np.pi * k / 24
        last = 1.0 if form == kf.DECAYING else decay**k
        peer.update(z[k, 0], H=np.array([[np.cos(angle), -np.sin(angle), last]]))
        assert abs(found[k] - (peer.x[0, 0] + 1j * peer.x[1, 0])) < 1e-9


def test_the_line_s_settled_phasors_are_a_fault_s() -> None:
    """Three-phase: three equal phasors 120 degrees apart, and the loop measures the line to the fault."""
    r = line.record("ABC", 160.0, 0.0)
    volts, amperes = r.settled[:3], r.settled[3:]
    turn = np.exp(-2j * np.pi / 3)
    assert np.abs(volts - volts[0] * turn ** np.arange(3)).max() < 2e-3
    assert np.abs(amperes - amperes[0] * turn ** np.arange(3)).max() < 2e-3
    ratio = volts[0] / amperes[0]
    # Line charging lowers the impedance that is seen by some percent; its angle is the line's.
    assert np.angle(ratio) == pytest.approx(np.angle(line.Z1_PER_KM), abs=0.02)
    assert 0 <= r.late_s < 1 / line.SAMPLING_HZ
