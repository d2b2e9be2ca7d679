"""Cubature filter against filterpy; its correntropy relatives against the gain form and their limits."""

from __future__ import annotations

import math

import numpy as np
import pytest
from filterpy.kalman import CubatureKalmanFilter
from hypothesis import given, settings
from hypothesis import strategies as st

from faultloop.errors import InputError
from faultloop.jit import njit
from faultloop.study.papers.ckmc import cubature
from faultloop.study.papers.ckmc.cubature import (
    Cubature,
    Series,
    as_model,
    correct_ckf,
    correct_ckmc,
    correct_mcc,
    cubature_filter,
    observe,
    predict,
    redraw,
    track,
)

P0 = np.array([[0.3, 0.1], [0.1, 0.2]])
Q = np.diag([0.01, 0.02])
R = np.diag([0.1, 0.2, 0.05])
U, P = np.zeros(1), np.ones(2)
"""``P`` scales the states: the model is that of x / P."""


@njit
def swing(x, u, p, out):
    a, b = x[0] / p[0], x[1] / p[1]
    out[0] = p[0] * (a + 0.1 * b)
    out[1] = p[1] * (0.98 * b - 0.1 * math.sin(a) + u[0])


@njit
def look(x, u, p, out):
    a, b = x[0] / p[0], x[1] / p[1]
    out[0] = math.cos(a)
    out[1] = a + math.sin(b)
    out[2] = b


MODEL = (as_model(swing), as_model(look))


def filter_of(bandwidth: float = math.inf) -> Cubature:
    return cubature_filter(np.array([0.5, 0.1]), P0, Q, R, bandwidth)


def draw(count: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(count, 3))


def series(z: np.ndarray, scale: np.ndarray = P) -> Series:
    return Series(np.zeros((len(z), 1)), z, np.tile(np.diag(R), (len(z), 1)), scale)


def run(correct, f: Cubature, z: np.ndarray, scale: np.ndarray = P) -> np.ndarray:
    out = np.empty((len(z), 2))
    track(*MODEL, correct, f, series(z, scale), out)
    return out


def test_equals_filterpy() -> None:
    def fx(x, dt):
        return np.array([x[0] + 0.1 * x[1], 0.98 * x[1] - 0.1 * np.sin(x[0])])

    def hx(x):
        return np.array([np.cos(x[0]), x[0] + np.sin(x[1]), x[1]])

    peer = CubatureKalmanFilter(2, 3, 0.1, hx, fx)
    peer.x, peer.P, peer.Q, peer.R = np.array([[0.5], [0.1]]), P0.copy(), Q, R
    f = filter_of()
    for z in draw(200):
        peer.predict()
        peer.update(z[:, None])
        predict(f, MODEL[0], U, P)
        observe(f, MODEL[1], U, P, z)
        correct_ckf(f)
        np.testing.assert_allclose(f.x, peer.x.ravel(), rtol=0, atol=1e-9)
        np.testing.assert_allclose(f.P, peer.P, rtol=0, atol=1e-9)


def test_a_tracked_series_is_its_steps() -> None:
    z = draw(20)
    f = filter_of()
    tracked = run(correct_ckf, filter_of(), z)
    for k in range(1, len(z)):
        predict(f, MODEL[0], U, P)
        redraw(f)
        observe(f, MODEL[1], U, P, z[k])
        correct_ckf(f)
        assert np.array_equal(f.x, tracked[k])


def test_a_wide_kernel_is_the_cubature_filter() -> None:
    z = draw(200)
    plain = run(correct_ckf, f := filter_of(), z)
    for correct, bandwidth in ((correct_mcc, 1e7), (correct_ckmc, 1e14)):
        assert run(correct, g := filter_of(bandwidth), z) == pytest.approx(plain, abs=1e-9)
        assert pytest.approx(f.P, abs=1e-9) == g.P


def weight_gauss(e: np.ndarray) -> np.ndarray:
    return np.exp(-(e**2) / (2 * 2.0**2))


def weight_cauchy(e: np.ndarray) -> np.ndarray:
    return (1 + e**2 / 5.0) ** -2.0


