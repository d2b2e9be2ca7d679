"""The estimators' suite: its cases are what they say, and its limits hold where it is run in full size."""

from __future__ import annotations

import numpy as np
import pytest

from faultloop.relay.estimators import make_estimator
from faultloop.study.suites import estimators as suite
from faultloop.study.suites import run_suite
from faultloop.study.suites.estimators import cases


def test_the_current_is_continuous_and_ends_as_the_true_phasor() -> None:
    fs, f, t0 = 4800, 49.0, 0.30517
    t = np.arange(np.ceil(t0 * fs), t0 * fs + 0.5 * fs) / fs
    just_after = cases.fault_samples(np.array([t0 + 1e-9]), t0, 40.0, f, "harmonics")
    assert just_after[0, 3] == pytest.approx(cases.load_samples(np.array([t0]), f)[0, 3], abs=1e-6)
    samples = cases.fault_samples(t, t0, 10.0, f, "offset")
    settled = np.sqrt(2) * np.cos(2 * np.pi * f * t + cases.FAULT_ANGLE)
    assert samples[-400:, 3] == pytest.approx(settled[-400:], abs=1e-9)
    assert np.array_equal(samples[:, [0, 1, 2, 4, 5]], cases.load_samples(t, f)[:, [0, 1, 2, 4, 5]])


def test_a_verdict_is_what_it_says() -> None:
    since = np.linspace(0.0, 0.099, 100)
    truth = np.exp(1j * since).astype(np.complex128)
    found = (truth * np.where(since < 0.0125, 1.06, 1.02)).astype(np.complex128)
    stays, magnitude, over = cases.judge(found, truth, since)
    assert (stays, magnitude) == pytest.approx((13.0, 13.0))
    assert over == pytest.approx(2.0)
    turned = truth * np.exp(0.06j)  # the magnitude is right, the phasor is not
    assert cases.judge(turned, truth, since)[:2] == [np.inf, 0.0]
    assert cases.judge(truth * np.nan, truth, since)[0] == np.inf


def test_a_full_cycle_window_is_behind_off_the_nominal_frequency() -> None:
    """6.3 % for ever at 49 Hz, and nothing at 50: the reference turns as it should."""
    grid = cases.Grid((10.0,), (0.0,), (49.0, 50.0), angles=3)
    outcome = cases.play(make_estimator("fourier", 4800, 50.0), 4800, grid)
    assert np.all(np.isinf(outcome.stays_ms) == (outcome.frequency_hz == 49.0))


def test_no_limit_is_missed_at_the_hardest_corners() -> None:
    """Every angle at both sampling rates, short and long offsets, both noises, 49 and 51 Hz.

    The limit of the median is one over the whole grid, which these corners do not stand for.
    """
    grid = cases.Grid((10.0, 16.0, 200.0), (0.0, 0.01), (49.0, 51.0))
    for sampling_hz in suite.PARTS.values():
        o = cases.play(make_estimator(suite.BEST, sampling_hz, 50.0), sampling_hz, grid)
        assert o.stays_ms.max() <= suite.LIMITS["worst"]
        assert o.overshoot.max() <= suite.LIMITS["overshoot"]


def test_the_report(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(suite, "estimator_methods", lambda: ("adaptive-kalman", "fourier", "kalman-bank"))
    seen: list[float] = []
    (report,) = run_suite("estimators", ["1000"], quick=True, progress=seen.append)
    assert report.held
    assert seen == sorted(seen)
    assert seen[-1] == 1.0
    table = report.tables[0]
    assert table.rows[0][0] == "kalman-bank"
    assert all(len(row) == len(table.columns) for row in table.rows)
    assert report.figures


def test_the_bank_keeps_its_covariance_positive_and_finds_the_frequency() -> None:
    """200 000 samples off the nominal frequency; the turn that it holds is the deviation."""
    from faultloop.relay.estimators.filters import offset_bank as bank

    estimator = make_estimator(suite.BEST, 4800, 50.0)
    state = estimator.state.copy()
    rng = np.random.default_rng(2)
    for first in range(0, 200_000, 50_000):
        t = np.arange(first, first + 50_000) / 4800
        cases.advance(estimator, state, cases.load_samples(t, 49.3), 0.01, rng)
        assert 50.0 + state[bank.TURN] * 4800 / (2 * np.pi) == pytest.approx(49.3, abs=0.03)
        assert np.linalg.eigvalsh(bank.model_covariances(state, 12)).min() > 0


def test_a_dead_line_does_not_move_the_frequency() -> None:
    """Noise alone on every channel, for 4 s, after a line at 49 Hz: the frequency is held."""
    from faultloop.relay.estimators.filters import offset_bank as bank

    estimator = make_estimator(suite.BEST, 4800, 50.0)
    for seed in range(3):
        state, rng = estimator.state.copy(), np.random.default_rng(seed)
        cases.advance(estimator, state, cases.load_samples(np.arange(4800) / 4800, 49.0), 0.01, rng)
        cases.advance(estimator, state, np.zeros((20_000, 6)), 0.01, rng)
        assert 50.0 + state[bank.TURN] * 4800 / (2 * np.pi) == pytest.approx(49.0, abs=0.1)
