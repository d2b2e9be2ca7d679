"""Cost of a step of each filter of the library, microseconds, beside filterpy's in the same run.

    python bench/filters.py

Linear: five states, two measurements.  Cubature: a pendulum, two states, three measurements, the model
compiled for filterpy too.  The others: nine states, one measurement, on the model of seed
paper 001; filterpy has no strong tracking, so STF stands beside its EKF, MSTUKF and STUKF beside its UKF.
Each must be at least 20 times faster.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable

import numpy as np
from filterpy.kalman import (
    CubatureKalmanFilter,
    ExtendedKalmanFilter,
    KalmanFilter,
    MerweScaledSigmaPoints,
    UnscentedKalmanFilter,
)

from faultloop.jit import njit
from faultloop.relay.estimators.filters import harmonic_model as model
from faultloop.relay.estimators.filters.kalman import (
    correct,
    innovation_of,
    predict_covariance,
    predict_state,
)
from faultloop.study.papers.ckmc import cubature
from faultloop.study.papers.mstukf.cases import TRACKS, Setting, noisy, track

LEAST_RATIO = 20.0
COUNT = 20_000
PEER_COUNT = 400
STATES = 9
STEP_S = 1 / 6400


def least_us(own: Callable[[], object], peer: Callable[[], object], repeats: int = 7) -> tuple[float, float]:
    """Least wall times of a step [us], run in turn so that both see the same machine."""
    times: tuple[list[float], list[float]] = ([], [])
    for _ in range(repeats):
        for call, taken in zip((own, peer), times, strict=True):
            start = time.perf_counter()
            call()
            taken.append(time.perf_counter() - start)
    return 1e6 * min(times[0]) / COUNT, 1e6 * min(times[1]) / PEER_COUNT


@njit
def run_linear(x, P, matrices, samples, work):
    F, Q, H = matrices
    gain = np.empty(len(x))
    for z in samples:
        predict_state(x, F, gain)
        predict_covariance(P, F, Q, work)
        for i in range(len(z)):
            correct(x, P, H[i], innovation_of(x, H[i], z[i]), 0.5, gain)


def linear() -> tuple[float, float]:
    rng = np.random.default_rng(1)
    peer = KalmanFilter(dim_x=5, dim_z=2)
    peer.F = np.linalg.qr(rng.normal(size=(5, 5)))[0]
    peer.H, peer.R = rng.normal(size=(2, 5)), 0.5 * np.eye(2)
    samples = rng.normal(size=(COUNT, 2))

    def filterpy() -> None:
        for z in samples[:PEER_COUNT]:
            peer.predict()
            peer.update(z)

    x, P, matrices = np.zeros(5), np.eye(5), (peer.F, np.eye(5), peer.H)
    work = np.empty((5, 5))
    run_linear(x, P, matrices, samples[:2], work)
    return least_us(lambda: run_linear(x, P, matrices, samples, work), filterpy)


@njit
def swing(x, u, p, out):
    out[0] = x[0] + 0.1 * x[1]
    out[1] = 0.98 * x[1] - 0.1 * np.sin(x[0])


@njit
def look(x, u, p, out):
    out[0] = np.cos(x[0])
    out[1] = x[0] + np.sin(x[1])
    out[2] = x[1]


def cubature_pair() -> tuple[float, float]:
    """CKF: the same model, noise and samples for both."""
    P, Q, R = 0.2 * np.eye(2), 0.01 * np.eye(2), 0.1 * np.eye(3)
    samples = 0.3 * np.random.default_rng(1).normal(size=(COUNT, 3))
    none = np.zeros(1)
    models = (cubature.as_model(swing), cubature.as_model(look))
    own = cubature.cubature_filter(np.zeros(2), P, Q, R)
    series = cubature.Series(np.zeros((COUNT, 1)), samples, np.tile(np.diag(R), (COUNT, 1)), none)
    out = np.empty((COUNT, 2))

    def moved(x: np.ndarray, dt: float) -> np.ndarray:
        y = np.empty(2)
        swing(x, none, none, y)
        return y

    def seen(x: np.ndarray) -> np.ndarray:
        y = np.empty(3)
        look(x, none, none, y)
        return y

    peer = CubatureKalmanFilter(2, 3, 0.1, seen, moved)
    peer.x, peer.P, peer.Q, peer.R = np.zeros((2, 1)), P.copy(), Q, R

    def filterpy() -> None:
        for z in samples[:PEER_COUNT]:
            peer.predict()
            peer.update(z[:, None])

    def run() -> None:
        cubature.track(*models, cubature.correct_ckf, own, series, out)

    run()  # compile
    filterpy()
    return least_us(run, filterpy)


def prior(peer: ExtendedKalmanFilter | UnscentedKalmanFilter) -> None:
    peer.P, peer.Q, peer.R = np.eye(STATES), 1e-8 * np.eye(STATES), np.array([[1e-3]])


def extended_peer(samples: np.ndarray) -> Callable[[], None]:
    row = model.measurement_row(STATES)[None, :]
    peer = ExtendedKalmanFilter(dim_x=STATES, dim_z=1)
    prior(peer)
    peer.x = np.zeros(STATES)
    peer.x[-1] = 100 * np.pi
    peer.F = np.zeros((STATES, STATES))

    def predicted(u: float = 0) -> None:  # compiled, so that what is timed is filterpy
        model.jacobian(peer.x, STEP_S, peer.F)
        model.advance(peer.x, STEP_S)

    peer.predict_x = predicted

    def filterpy() -> None:
        for z in samples[:PEER_COUNT]:
            peer.predict()
            peer.update(z, lambda x: row, lambda x: row @ x)

    return filterpy


def unscented_peer(samples: np.ndarray) -> Callable[[], None]:
    row = model.measurement_row(STATES)[None, :]

    def advanced(x: np.ndarray, dt: float) -> np.ndarray:
        x = x.copy()
        model.advance(x, dt)
        return x

    points = MerweScaledSigmaPoints(STATES, 0.5, 2.0, 0.0)
    peer = UnscentedKalmanFilter(STATES, 1, STEP_S, lambda x: row @ x, advanced, points)
    prior(peer)
    peer.x[-1] = 100 * np.pi

    def filterpy() -> None:
        for z in samples[:PEER_COUNT]:
            peer.predict()
            peer.update(z)

    return filterpy


def main() -> None:
    samples = np.resize(noisy("sag", 0), COUNT)
    extended, unscented = extended_peer(samples), unscented_peer(samples)
    rows = [("linear", *linear()), ("cubature", *cubature_pair())]
    for name in TRACKS:
        setting = Setting(name, 1.8)
        track(setting, samples[:10])  # compile
        peer = extended if name in ("EKF", "STF") else unscented
        rows.append((name, *least_us(lambda s=setting: track(s, samples), peer)))
    print(f"{'filter':14} us/step  filterpy us   ratio")
    for name, us, peer in rows:
        print(f"{name:14} {us:7.3f}  {peer:11.1f}  {peer / us:6.0f}")
    slow = [name for name, us, peer in rows if peer / us < LEAST_RATIO]
    if slow:
        sys.exit(f"less than {LEAST_RATIO:g} times faster: {', '.join(slow)}")


if __name__ == "__main__":
    main()
