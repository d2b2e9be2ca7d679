"""Seed paper 002: its filter against its equations, written down here once more.

Nothing is shared with the package.  Equations 1 to 15 are missing from the text: frequency and ROCOF are
taken here as what they are, the first and second derivatives of the phase, by differences.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from faultloop.relay.estimators import make_estimator
from faultloop.study.papers.taylor_kalman import as_written
from tests.study.papers.transcriptions.common import phasors_of, rows_of


def row(since: float, n: int, fs: int, window: int) -> np.ndarray:
    """Eq. 5: five powers of the time in windows, on the cosine and the sine of sample n."""
    powers, angle = (since / window) ** np.arange(5), 2 * np.pi * 50 * n / fs
    return np.concatenate([powers * math.cos(angle), -powers * math.sin(angle)])


def phasor(x: np.ndarray, tau: float) -> complex:
    powers = tau ** np.arange(5)
    return powers @ x[:5] + 1j * (powers @ x[5:])


def of_phase(x: np.ndarray, tau: float, window_s: float) -> tuple[float, float]:
    """Frequency [Hz] and ROCOF [Hz/s]: the phase of the polynomial, by differences."""
    h = 1e-4
    here = phasor(x, tau)
    before, after = (np.angle(phasor(x, tau + d) / here) for d in (-h, h))
    step = 2 * np.pi * h * window_s
    return 50 + (after - before) / (2 * step), (after + before) * 2 * np.pi / step**2


def kept(x: np.ndarray, P: np.ndarray, passed: float) -> tuple[np.ndarray, np.ndarray]:
    """Section 2.3: the last estimate and its covariance are the next window's."""
    return x, P


def moved(x: np.ndarray, P: np.ndarray, passed: float) -> tuple[np.ndarray, np.ndarray]:
    """The same polynomial about the new origin: fitted anew through five of its points."""
    t = np.linspace(0.0, 1.0, 5)
    shift = np.linalg.solve(np.vander(t, increasing=True), np.vander(t + passed, increasing=True))
    both = np.kron(np.eye(2), shift)
    return both @ x, both @ P @ both.T


@pytest.mark.parametrize(("carry", "ours"), [(kept, as_written.as_they_are), (moved, as_written.moved)])
@pytest.mark.parametrize("count", [11, 70])
@pytest.mark.parametrize("window", [16, 24])
def test_the_filter_as_written(carry: Callable, ours: Callable, count: int, window: int) -> None:
    """Section 2.2's start over ten samples, then eq. 16 to 20 in windows of 40 or 60 ms at 400 Hz."""
    fs, m, q = 400, 10, 0.3
    t = np.arange(count) / fs
    z = 311 * np.cos(2 * np.pi * 49.7 * t + 0.5) + np.random.default_rng(3).normal(size=count)
    H = np.array([row(n, n, fs, window) for n in range(m)])
    P = np.linalg.inv(H.T @ H)  # R = 1 V^2
    x = P @ H.T @ z[:m]
    wanted = []
    for n in range(m, count):
        since = (n - m) % window
        if since == 0:
            x, P = carry(x, P, (m if n == m else window) / window)
        h = row(since, n, fs, window)
        P = P + q * np.eye(10)  # eq. 20
        K = P @ h / (h @ P @ h + 1.0)  # 16
        P = (np.eye(10) - np.outer(K, h)) @ P  # 17
        x = x + K * (z[n] - h @ x)  # 18
        tau = since / window
        wanted.append((phasor(x, tau) / np.sqrt(2), *of_phase(x, tau, window / fs)))
    form = as_written.Form(window, ours, as_written.least_squares, m, q)
    found = as_written.written_filter(z, fs, 50.0, form)
    assert all(np.isnan(each[:m]).all() for each in found)
    phasors, frequency, rocof = (np.array(column) for column in zip(*wanted, strict=True))
    # Ten states from ten samples: the condition of H^T H is 2e11 and 3e12, and how a processor adds shows in
    # the seventh digit (in one of 60 ROCOFs of 1300 Hz/s by 0.011 on one of two).
    np.testing.assert_allclose(found[0][m:], phasors, atol=1e-5 * 311)
    np.testing.assert_allclose(found[1][m:], frequency.real, atol=1e-3)
    np.testing.assert_allclose(found[2][m:], rocof.real, rtol=1e-4, atol=1e-2)


def test_the_relay_s_least_squares_start() -> None:
    """At the last sample of the first window: the polynomial of the least squares, evaluated there."""
    fs, window = 800, 40
    n = np.arange(window)
    z = 100 * np.cos(2 * np.pi * 50.4 * n / fs + 0.4) + np.random.default_rng(8).normal(size=window)
    samples = np.zeros((window, 6))
    samples[:, 0] = z
    found = phasors_of(make_estimator("taylor-kalman", fs, 50.0, start="least-squares"), samples)[:, 0]
    H = np.array([row(k, k, fs, window) for k in n])
    x = np.linalg.lstsq(H, z, rcond=None)[0]
    assert abs(found[-1] - phasor(x, (window - 1) / window)) < 1e-6 * 100
    assert np.abs(found[:-1]).max() == 0.0  # nothing was known before


@pytest.mark.parametrize("count", [1, 130])
def test_the_relay_s_default(count: int) -> None:
    """Eq. 16 to 20 with the polynomial moved, a memory of a window in place of Q, and its prior."""
    fs, window, deviation = 800, 40, 2.0
    n = np.arange(count)
    z = 100 * np.cos(2 * np.pi * 50.3 * n / fs + 0.4) + 0.2 * np.random.default_rng(3).normal(size=count)
    samples = np.zeros((count, 6))
    samples[:, 0] = z
    rows = rows_of(make_estimator("taylor-kalman", fs, 50.0), samples)
    spread = [(2 * np.pi * deviation * window / fs) ** m / math.factorial(m) for m in range(5)]
    x, P = np.zeros(10), 1e5 * np.diag(np.tile(np.square(spread), 2))
    grows = (window + 1) / (window - 1)
    for k, sample in enumerate(z):
        since = k % window
        if k and since == 0:
            x, P = moved(x, P, 1.0)
        h = row(since, k, fs, window)
        P = grows * P
        K = P @ h / (h @ P @ h + 1.0)
        P = P - np.outer(K, h @ P)
        x = x + K * (sample - h @ x)
        tau = since / window
        assert abs(np.sqrt(2) * (rows[k, 0] + 1j * rows[k, 1]) - phasor(x, tau)) < 1e-6 * 100
        if k >= window:  # of one phase alone the positive sequence has the same phase
            frequency, rocof = of_phase(x, tau, window / fs)
            assert rows[k, 12] == pytest.approx(frequency, abs=1e-4)
            assert rows[k, 13] == pytest.approx(rocof, abs=1e-2)
