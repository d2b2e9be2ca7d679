"""The steps of the filters library against filterpy, where the equations coincide."""

from __future__ import annotations

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter, MerweScaledSigmaPoints, UnscentedKalmanFilter

from faultloop.errors import InputError
from faultloop.relay.estimators.filters import kalman, unscented

STATES = 5


def random_covariance(rng, n):
    root = rng.normal(size=(n, n))
    return root @ root.T + 0.1 * np.eye(n)


def test_linear_filter_equals_filterpy():
    rng = np.random.default_rng(1)
    peer = KalmanFilter(dim_x=STATES, dim_z=2)
    peer.F = np.eye(STATES) + 0.1 * rng.normal(size=(STATES, STATES))
    peer.F /= np.abs(np.linalg.eigvals(peer.F)).max()
    peer.Q = 0.1 * random_covariance(rng, STATES)
    peer.H = rng.normal(size=(2, STATES))
    peer.R = np.diag([0.3, 0.7])
    peer.P = random_covariance(rng, STATES)
    peer.x = rng.normal(size=(STATES, 1))
    x, P = peer.x[:, 0].copy(), peer.P.copy()
    joint_x, joint_P = x.copy(), P.copy()
    vector, matrix = np.empty(STATES), np.empty((STATES, STATES))
    for z in rng.normal(size=(200, 2)):
        peer.predict()
        peer.update(z)
        for state, covariance in ((x, P), (joint_x, joint_P)):
            kalman.predict_state(state, peer.F, vector)
            kalman.predict_covariance(covariance, peer.F, peer.Q, matrix)
        for row, value, variance in zip(peer.H, z, np.diag(peer.R), strict=True):
            kalman.correct(x, P, row, kalman.innovation_of(x, row, value), variance, vector)
        total = peer.H @ joint_P @ peer.H.T + peer.R
        cross = joint_P @ peer.H.T
        kalman.correct_jointly(joint_x, joint_P, z - peer.H @ joint_x, cross, total, np.empty((STATES, 2)))
        for state, covariance in ((x, P), (joint_x, joint_P)):
            np.testing.assert_allclose(state, peer.x[:, 0], rtol=1e-9, atol=1e-9)
            np.testing.assert_allclose(covariance, peer.P, rtol=1e-9, atol=1e-9)


def bend(point, _dt=0.0):
    return np.sin(point) + 0.5 * np.cos(point[::-1])


def seen(point):
    return np.array([point[0] * point[1], np.cos(point[2]) + point[4]])


def test_unscented_filter_equals_filterpy():
    rng = np.random.default_rng(2)
    sampling = MerweScaledSigmaPoints(STATES, 0.7, 2.0, 1.0)
    peer = UnscentedKalmanFilter(STATES, 2, 1.0, seen, bend, sampling)
    peer.Q, peer.R = 0.1 * np.eye(STATES), np.diag([0.3, 0.7])
    peer.P = random_covariance(rng, STATES)
    peer.x = rng.normal(size=STATES)
    x, P = peer.x.copy(), peer.P.copy()
    spread, excess = unscented.sigma_spread(STATES, 0.7, 2.0, 1.0)
    points, root = np.empty((2 * STATES + 1, STATES)), np.empty((STATES, STATES))
    image, total, cross = np.empty(2), np.empty((2, 2)), np.empty((STATES, 2))
    for z in rng.normal(size=(50, 2)):
        peer.predict()
        peer.update(z)
        unscented.draw(x, P, spread, points, root)
        points[:] = [bend(point) for point in points]
        unscented.moments(points, spread, excess, x, P)
        P += peer.Q
        unscented.draw(x, P, spread, points, root)
        images = np.array([seen(point) for point in points])
        unscented.moments(images, spread, excess, image, total)
        total += peer.R
        unscented.cross_covariance_of(points, images, spread, excess, (x, image), cross)
        kalman.correct_jointly(x, P, z - image, cross, total, np.empty((STATES, 2)))
        np.testing.assert_allclose(x, peer.x, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(P, peer.P, rtol=1e-9, atol=1e-9)


def test_a_narrow_spread_keeps_a_linear_map_exact():
    """alpha = 1e-3, as seed paper 001: the mean rests on weights of half a million."""
    rng = np.random.default_rng(3)
    x, P = np.array([0.5, -0.2, 0.0, 0.1, 314.15926]), 1e-8 * random_covariance(rng, STATES)
    A = rng.normal(size=(STATES, STATES))
    spread, excess = unscented.sigma_spread(STATES, 1e-3, 2.0, 0.0)
    points, root = np.empty((2 * STATES + 1, STATES)), np.empty((STATES, STATES))
    unscented.draw(x, P, spread, points, root)
    points[:] = points @ A.T
    mean, covariance = np.empty(STATES), np.empty((STATES, STATES))
    unscented.moments(points, spread, excess, mean, covariance)
    np.testing.assert_allclose(mean, A @ x, rtol=1e-9)
    np.testing.assert_allclose(covariance, A @ P @ A.T, rtol=1e-4, atol=1e-11)


def test_cholesky_of_a_singular_covariance():
    L = np.array([[2.0, 0, 0], [1, 0, 0], [3, 0, 0.5]])
    root = np.full((3, 3), 9.0)
    assert not kalman.cholesky(L @ L.T, root)
    np.testing.assert_allclose(root @ root.T, L @ L.T)
    assert kalman.cholesky(np.eye(3), root)


@pytest.mark.parametrize(
    ("arguments", "key"),
    [((5, 0.0, 2.0, 0.0), "alpha"), ((5, 1.0, 0.5, 0.0), "beta"), ((5, 1.0, 2.0, -5.0), "kappa")],
)
def test_a_spread_out_of_its_limits_is_refused(arguments, key):
    with pytest.raises(InputError, match=f"{key}: .* should be"):
        unscented.sigma_spread(*arguments)
