"""Seed paper 004: its recursion against its equations, written down here once more.

Nothing is shared with the package: numbers of equations are the paper's.
"""

from __future__ import annotations

import numpy as np
import pytest

from faultloop.relay.estimators import make_estimator
from faultloop.study.papers import rls
from tests.study.papers.transcriptions.common import RECORDS, phasors_of

TD_S, PER_CYCLE, ALPHA_SQUARED = 0.03, 24, 1e6
DECAY = np.exp(-1 / (TD_S * 50 * PER_CYCLE))


def transcribed(z: np.ndarray, P: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows h(i) of eq. 5 with n = 1, and X of eq. 2 to 4 after each sample, from X = 0 and P."""
    x, found = np.zeros(3), []
    i = np.arange(1, len(z) + 1)
    angle = 2 * np.pi * i / PER_CYCLE
    h = np.column_stack([DECAY**i, np.cos(angle), np.sin(angle)])
    for row, sample in zip(h, z, strict=True):
        K = P @ row / (row @ P @ row + 1)  # eq. 4
        x = x + K * (sample - row @ x)  # eq. 3
        P = P - np.outer(P @ row, row @ P) / (row @ P @ row + 1)  # eq. 2
        found.append(x)
    return h, np.array(found)


def record(count: int) -> np.ndarray:
    i = np.arange(1, count + 1)
    angle = 2 * np.pi * i / PER_CYCLE
    z = 0.9 * DECAY**i + 0.6 * np.cos(angle) - 0.8 * np.sin(angle)
    return z + 0.05 * np.random.default_rng(2).normal(size=count)


@pytest.mark.parametrize("count", RECORDS)
def test_the_study_s_recursion(count: int) -> None:
    """The gains off line and on line."""
    z = record(count)
    h, wanted = transcribed(z, ALPHA_SQUARED * np.eye(3))
    np.testing.assert_allclose(rls.model(count, PER_CYCLE, td_s=TD_S), h, atol=1e-12)
    found = rls.estimates(h, z[:, None], rls.gains(h, ALPHA_SQUARED))[:, :, 0]
    np.testing.assert_allclose(found, wanted, atol=1e-6)
    np.testing.assert_allclose(rls.on_line(h, z, ALPHA_SQUARED), wanted, atol=1e-6)


@pytest.mark.parametrize("count", RECORDS)
def test_the_relay_s(count: int) -> None:
    """Its unknown is the offset's present value, and alpha^2 is that of its prediction for i = 1: so the
    paper's x0 has begun with alpha^2 / decay^2."""
    z = record(count)
    P = ALPHA_SQUARED * np.diag([DECAY**-2, 1.0, 1.0])
    _, wanted = transcribed(z, P)
    relay = make_estimator(
        "rls",
        50 * PER_CYCLE,
        50.0,
        time_constant_ms=1e3 * TD_S,
        initial_covariance=ALPHA_SQUARED,
        forgetting_factor=1.0,
        detection_threshold=3e4,  # the first sample alone is a disturbance
    )
    found = phasors_of(relay, np.repeat(z[:, None], 6, axis=1))[:, 0]
    # A cos a - B sin a from sample 0 on is the relay's; xR cos + xI sin from i = 1 on the paper's.
    turned = (wanted[:, 1] - 1j * wanted[:, 2]) * np.exp(2j * np.pi / PER_CYCLE)
    np.testing.assert_allclose(found, turned, atol=1e-5)
