"""Each paper's filter against its equations, written down here once more, plainly: one step and one record.

Numbers of equations are the papers'.  Nothing is shared with the package but the signals.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from faultloop.relay.estimators import make_estimator, run_estimator
from faultloop.relay.estimators.filters.harmonic_model import harmonic_filter
from faultloop.relay.estimators.filters.strong_tracking import seen
from faultloop.relay.estimators.filters.tracking import track_modified, track_strong, track_strong_unscented
from faultloop.relay.estimators.filters.unscented import sigma_spread
from faultloop.study.papers import rls
from faultloop.study.papers.adaptive_kalman import filter as kf
from faultloop.study.papers.ckmc import cubature
from faultloop.study.papers.ckmc.cases import BAD, GOOD, Q, R, ckmc, mcc, mixture, plan
from faultloop.study.papers.ckmc.machines import machine
from faultloop.study.papers.mstukf import cases
from faultloop.study.papers.taylor_kalman import as_written as taylor

RECORDS = (1, 60)  # one step, and a record


def phasors_of(estimator, samples):
    rows = np.empty((len(samples), 14))
    run_estimator(estimator.step, estimator.state.copy(), np.ascontiguousarray(samples), rows)
    return np.sqrt(2) * rows[:, :12].copy().view(complex)


# Seed paper 000 -----------------------------------------------------------------------------------------


def adaptive_kalman(z, last, p0, least):
    """Eq. 1 to 4 (or 11, 12), the filter's five, and eq. 10; ``last`` (n,) is the offset's column of H."""
    states = 2 if last is None else 3
    x, P = np.zeros(states), p0 * np.eye(states)
    found = []
    for k, sample in enumerate(z):
        angle = 2 * np.pi * k / 24
        H = np.array([math.cos(angle), -math.sin(angle), *([] if last is None else [last[k]])])
        S = max(H @ P @ H, 0.0)
        R_k = max((sample - H @ x) ** 2 - S, least)  # eq. 10; below zero: zero
        K = P @ H / (S + R_k)
        x = x + K * (sample - H @ x)
        P = (np.eye(states) - np.outer(K, H)) @ P
        P = 0.5 * (P + P.T)
        found.append(x[0] + 1j * x[1])
    return np.array(found)


@pytest.mark.parametrize("count", RECORDS)
def test_adaptive_kalman_as_written(count):
    """The study's filter and the relay's, a fault without renewal: both stay behind alike."""
    rng = np.random.default_rng(1)
    n = np.arange(count)
    v = np.cos(2 * np.pi * n / 24 + 0.3) * np.where(n < 30, 1.0, 0.4) + 0.01 * rng.normal(size=count)
    decay = math.exp(-1 / (0.04 * 1200))
    i = 5 * np.cos(2 * np.pi * n / 24 - 1.0) + 2.0 * decay**n + 0.05 * rng.normal(size=count)
    relay = make_estimator("adaptive-kalman", 1200, 50.0, form="as-written", offset="initial-value")
    samples = np.zeros((count, 6))
    samples[:, 0], samples[:, 3] = v, i
    ours = phasors_of(relay, samples)
    spread = {0: 1.0, 3: 3.0}
    for channel, z, last in ((0, v, None), (3, i, decay ** (n + 0.0))):
        # The relay's P(0) is its spread times the first squared sample.
        wanted = adaptive_kalman(z, last, spread[channel] ** 2 * z[0] ** 2, 1e-24 * z[0] ** 2)
        np.testing.assert_allclose(ours[:, channel], wanted, atol=1e-6 * np.abs(z).max())
        form = kf.VOLTAGE if last is None else kf.INITIAL_VALUE
        rule = kf.Rule(kf.EQ_10, renewed=False, spread=2.0, peak=1.0)
        study = kf.run_filter(z[:, None], rule, form, 0, 24, np.array([decay])).phasors[:, 0]
        np.testing.assert_allclose(study, adaptive_kalman(z, last, 4.0, 1e-24), atol=1e-6 * np.abs(z).max())


# Seed paper 001 -----------------------------------------------------------------------------------------

HARMONICS = np.array([1, 3, 5, 7])
H9 = np.array([1.0, 0, 1, 0, 1, 0, 1, 0, 0])


def turn(x, dt):
    """Eq. 42."""
    out = x.copy()
    for i, order in enumerate(HARMONICS):
        c, s = math.cos(order * x[8] * dt), math.sin(order * x[8] * dt)
        out[2 * i], out[2 * i + 1] = c * x[2 * i] + s * x[2 * i + 1], -s * x[2 * i] + c * x[2 * i + 1]
    return out


def jacobian(x, dt):
    """df/dx, by hand."""
    F = np.zeros((9, 9))
    F[8, 8] = 1.0
    y = turn(x, dt)
    for i, order in enumerate(HARMONICS):
        c, s = math.cos(order * x[8] * dt), math.sin(order * x[8] * dt)
        F[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = [[c, s], [-s, c]]
        F[2 * i : 2 * i + 2, 8] = order * dt * np.array([y[2 * i + 1], -y[2 * i]])
    return F


def sigma(x, P, dt, alpha=1e-3, beta=2.0, kappa=0.0):
    """Eq. 22 to 25 without Q: the weights as they are printed."""
    n = 9
    lam = alpha**2 * (n + kappa) - n
    root = np.linalg.cholesky((n + lam) * P)
    points = np.vstack([x, x + root.T, x - root.T])
    w = np.full(2 * n + 1, 0.5 / (n + lam))
    wm, wc = w.copy(), w.copy()
    wm[0] = lam / (n + lam)
    wc[0] = wm[0] + 1 - alpha**2 + beta
    images = np.array([turn(p, dt) for p in points])
    mean = wm @ images
    return mean, (images - mean).T @ (wc[:, None] * (images - mean))


def strong_tracking_step(state, V, sample, R_k, Q9, settings, kind):
    """Eq. 4 to 12 (``stf``; in sigma points ``stukf``) or 20 to 39 (``mstukf``), alpha_j = 1."""
    x, P = state
    dt, beta, rho = settings
    if kind == "stf":
        F = jacobian(x, dt)
        x, without = turn(x, dt), F @ P @ F.T
    else:
        x, without = sigma(x, P, dt)
    gamma = sample - H9 @ x
    V = gamma**2 if V is None else (rho * V + gamma**2) / (1 + rho)  # eq. 12
    if kind == "mstukf":
        lam = max(1.0, (V - beta * R_k) / (H9 @ (without + Q9) @ H9))  # eq. 36 to 39
        P = lam * (without + Q9)  # eq. 26
    else:
        lam = max(1.0, (V - H9 @ Q9 @ H9 - beta * R_k) / (H9 @ without @ H9))  # eq. 9 to 11
        P = lam * without + Q9  # eq. 5
    Pz = H9 @ P @ H9 + R_k
    K = P @ H9 / Pz
    P = P - np.outer(K, K) * Pz  # eq. 31, 19
    return x + K * gamma, 0.5 * (P + P.T), V, lam


def own_filter(track, z, start, settings, rho):
    """The package's, from the same start; STUKF's own arrays where it is that."""
    x, P, Q = start
    dt, beta, _ = settings
    spread, excess = sigma_spread(9, 1e-3, 2.0, 0.0)
    f = harmonic_filter(4, np.array([dt, spread, excess, beta, rho, 1.0]))
    f.x[:], f.P[:], f.Q[:] = x, P, Q
    out = np.empty((len(z), 7))
    extra = (seen(9),) if track is track_strong_unscented else ()
    track(f, *extra, z, 1e-3, out)
    return out, f


@pytest.mark.parametrize(("first", "count"), [(690, 1), (690, 60), (1390, 60)])
@pytest.mark.parametrize(
    ("kind", "track"),
    [("stf", track_strong), ("mstukf", track_modified), ("stukf", track_strong_unscented)],
)
def test_strong_tracking_filters(kind, track, first, count):
    """Over the beginning and the end of the paper's sag."""
    z = cases.noisy("sag", 2)[first : first + count]
    angle = 2 * np.pi * 50 * first / 6400
    x = np.zeros(9)
    x[:2], x[8] = (math.sin(angle), math.cos(angle)), 100 * np.pi
    P = np.diag([*np.full(8, 1e-4), 1e-3]) + 1e-6
    Q9, settings = 1e-8 * np.eye(9), (1 / 6400, 1.8, 0.95)
    found, f = own_filter(track, z, (x, P, Q9), settings, 0.95)
    V, factors = None, []
    for k, sample in enumerate(z):
        x, P, V, factor = strong_tracking_step((x, P), V, sample, 1e-3, Q9, settings, kind)
        np.testing.assert_allclose(found[k, :4], np.hypot(x[0:8:2], x[1:8:2]), atol=1e-6)
        factors.append(factor)
    np.testing.assert_allclose(f.x[:8], x[:8], atol=1e-6)
    np.testing.assert_allclose(found[:, 6], factors, rtol=1e-4)
    if first == 690 and count > 1:
        assert found[10, 6] > 10  # sample 701 is found


