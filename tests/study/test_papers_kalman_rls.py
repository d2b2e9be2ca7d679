"""Seed papers 000 and 004: their equations against closed forms, and their reports."""

from __future__ import annotations

import numpy as np
import pytest

from faultloop.study.papers import rls
from faultloop.study.report import Report


def missed(report: Report) -> list[str]:
    return [check.what for check in report.checks if not check.held]


def test_rls_report_holds() -> None:
    report = rls.report(quick=True)
    assert not missed(report)
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
