"""Seed paper 003: the generator's model and CKF, MCC-CKF and CKMC-CKF against the paper's equations, written
down here once more.

Nothing is shared with the package but the record of inputs and measurements: numbers of equations are the
paper's; those that its text has lost (12 to 42) are in their usual form (Arasaratnam, Haykin 2009; Chen, Liu,
Zhao, Principe 2017).
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from faultloop.study.papers.ckmc import cubature
from faultloop.study.papers.ckmc.cases import Plan, ckmc, mcc, mixture, plan
from faultloop.study.papers.ckmc.machines import machine
from tests.study.papers.transcriptions.common import RECORDS

Q, R = 1e-5 * np.eye(4), 1e-6 * np.eye(4)


def rotor(delta: float, i_re: float, i_im: float) -> tuple[float, float]:
    """Eq. 8 and 9: id, iq."""
    s, c = math.sin(delta), math.cos(delta)
    return i_re * s - i_im * c, i_im * s + i_re * c


def slope(x: np.ndarray, u: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Eq. 2 to 5, with Te = Pe of the stator at nominal speed."""
    delta, omega, eq, ed = x
    tm, ufd, i_re, i_im = u
    inertia, damping, xd, xq, xd1, xq1, td0, tq0, _ = p
    i_d, i_q = rotor(delta, i_re, i_im)
    te = (ed + xq1 * i_q) * i_d + (eq - xd1 * i_d) * i_q
    return np.array(
        [
            omega,
            (tm - te - damping * omega) / inertia,
            (ufd - eq - (xd - xd1) * i_d) / td0,
            (-ed + (xq - xq1) * i_q) / tq0,
        ]
    )


def state_function(x: np.ndarray, u: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Eq. 1's phi by the modified Euler method; ``u`` is that after the start and before the end."""
    first = slope(x, u[0:4], p)
    second = slope(x + p[8] * first, u[4:8], p)
    return x + p[8] * 0.5 * (first + second)


def measured(x: np.ndarray, u: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Eq. 6 and 7 (the first with iq and the second's signs: the printed one cannot be a voltage)."""
    delta, omega, eq, ed = x
    i_d, i_q = rotor(delta, u[10], u[11])
    s, c = math.sin(delta), math.cos(delta)
    v_d, v_q = ed + i_q * p[5], eq - i_d * p[4]
    return np.array([delta, omega, v_d * s + v_q * c, v_q * s - v_d * c])


def points_of(x: np.ndarray, P: np.ndarray) -> np.ndarray:
    """Eq. 16 to 18."""
    S = np.linalg.cholesky(P)
    return np.array([x + sign * math.sqrt(4) * S[:, j] for sign in (1, -1) for j in range(4)])


def weights(e: np.ndarray, kernel: str, bandwidth: float) -> np.ndarray:
    if kernel == "gauss":
        return np.exp(-(e**2) / (2 * bandwidth**2))
    return 1.0 / (1.0 + e**2 / bandwidth) ** 2  # the derivative of eq. 12, over e


def step(x, P, u, z, p, kernel, bandwidth):
    """Eq. 16 to 42: points, regression, K of weighted P and R, the fixed point."""
    moved = np.array([state_function(point, u, p) for point in points_of(x, P)])
    x = moved.mean(axis=0)
    P = (moved - x).T @ (moved - x) / 8 + Q
    points = points_of(x, P)
    images = np.array([measured(point, u, p) for point in points])
    expected = images.mean(axis=0)
    Pxz = (points - x).T @ (images - expected) / 8
    Pzz = (images - expected).T @ (images - expected) / 8 + R
    if kernel is None:
        K = Pxz @ np.linalg.inv(Pzz)
        return x + K @ (z - expected), P - K @ Pzz @ K.T
    H = Pxz.T @ np.linalg.inv(P)  # eq. 28
    Rs = Pzz - H @ P @ H.T
    Bp, Br = np.linalg.cholesky(P), np.linalg.cholesky(Rs)
    best, K = x, np.zeros((4, 4))
    for _ in range(300):  # eq. 36 to 41
        ex = np.linalg.solve(Bp, x - best)
        ez = np.linalg.solve(Br, z - expected - H @ (best - x))
        Pt = Bp @ np.diag(1 / weights(ex, kernel, bandwidth)) @ Bp.T
        Rt = Br @ np.diag(1 / weights(ez, kernel, bandwidth)) @ Br.T
        K = Pt @ H.T @ np.linalg.inv(H @ Pt @ H.T + Rt)
        before, best = best, x + K @ (z - expected)
        if np.abs(best - before).max() < 1e-13:
            break
    left = np.eye(4) - K @ H
    return best, left @ P @ left.T + K @ Rs @ K.T  # eq. 42


@pytest.fixture(scope="module")
def what() -> Plan:
    return plan()


def test_the_model(what: Plan) -> None:
    """Eq. 1 to 9 at every frame, the fault among them."""
    p = what.parameters
    moved, seen = np.empty(4), np.empty(4)
    for x, u in zip(what.states[:100], what.inputs[:100], strict=True):
        machine.transition(x, u, p, moved)
        machine.measurement(x, u, p, seen)
        np.testing.assert_allclose(moved, state_function(x, u, p), atol=1e-12)
        np.testing.assert_allclose(seen, measured(x, u, p), atol=1e-12)


@pytest.mark.parametrize("count", RECORDS)
@pytest.mark.parametrize(
    ("kernel", "bandwidth", "ours"),
    [
        (None, math.inf, None),
        ("gauss", 3.5, mcc(3.5)),
        ("cauchy", 50.0, ckmc(50.0)),
        ("cauchy", 5.0, ckmc(5.0)),
    ],
    ids=["CKF", "MCC-CKF", "CKMC-CKF 50", "CKMC-CKF 5"],
)
def test_the_filters(what: Plan, kernel: str | None, bandwidth: float, ours, count: int) -> None:
    """From before the fault into it (frame 25), under heavy tails."""
    correct = cubature.correct_ckf if ours is None else ours.correct
    noise, _ = mixture(0.9, 1e-6, 1e-4)(np.random.default_rng(5), what.states.shape)
    z = (what.measurements + noise)[: count + 1]
    inputs = np.ascontiguousarray(what.inputs[: count + 1])
    state = cubature.cubature_filter(what.states[0], 1e-5 * np.eye(4), Q, R, bandwidth)
    found = np.empty((count + 1, 4))
    told = np.full(z.shape, 1e-6)
    models = [cubature.as_model(f) for f in (machine.transition, machine.measurement)]
    cubature.track(*models, correct, state, cubature.Series(inputs, z, told, what.parameters), found)
    x, P = what.states[0].copy(), 1e-5 * np.eye(4)
    for k in range(1, count + 1):
        x, P = step(x, P, inputs[k], z[k], what.parameters, kernel, bandwidth)
        np.testing.assert_allclose(found[k], x, atol=2e-6)  # the fixed point is sought to 1e-6 deviations
    np.testing.assert_allclose(state.P, P, atol=1e-8)