@pytest.mark.parametrize("method", ["stf", "stukf", "mstukf"])
def test_relay_s_filters_as_written(method):
    """Settings of a relay that make it the paper's: R fixed, no bounds, the frequency faded as all."""
    n = np.arange(100)
    v = np.cos(2 * np.pi * 50 * n / 6400 + 0.3) * np.where(n < 70, 1.0, 0.5)
    v += 0.02 * np.random.default_rng(4).normal(size=len(n))
    parameters = {"form": "as-written", "softening_factor": 1.8, "frequency_share": 1.0}
    parameters |= {"process_variance": 1e-8, "frequency_process_variance": 1e-8}
    parameters |= {"initial_variance": 10.0, "frequency_initial_variance": 1.0}
    parameters |= {"fading": "covariance"} if method == "mstukf" else {}
    samples = np.zeros((len(n), 6))
    samples[:, 0] = v
    ours = phasors_of(make_estimator(method, 6400, 50.0, **parameters), samples)[:, 0]
    level = np.maximum.accumulate(v**2)  # the per unit: squared, the greatest so far; R, P0, Q are in it
    x = np.zeros(9)
    x[8] = 100 * np.pi
    state, V = (x, np.diag([*np.full(8, 10.0 * level[0]), 1.0])), None
    for k, sample in enumerate(v):
        Q9 = np.diag([*np.full(8, 1e-8 * level[k]), 1e-8])
        step = strong_tracking_step(state, V, sample, 1e-3 * level[k], Q9, (1 / 6400, 1.8, 0.95), method)
        state, V = step[:2], step[2]
        sine, cosine = state[0][:2]  # A sin p, A cos p: the phasor is A e^(j (p - 90 deg))
        turned = ours[k] * np.exp(2j * np.pi * 50 * k / 6400)
        assert abs(turned - (sine - 1j * cosine)) < 1e-5


