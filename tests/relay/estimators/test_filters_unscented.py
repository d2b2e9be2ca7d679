"""The steps of the filters library against filterpy, where the equations coincide."""

from __future__ import annotations

import numpy as np
import pytest
from filterpy.kalman import ExtendedKalmanFilter, KalmanFilter, MerweScaledSigmaPoints, UnscentedKalmanFilter

from faultloop.errors import InputError
from faultloop.relay.estimators import FREQUENCY, ROCOF, ROW, make_estimator, run_estimator
from faultloop.relay.estimators.filters import harmonic_model as model
from faultloop.relay.estimators.filters import kalman, strong_tracking, unscented

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


SIGMA = (9, 0.5, 2.0, 0.0)


def harmonic(softening=1.8, share=1.0):
    spread, excess = unscented.sigma_spread(*SIGMA)
    f = model.harmonic_filter(4, np.array([1 / 6400, spread, excess, softening, 0.95, share]))
    f.x[-1] = 100 * np.pi
    f.P[:] = np.diag([1.0] * 8 + [10.0])
    f.Q[:] = np.diag([1e-6] * 8 + [1e-4])
    f.disturbance[:-1] = [0.3, 0.3] + [0.03] * 6
    return f


def noisy_harmonics(count):
    angle = 2 * np.pi * 50.2 * np.arange(1, count + 1) / 6400
    noise = 0.02 * np.random.default_rng(4).normal(size=count)
    return np.sin(angle) + 0.2 * np.sin(3 * angle + 0.4) + noise


