"""Seed paper 001: EKF, UKF, STF, STUKF and MSTUKF against its equations, written down here once more.

Nothing is shared with the package but the signals: numbers of equations are the paper's.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from faultloop.relay.estimators import make_estimator
from faultloop.relay.estimators.filters import tracking
from faultloop.relay.estimators.filters.harmonic_model import harmonic_filter
from faultloop.relay.estimators.filters.strong_tracking import seen
from faultloop.relay.estimators.filters.unscented import sigma_spread
from faultloop.study.papers.mstukf import cases
from tests.study.papers.transcriptions.common import phasors_of

HARMONICS = np.array([1, 3, 5, 7])
H = np.array([1.0, 0, 1, 0, 1, 0, 1, 0, 0])
DT, BETA = 1 / 6400, 1.8


def turn(x: np.ndarray) -> np.ndarray:
    """Eq. 42."""
    out = x.copy()
    for i, order in enumerate(HARMONICS):
        c, s = math.cos(order * x[8] * DT), math.sin(order * x[8] * DT)
        out[2 * i], out[2 * i + 1] = c * x[2 * i] + s * x[2 * i + 1], -s * x[2 * i] + c * x[2 * i + 1]
    return out


def jacobian(x: np.ndarray) -> np.ndarray:
    """df/dx by differences: nothing of it is derived."""
    step = 1e-6 * np.maximum(np.abs(x), 1.0)
    columns = [(turn(x + h) - turn(x - h)) / (2 * h.sum()) for h in np.diag(step)]
    return np.column_stack(columns)


def sigma(x: np.ndarray, P: np.ndarray, alpha=1e-3, beta=2.0, kappa=0.0):
    """Eq. 22 to 25 without Q: the weights as they are printed."""
    n = 9
    lam = alpha**2 * (n + kappa) - n
    root = np.linalg.cholesky((n + lam) * P)
    points = np.vstack([x, x + root.T, x - root.T])
    wm = np.full(2 * n + 1, 0.5 / (n + lam))
    wc = wm.copy()
    wm[0] = lam / (n + lam)
    wc[0] = wm[0] + 1 - alpha**2 + beta
    images = np.array([turn(p) for p in points])
    mean = wm @ images
    return mean, (images - mean).T @ (wc[:, None] * (images - mean))


def step(state, V, sample, R, Q, kind, rho=0.95):
    """Eq. 4 to 12 (``STF``; in sigma points ``STUKF``), 20 to 39 (``MSTUKF``), alpha_j = 1; EKF and UKF
    are the same without lambda."""
    x, P = state
    if kind in ("EKF", "STF"):
        F = jacobian(x)
        x, without = turn(x), F @ P @ F.T
    else:
        x, without = sigma(x, P)
    gamma = sample - H @ x
    V = gamma**2 if V is None else (rho * V + gamma**2) / (1 + rho)  # eq. 12
    lam = 1.0
    if kind == "MSTUKF":
        lam = max(1.0, (V - BETA * R) / (H @ (without + Q) @ H))  # eq. 36 to 39
        P = lam * (without + Q)  # eq. 26
    else:
        if kind in ("STF", "STUKF"):
            lam = max(1.0, (V - H @ Q @ H - BETA * R) / (H @ without @ H))  # eq. 9 to 11
        P = lam * without + Q  # eq. 5
    Pz = H @ P @ H + R  # eq. 28
    K = P @ H / Pz  # eq. 6, 29
    P = P - np.outer(K, K) * Pz  # eq. 19, 31
    return (x + K * gamma, 0.5 * (P + P.T)), V, lam


TRACKS = {
    "EKF": tracking.track_extended,
    "UKF": tracking.track_unscented,
    "STF": tracking.track_strong,
    "STUKF": tracking.track_strong_unscented,
    "MSTUKF": tracking.track_modified,
}


def package_s(kind: str, z: np.ndarray, start, rho: float):
    """The package's filter from the same start."""
    spread, excess = sigma_spread(9, 1e-3, 2.0, 0.0)
    f = harmonic_filter(4, np.array([DT, spread, excess, BETA, rho, 1.0]))
    f.x[:], f.P[:], f.Q[:] = start
    out = np.empty((len(z), 7))
    extra = (seen(9),) if kind == "STUKF" else ()
    TRACKS[kind](f, *extra, z, 1e-3, out)
    return out, f