# Seed paper 002 -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("carried", [taylor.as_they_are, taylor.moved])
@pytest.mark.parametrize("count", [11, 70])
def test_taylor_kalman(count, carried):
    """Section 2.2's start over ten samples, then eq. 16 to 20 in windows of 40 ms at 400 Hz."""
    fs, window, m, q = 400, 16, 10, 0.3
    t = np.arange(count) / fs
    z = 311 * np.cos(2 * np.pi * 49.7 * t + 0.5) + np.random.default_rng(3).normal(size=count)

    def row(since, n):
        tau, angle = since / window, 2 * np.pi * 50 * n / fs
        return np.array(
            [tau**p * math.cos(angle) for p in range(5)] + [-(tau**p) * math.sin(angle) for p in range(5)]
        )

    H = np.array([row(n, n) for n in range(m)])
    inverse = np.linalg.inv(H.T @ H)
    x, P = inverse @ H.T @ z[:m], inverse
    wanted = []
    for n in range(m, count):
        since = (n - m) % window
        if since == 0 and carried is taylor.moved:  # p(t) about the old origin's passed = p(t + passed)
            passed = (m if n == m else window) / window
            coefficients = np.polynomial.Polynomial(x[:5] + 1j * x[5:])(
                np.polynomial.Polynomial([passed, 1.0])
            ).coef
            x = np.concatenate([coefficients.real, coefficients.imag])
            shift = np.array(
                [[math.comb(k, j) * passed ** (k - j) if k >= j else 0.0 for k in range(5)] for j in range(5)]
            )
            P = np.kron(np.eye(2), shift) @ P @ np.kron(np.eye(2), shift).T
        h = row(since, n)
        P = P + q * np.eye(10)  # eq. 20
        K = P @ h / (h @ P @ h + 1.0)  # 16
        P = (np.eye(10) - np.outer(K, h)) @ P  # 17
        x = x + K * (z[n] - h @ x)  # 18
        powers = (since / window) ** np.arange(5)
        wanted.append((powers @ x[:5] + 1j * (powers @ x[5:])) / np.sqrt(2))
    form = taylor.Form(window, carried, taylor.least_squares, m, q)
    phasor, _, _ = taylor.written_filter(z, fs, 50.0, form)
    assert np.isnan(phasor[:m]).all()
    np.testing.assert_allclose(phasor[m:], wanted, atol=1e-6 * 311)