def test_extended_harmonic_filter_equals_filterpy():
    f = harmonic()
    peer = ExtendedKalmanFilter(dim_x=9, dim_z=1)
    peer.x, peer.P, peer.Q, peer.R = f.x.copy(), f.P.copy(), f.Q.copy(), np.array([[1e-3]])
    peer.F = np.empty((9, 9))

    def advance(u=0):
        model.jacobian(peer.x, 1 / 6400, peer.F)
        model.advance(peer.x, 1 / 6400)

    peer.predict_x = advance
    for z in noisy_harmonics(300):
        model.step_extended(f, z, 1e-3)
        peer.predict()
        peer.update(z, lambda x: f.row[None, :], lambda x: f.row @ x)
        np.testing.assert_allclose(f.x, peer.x, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(f.P, peer.P, rtol=1e-9, atol=1e-9)


def test_unscented_harmonic_filter_equals_filterpy():
    """filterpy transforms the measurement too; being linear, that changes nothing."""
    f = harmonic()

    def advanced(x, dt):
        x = x.copy()
        model.advance(x, dt)
        return x

    points = MerweScaledSigmaPoints(*SIGMA)
    peer = UnscentedKalmanFilter(9, 1, 1 / 6400, lambda x: f.row[None, :] @ x, advanced, points)
    peer.x, peer.P, peer.Q, peer.R = f.x.copy(), f.P.copy(), f.Q.copy(), np.array([[1e-3]])
    for z in noisy_harmonics(300):
        model.step_unscented(f, z, 1e-3)
        peer.predict()
        peer.update(z)
        np.testing.assert_allclose(f.x, peer.x, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(f.P, peer.P, rtol=1e-9, atol=1e-9)


def test_the_jacobian_is_the_derivative():
    rng = np.random.default_rng(5)
    x, F = rng.normal(size=9), np.empty((9, 9))
    x[-1] = 314.0
    model.jacobian(x, 1 / 6400, F)
    for i in range(9):
        step = 1e-3 if i == 8 else 1e-6
        up, down = x.copy(), x.copy()
        up[i] += step
        down[i] -= step
        model.advance(up, 1 / 6400)
        model.advance(down, 1 / 6400)
        np.testing.assert_allclose((up - down) / (2 * step), F[:, i], atol=1e-8)


def step_three(f, z, R):
    strong_tracking.step_strong_unscented(f, strong_tracking.seen(9), z, R)


@pytest.mark.parametrize("share", [0.0, 1.0])
@pytest.mark.parametrize(
    "step",
    [strong_tracking.step_strong, strong_tracking.step_modified, strong_tracking.step_disturbed, step_three],
    ids=["STF", "MSTUKF", "ours", "STUKF"],
)
def test_the_fading_makes_the_innovations_as_wide_as_they_show(step, share):
    """Eq. 34: h P h' = V - beta R before the correction, wherever lambda > 1; then 1 / (1 / that + 1 / R).

    Ours widens by a whole expected disturbance at least."""
    f = harmonic(share=share)
    R, widened = 1e-3, 0
    samples = noisy_harmonics(600)
    samples[400:] *= 1.5
    for z in samples:
        step(f, z, R)
        if f.memory[model.FADING] > 1.0:
            widened += 1
            wanted = f.memory[model.RESIDUAL_VARIANCE] - 1.8 * R
            after = kalman.predicted_variance(f.P, f.row)
            expected = 1 / (1 / wanted + 1 / R)
            if step is strong_tracking.step_disturbed:
                assert after >= expected * (1 - 1e-6)
            else:
                assert after == pytest.approx(expected, rel=1e-6)
        np.testing.assert_array_equal(f.P, f.P.T)
    assert 5 < widened < 500


def test_the_residual_variance_is_that_of_eq_12():
    f = harmonic()
    residuals = []
    for z in noisy_harmonics(50):
        strong_tracking.step_strong(f, z, 1e-3)
        residuals.append(f.memory[model.INNOVATION])
    V = residuals[0] ** 2
    for e in residuals[1:]:
        V = (0.95 * V + e * e) / 1.95
    assert f.memory[model.RESIDUAL_VARIANCE] == pytest.approx(V, rel=1e-12)


METHODS = ("ekf", "ukf", "stf", "stukf", "mstukf")


@pytest.mark.parametrize("method", METHODS)
def test_frequency_is_followed(method):
    """51.5 Hz from a nominal 50: frequency within 10 mHz and no rate, and a phasor that turns with it."""
    estimator = make_estimator(method, 4800, 50.0)
    angle = 2 * np.pi * 51.5 * np.arange(9600) / 4800
    samples = np.cos(angle[:, None] - np.arange(6) * np.pi / 3) * 1e4
    rows = np.empty((len(samples), ROW))
    run_estimator(estimator.step, estimator.state.copy(), samples, rows)
    assert rows[-1000:, FREQUENCY] == pytest.approx(51.5, abs=0.01)
    assert rows[-1000:, ROCOF] == pytest.approx(0.0, abs=0.02)
    phasor = rows[:, 0] + 1j * rows[:, 1]
    assert np.abs(phasor[-1000:]) == pytest.approx(1e4 / np.sqrt(2), rel=1e-3)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("order", [2, 4, 9, 11, 25, 48])
def test_a_harmonic_outside_the_model_is_noise(method, order):
    """10 % of one: the fundamental within 12 %, the frequency within 0.6 Hz, in the second half of a second.

    With R as the strong tracking filters' paper has it, fixed, the 25th gave 7300 % and the 48th 400000."""
    estimator = make_estimator(method, 4800, 50.0)
    angle = 2 * np.pi * 50 * np.arange(4800) / 4800
    samples = np.cos(angle[:, None] + np.arange(6)) + 0.1 * np.cos(order * angle[:, None] + 0.3)
    rows = np.empty((len(samples), ROW))
    run_estimator(estimator.step, estimator.state.copy(), samples, rows)
    phasors = np.sqrt(2) * rows[2400:, :12].copy().view(np.complex128)
    assert np.abs(phasors - np.exp(1j * np.arange(6))).max() < 0.12
    assert rows[2400:, FREQUENCY] == pytest.approx(50.0, abs=0.6)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"measurement_variance": 0.0}, "measurement_variance: 0 should be above 0"),
        ({"process_variance": -1e-8}, "process_variance: -1e-08 should be above 0"),
        ({"frequency_process_variance": 0.0}, "frequency_process_variance: 0 should be above 0"),
        ({"initial_variance": 0.0}, "initial_variance: 0 should be above 0"),
        ({"harmonics": 7}, "sampling_hz: 24 samples per cycle .* sampling_hz of at least 1400"),
    ],
)
def test_bad_settings_name_their_limit(method, settings, message):
    with pytest.raises(InputError, match=message):
        make_estimator(method, 1200, 50.0, **settings)
