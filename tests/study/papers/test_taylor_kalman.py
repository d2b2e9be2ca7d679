"""Seed paper 002: the derivation, the filter against another one, and the cases."""

from __future__ import annotations

from math import comb

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter

from faultloop.errors import InputError
from faultloop.relay.estimators import make_estimator, run_estimator
from faultloop.relay.estimators.disturbance import RENEWALS
from faultloop.relay.estimators.methods import taylor_kalman as method
from faultloop.study.papers import taylor_kalman as paper
from faultloop.study.suites import run_suite


def run(estimator, samples):
    rows = np.empty((len(samples), 14))
    state = estimator.state.copy()
    run_estimator(estimator.step, state, np.ascontiguousarray(samples), rows)
    return rows, state


def test_the_expansion_is_of_the_second_order():
    """Halving x and y divides the remainder of the ten-state model by eight."""

    def remainder(x, y):
        t = np.linspace(0.0, 0.05, 200)
        a = 1.3 * np.exp(0.7j)
        c = np.array(
            [
                1,
                2j * np.pi * x,
                1j * np.pi * y - 2 * np.pi**2 * x**2,
                -2 * np.pi**2 * x * y,
                -(np.pi**2) / 2 * y**2,
            ]
        )
        exact = a * np.exp(1j * (2 * np.pi * x * t + np.pi * y * t**2))
        return np.abs(np.polyval(a * c[::-1], t) - exact).max()

    assert remainder(0.4, 1.0) / remainder(0.2, 0.5) == pytest.approx(8.0, rel=0.1)


def test_moving_the_origin_is_a_taylor_shift():
    rng = np.random.default_rng(1)
    given = rng.normal(size=(10, 3))
    moved = given.copy()
    method.move_origin(moved, 0.37)
    for part in range(2):
        for k in range(3):
            expected = np.polynomial.Polynomial(given[part::2, k])(np.polynomial.Polynomial([0.37, 1.0])).coef
            np.testing.assert_allclose(moved[part::2, k], expected, rtol=1e-12)


def test_it_is_the_fading_kalman_filter():
    """Against filterpy's, in covariance form, over three windows of a noisy phase."""
    fs, window = 800, 40
    estimator = make_estimator("taylor-kalman", fs, 50.0)
    assert estimator.settling_samples == window
    t = np.arange(130) / fs
    rng = np.random.default_rng(3)
    v = 100 * np.cos(2 * np.pi * 50.3 * t + 0.4) + 0.2 * rng.normal(size=len(t))
    samples = np.zeros((len(t), 6))
    samples[:, 0] = v
    rows, state = run(estimator, samples)
    assert state[RENEWALS] == 1

    other = KalmanFilter(10, 1)
    other.alpha = np.sqrt((window + 1) / (window - 1))
    other.x = np.zeros((10, 1))
    other.P = np.diag(np.repeat(estimator.state[method.PRIOR : method.PRIOR + 5] ** 2, 2))
    other.R *= 1.0
    other.Q *= 0.0
    move = np.kron([[comb(k, m) for k in range(5)] for m in range(5)], np.eye(2))
    for n, z in enumerate(v):
        tau = (n % window) / window
        other.F = move if n and n % window == 0 else np.eye(10)
        angle = 2 * np.pi * 50 * n / fs
        powers = tau ** np.arange(5)
        other.H = np.ravel(np.column_stack([powers * np.cos(angle), -powers * np.sin(angle)]))[None]
        other.predict()
        other.update(z)
        parts = other.x.reshape(5, 2)
        phasor = powers @ parts / np.sqrt(2)
        np.testing.assert_allclose(rows[n, :2], phasor, rtol=0, atol=1e-9)


def test_the_papers_cases():
    (report,) = run_suite("seeds", ["taylor-kalman"], quick=True)
    assert report.held, [check.what for check in report.checks if not check.held]
    written = next(table for table in report.tables if table.title.startswith("As written"))
    for row in written.rows:
        assert (row[3] > 0.1) == row[1].startswith("as written")


def test_windows_of_40_and_60_ms_and_the_start_mend_nothing_of_what_is_written():
    table = paper.windows_and_starts(quick=True)
    assert {(row[2], row[3]) for row in table.rows} == {
        (ms, start) for ms in (40.0, 60.0) for start in ("wide", "section 2.2")
    }
    for row in table.rows:
        frequency = row[table.columns.index(">frequency [Hz]")]
        assert (frequency > 0.1) == row[4].startswith("as written")
        assert row[4].startswith("as written") or frequency < 5e-3


def test_figures_show_millihertz():
    """Nothing is clipped, and the errors stand on a logarithmic scale of their own."""
    tracks = paper.step_tracks()
    four, errors = paper.figures.four(tracks), paper.figures.errors(tracks)
    assert all(axis.range is None for axis in four.select_yaxes())
    assert all(axis.type == "log" for axis in errors.select_yaxes())
    late = [line.y[-1] for line in errors.data if line.yaxis == "y3"]
    assert len(late) == 3 and max(late) < 1e-3


def test_the_least_squares_start_waits_for_its_window():
    wave = paper.STEPS["220 to 190 V"]
    t, phasor, _ = paper.run(wave, 400, 0.4, start="least-squares")
    error = np.abs(phasor - wave.phasor(t)) / np.abs(wave.phasor(t))
    filled = (t >= 0.2 + 0.050 - 1e-9) | ((t > 0.06) & (t < 0.2))
    assert error[filled].max() < 1e-4
    assert error[(t >= 0.2) & (t < 0.24)].min() > 0.05  # until then the last polynomial goes on


def test_a_rate_is_found_at_full_rate():
    wave = paper.deviating(0.4, 0.5)
    _, frequency, rocof, _ = paper.errors_of(wave, 4800)
    assert frequency < 5e-4
    assert rocof < 0.02


def test_bad_settings_are_refused():
    with pytest.raises(InputError, match="window_ms: a window of 8 samples is shorter than the 10 states"):
        make_estimator("taylor-kalman", 200, 50.0, window_ms=40.0)
    with pytest.raises(InputError, match="sampling_hz: 3 samples per cycle are too few"):
        make_estimator("taylor-kalman", 150, 50.0)
    with pytest.raises(InputError, match="noise_floor"):
        make_estimator("taylor-kalman", 4800, 50.0, noise_floor=0.0)