def test_taylor_kalman_s_least_squares_start_in_a_relay():
    """At the last sample of the first window: the polynomial of the least squares, evaluated there."""
    fs, window = 800, 40
    n = np.arange(window)
    z = 100 * np.cos(2 * np.pi * 50.4 * n / fs + 0.4) + np.random.default_rng(8).normal(size=window)
    samples = np.zeros((window, 6))
    samples[:, 0] = z
    ours = phasors_of(make_estimator("taylor-kalman", fs, 50.0, start="least-squares"), samples)[:, 0]
    tau, angle = n / window, 2 * np.pi * 50 * n / fs
    H = np.column_stack(
        [tau**p * np.cos(angle) for p in range(5)] + [-(tau**p) * np.sin(angle) for p in range(5)]
    )
    x = np.linalg.lstsq(H, z, rcond=None)[0]
    last = tau[-1] ** np.arange(5)
    assert abs(ours[-1] - (last @ x[:5] + 1j * (last @ x[5:]))) < 1e-6 * 100
    assert np.abs(ours[:-1]).max() == 0.0  # nothing was known before


# Seed paper 003 -----------------------------------------------------------------------------------------


def weights(e, kernel, bandwidth):
    if kernel == "gauss":
        return np.exp(-(e**2) / (2 * bandwidth**2))
    return 1.0 / (1.0 + e**2 / bandwidth) ** 2  # the derivative of eq. 12, over e


def cubature_step(x, P, u, z, p, filter_):
    """Eq. 16 to 42 in their usual form: points, regression, K of weighted P and R, the fixed point."""
    kernel, bandwidth = filter_

    def call(function, state, count):
        out = np.empty(count)
        function.py_func(np.ascontiguousarray(state), u, p, out)
        return out

    S = np.linalg.cholesky(P)
    points = [x + s * math.sqrt(4) * S[:, j] for s in (1, -1) for j in range(4)]
    moved = np.array([call(machine.transition, point, 4) for point in points])
    x = moved.mean(axis=0)
    P = (moved - x).T @ (moved - x) / 8 + np.diag(Q)
    S = np.linalg.cholesky(P)
    points = np.array([x + s * math.sqrt(4) * S[:, j] for s in (1, -1) for j in range(4)])
    seen_ = np.array([call(machine.measurement, point, 4) for point in points])
    expected = seen_.mean(axis=0)
    Pxz = (points - x).T @ (seen_ - expected) / 8
    Pzz = (seen_ - expected).T @ (seen_ - expected) / 8 + np.diag(R)
    if kernel is None:
        K = Pxz @ np.linalg.inv(Pzz)
        return x + K @ (z - expected), P - K @ Pzz @ K.T
    H = Pxz.T @ np.linalg.inv(P)  # eq. 28
    Bp, Br = np.linalg.cholesky(P), np.linalg.cholesky(Pzz - H @ P @ H.T)
    best = x
    for _ in range(300):  # eq. 36 to 41
        ex = np.linalg.solve(Bp, x - best)
        ez = np.linalg.solve(Br, z - expected - H @ (best - x))
        Pt = Bp @ np.diag(1 / weights(ex, kernel, bandwidth)) @ Bp.T
        Rt = Br @ np.diag(1 / weights(ez, kernel, bandwidth)) @ Br.T
        K = Pt @ H.T @ np.linalg.inv(H @ Pt @ H.T + Rt)
        before, best = best, x + K @ (z - expected)
        if np.abs(best - before).max() < 1e-13:
            break
    I_KH = np.eye(4) - K @ H
    return best, I_KH @ P @ I_KH.T + K @ (Pzz - H @ P @ H.T) @ K.T  # eq. 42