@pytest.mark.parametrize(
    ("correct", "bandwidth", "weight"), [(correct_mcc, 2.0, weight_gauss), (correct_ckmc, 5.0, weight_cauchy)]
)
def test_the_fixed_point_is_that_of_the_gain_form(correct, bandwidth: float, weight) -> None:
    """K = P~ H' (H P~ H' + R~)^-1, as usually written, with the inverse weights."""
    f = filter_of(bandwidth)
    for z in 1.5 * draw(30, seed=4):
        predict(f, MODEL[0], U, P)
        redraw(f)
        observe(f, MODEL[1], U, P, z)
        x, p, y = f.x.copy(), f.P.copy(), f.innovation.copy()
        h = np.linalg.solve(p, f.cross).T
        r = f.total - h @ p @ h.T
        bp, br = np.linalg.cholesky(p), np.linalg.cholesky(r)
        step, gain = np.zeros(2), np.zeros((2, 3))
        for _ in range(cubature.MOST_ITERATIONS):
            before = step
            cx = weight(np.linalg.solve(bp, step))
            cz = weight(np.linalg.solve(br, y - h @ step))
            pt, rt = bp @ np.diag(1 / cx) @ bp.T, br @ np.diag(1 / cz) @ br.T
            gain = pt @ h.T @ np.linalg.inv(h @ pt @ h.T + rt)
            step = gain @ y
            if np.abs(np.linalg.solve(bp, step - before)).max() <= cubature.SETTLED:
                break
        correct(f)
        left = np.eye(2) - gain @ h
        assert f.x == pytest.approx(x + step, abs=1e-9)
        assert pytest.approx(left @ p @ left.T + gain @ r @ gain.T, abs=1e-9) == f.P


@pytest.mark.parametrize("correct", [correct_ckf, correct_mcc, correct_ckmc])
def test_units_do_not_matter(correct) -> None:
    """Scaled states: the same estimates, the correntropy's errors being white."""
    z = 2 * draw(100, seed=1)
    scale = np.array([1e3, 1e-2])
    f = filter_of(3.0)
    g = cubature_filter(f.x * scale, P0 * np.outer(scale, scale), Q * np.outer(scale, scale), R, 3.0)
    assert run(correct, g, z, scale) / scale == pytest.approx(run(correct, f, z), abs=1e-8)


def test_an_outlier_moves_the_robust_ones_less() -> None:
    z = np.tile([math.cos(0.0), 0.0, 0.0], (50, 1))
    z[25, 2] = 20.0
    plain, gauss, cauchy = (
        np.abs(run(c, filter_of(b), z)[25]).max()
        for c, b in ((correct_ckf, math.inf), (correct_mcc, 3.0), (correct_ckmc, 9.0))
    )
    assert gauss < 0.05 * plain
    assert cauchy < 0.05 * plain


@given(
    st.sampled_from([correct_ckf, correct_mcc, correct_ckmc]),
    st.floats(1e-3, 1e6),
    st.lists(st.tuples(*[st.floats(-1e9, 1e9)] * 3), min_size=2, max_size=40),
)
@settings(max_examples=60, deadline=None)
def test_the_covariance_stays_positive_definite(correct, bandwidth: float, z: list) -> None:
    f = filter_of(bandwidth)
    out = run(correct, f, np.array(z))
    assert np.isfinite(out).all()
    assert np.isfinite(f.P).all()
    assert np.array_equal(f.P, f.P.T)
    assert np.linalg.eigvalsh(f.P).min() > 0


@pytest.mark.parametrize("correct", [correct_ckf, correct_mcc, correct_ckmc])
def test_it_stays_so_over_many_steps(correct) -> None:
    f = filter_of(5.0)
    z = draw(200_000, seed=2)
    z[::97] *= 1e4
    assert np.isfinite(run(correct, f, z)).all()
    assert np.linalg.eigvalsh(f.P).min() > 0


def test_wrong_matrices_are_named() -> None:
    x = np.zeros(2)
    with pytest.raises(InputError, match=r"^P: should be a symmetric 2 x 2 matrix"):
        cubature_filter(x, np.eye(3), Q, R)
    with pytest.raises(InputError, match=r"^R: should have positive variances"):
        cubature_filter(x, P0, Q, np.diag([1.0, 0.0, 1.0]))
    with pytest.raises(InputError, match=r"^Q: should have no negative variances"):
        cubature_filter(x, P0, -Q, R)
    with pytest.raises(InputError, match=r"^bandwidth"):
        cubature_filter(x, P0, Q, R, 0.0)