@pytest.mark.parametrize(("first", "count", "rho"), [(690, 1, 0.95), (690, 60, 0.95), (1390, 60, 0.0)])
@pytest.mark.parametrize("kind", TRACKS)
def test_the_study_s_filters(kind: str, first: int, count: int, rho: float) -> None:
    """Over the beginning and the end of the paper's sag, the latter with a V without memory."""
    z = cases.noisy("sag", 2)[first : first + count]
    angle = 2 * np.pi * 50 * first / 6400
    x = np.zeros(9)
    x[:2], x[8] = (math.sin(angle), math.cos(angle)), 100 * np.pi
    P = np.diag([*np.full(8, 1e-4), 1e-3]) + 1e-6
    Q = 1e-8 * np.eye(9)
    found, f = package_s(kind, z, (x, P, Q), rho)
    state, V, factors = (x, P), None, []
    for k, sample in enumerate(z):
        state, V, factor = step(state, V, sample, 1e-3, Q, kind, rho)
        x = state[0]
        np.testing.assert_allclose(found[k, :4], np.hypot(x[0:8:2], x[1:8:2]), atol=1e-6)
        turned = found[k, cases.PHASE] - math.atan2(x[0], x[1])
        assert abs(math.remainder(turned, 2 * np.pi)) < 1e-6
        assert found[k, cases.OMEGA] == pytest.approx(x[8], rel=1e-6)
        factors.append(factor)
    np.testing.assert_allclose(f.x[:8], state[0][:8], atol=1e-6)
    np.testing.assert_allclose(f.P[:8, :8], state[1][:8, :8], atol=1e-6)
    np.testing.assert_allclose(found[:, cases.FADING], factors, rtol=1e-4)
    if (first, count) == (690, 60) and kind not in ("EKF", "UKF"):
        assert found[10, cases.FADING] > 10  # sample 701 is found


@pytest.mark.parametrize("count", [1, 100])
@pytest.mark.parametrize("method", ["stf", "stukf", "mstukf"])
def test_the_relay_s_as_written(method: str, count: int) -> None:
    """Settings of a relay that make it the paper's: R fixed, no bounds, the frequency faded as all."""
    n = np.arange(count)
    v = np.cos(2 * np.pi * 50 * n / 6400 + 0.3) * np.where(n < 70, 1.0, 0.5)
    v += 0.02 * np.random.default_rng(4).normal(size=count)
    parameters = {"form": "as-written", "softening_factor": BETA, "frequency_share": 1.0}
    parameters |= {"process_variance": 1e-8, "frequency_process_variance": 1e-8}
    parameters |= {"initial_variance": 10.0, "frequency_initial_variance": 1.0}
    parameters |= {"fading": "covariance"} if method == "mstukf" else {}
    samples = np.zeros((count, 6))
    samples[:, 0] = v
    found = phasors_of(make_estimator(method, 6400, 50.0, **parameters), samples)[:, 0]
    level = np.maximum.accumulate(v**2)  # the per unit: squared, the greatest so far; R, P0, Q are in it
    x = np.zeros(9)
    x[8] = 100 * np.pi
    state, V = (x, np.diag([*np.full(8, 10.0 * level[0]), 1.0])), None
    for k, sample in enumerate(v):
        Q = np.diag([*np.full(8, 1e-8 * level[k]), 1e-8])
        state, V, _ = step(state, V, sample, 1e-3 * level[k], Q, method.upper())
        sine, cosine = state[0][:2]  # A sin p, A cos p: the phasor is A e^(j (p - 90 deg))
        turned = found[k] * np.exp(2j * np.pi * 50 * k / 6400)
        assert abs(turned - (sine - 1j * cosine)) < 1e-5