@pytest.mark.parametrize("count", RECORDS)
@pytest.mark.parametrize(
    ("kernel", "bandwidth", "ours"),
    [(None, 0.0, "ckf"), ("gauss", 3.5, mcc(3.5)), ("cauchy", 50.0, ckmc(50.0)), ("cauchy", 5.0, ckmc(5.0))],
)
def test_cubature_filters(kernel, bandwidth, ours, count):
    """From before the fault into it (frame 25), under heavy tails."""
    what = plan()
    correct = cubature.correct_ckf if ours == "ckf" else ours.correct
    noise, _ = mixture(0.9, GOOD, BAD)(np.random.default_rng(5), what.states.shape)
    z = (what.measurements + noise)[: count + 1]
    inputs = np.ascontiguousarray(what.inputs[: count + 1])
    state = cubature.cubature_filter(
        what.states[0], 1e-5 * np.eye(4), np.diag(Q), np.diag(R), bandwidth if bandwidth else math.inf
    )
    found = np.empty((count + 1, 4))
    told = np.broadcast_to(R, z.shape).copy()
    models = [cubature.as_model(f) for f in (machine.transition, machine.measurement)]
    cubature.track(*models, correct, state, cubature.Series(inputs, z, told, what.parameters), found)
    x, P = what.states[0].copy(), 1e-5 * np.eye(4)
    for k in range(1, count + 1):
        x, P = cubature_step(x, P, inputs[k], z[k], what.parameters, (kernel, bandwidth))
        np.testing.assert_allclose(found[k], x, atol=2e-6)  # the fixed point is sought to 1e-6 deviations
    np.testing.assert_allclose(state.P, P, atol=1e-8)


# Seed paper 004 -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("count", RECORDS)
def test_recursive_least_squares(count):
    """Eq. 2 to 4 with P0 = alpha^2 I, and the package's own rls, whose unknowns are turned and decayed."""
    td, per_cycle, alpha_squared = 0.03, 24, 1e6
    i = np.arange(1, count + 1)
    h = np.column_stack(
        [np.exp(-i / (td * 1200)), np.cos(2 * np.pi * i / per_cycle), np.sin(2 * np.pi * i / per_cycle)]
    )
    z = h @ [0.9, 0.6, -0.8] + 0.05 * np.random.default_rng(2).normal(size=count)
    x, P = np.zeros(3), alpha_squared * np.eye(3)
    wanted = []
    for row, sample in zip(h, z, strict=True):
        K = P @ row / (row @ P @ row + 1)  # eq. 4
        x = x + K * (sample - row @ x)  # eq. 3
        P = P - np.outer(P @ row, row @ P) / (row @ P @ row + 1)  # eq. 2
        wanted.append(x)
    found = rls.estimates(h, z[:, None], rls.gains(h, alpha_squared))[:, :, 0]
    np.testing.assert_allclose(found, wanted, atol=1e-6)
    np.testing.assert_allclose(rls.on_line(h, z, alpha_squared), wanted, atol=1e-9)
    root = rls.square_root(z, per_cycle, 1, alpha_squared)
    # The unknown offset is its value one sample later in the package: P0 differs by the decay only.
    np.testing.assert_allclose(root[2:], np.array(wanted)[2:, 1] + 1j * np.array(wanted)[2:, 2], atol=5e-3)
