"""Seed paper 000: its filter against its equations, written down here once more.

Nothing is shared with the package: numbers of equations are the paper's.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from faultloop.relay.estimators import make_estimator
from faultloop.study.papers.adaptive_kalman import filter as kf
from tests.study.papers.transcriptions.common import RECORDS, phasors_of

DECAY = math.exp(-1 / (0.04 * 1200))


def transcribed(z: np.ndarray, form: str, P: np.ndarray, least: float) -> np.ndarray:
    """Eq. 1 and 2 (``voltage``), 3 and 4 (``decaying``) or 11 and 12 (``initial-value``), the filter's five
    equations, and eq. 10 for R; phasors (peak)."""
    states = 2 if form == "voltage" else 3
    Phi = np.diag([1.0, 1.0, DECAY]) if form == "decaying" else np.eye(states)
    U = np.zeros(states)
    found = []
    for k, sample in enumerate(z):
        angle = 2 * np.pi * k / 24
        last = {"voltage": [], "decaying": [1.0], "initial-value": [DECAY**k]}[form]
        H = np.array([math.cos(angle), -math.sin(angle), *last])
        U, P = Phi @ U, Phi @ P @ Phi.T  # predicted
        e = sample - H @ U
        R = max(e**2 - H @ P @ H, least)  # eq. 10; below zero: zero
        K = P @ H / (H @ P @ H + R)
        U, P = U + K * e, P - np.outer(K, H @ P)
        P = 0.5 * (P + P.T)
        found.append(U[0] + 1j * U[1])
    return np.array(found)


def fault(count: int) -> tuple[np.ndarray, np.ndarray]:
    """A voltage that falls at sample 30, and a current with an offset."""
    rng = np.random.default_rng(1)
    n = np.arange(count)
    v = np.cos(2 * np.pi * n / 24 + 0.3) * np.where(n < 30, 1.0, 0.4) + 0.01 * rng.normal(size=count)
    i = 5 * np.cos(2 * np.pi * n / 24 - 1.0) + 2.0 * DECAY**n + 0.05 * rng.normal(size=count)
    return v, i


@pytest.mark.parametrize("count", RECORDS)
@pytest.mark.parametrize(
    ("form", "name"),
    [("voltage", kf.VOLTAGE), ("decaying", kf.DECAYING), ("initial-value", kf.INITIAL_VALUE)],
)
def test_the_study_s_filter(form: str, name: str, count: int) -> None:
    z = fault(count)[0 if form == "voltage" else 1]
    rule = kf.Rule(kf.EQ_10, renewed=False, spread=2.0, peak=1.0)
    found = kf.run_filter(z[:, None], rule, name, 0, 24, np.array([DECAY])).phasors[:, 0]
    wanted = transcribed(z, form, 4.0 * np.eye(2 if form == "voltage" else 3), 1e-24)
    np.testing.assert_allclose(found, wanted, atol=1e-6 * np.abs(z).max())


@pytest.mark.parametrize("count", RECORDS)
@pytest.mark.parametrize("form", ["decaying", "initial-value"])
def test_the_relay_s_as_written(form: str, count: int) -> None:
    """Without a renewal.  Its P(0) is a spread times the first squared sample, and is P(1/0)."""
    v, i = fault(count)
    samples = np.zeros((count, 6))
    samples[:, 0], samples[:, 3] = v, i
    relay = make_estimator("adaptive-kalman", 1200, 50.0, form="as-written", offset=form)
    found = phasors_of(relay, samples)
    least = 1e-24
    wanted = transcribed(v, "voltage", v[0] ** 2 * np.eye(2), least * v[0] ** 2)
    np.testing.assert_allclose(found[:, 0], wanted, atol=1e-6)
    before = DECAY if form == "decaying" else 1.0
    P = 9.0 * i[0] ** 2 * np.diag([1.0, 1.0, before**-2])
    wanted = transcribed(i, form, P, least * i[0] ** 2)
    np.testing.assert_allclose(found[:, 3], wanted, atol=1e-6 * np.abs(i).max())
