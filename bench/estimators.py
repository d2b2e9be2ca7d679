"""Cost of every estimator: six channels, 4800 samples per second, microseconds per sample, best of several
runs.

Beside them filterpy's KalmanFilter with the same states (three of two, three of three), in the same run;
beside kalman-bank a filterpy filter for each of its own (three of two, 36 of three).  The harmonic filters,
nine states a channel, stand beside filterpy's of the same states in bench/filters.py.

    python bench/estimators.py
"""

from __future__ import annotations

import time

import numpy as np
from filterpy.kalman import KalmanFilter

from faultloop.relay.estimators import (
    ROW,
    estimator_methods,
    estimator_parameters,
    make_estimator,
    run_estimator,
)

SAMPLING_HZ = 4800
FREQUENCY_HZ = 50.0
HARMONIC = ("ekf", "ukf", "stf", "stukf", "mstukf")
COUNT = 20_000
REPEATS = 9


def noisy_waveforms(count: int) -> np.ndarray:
    turns = np.arange(count)[:, None] * FREQUENCY_HZ / SAMPLING_HZ
    wave = np.cos(2 * np.pi * (turns + np.arange(6) / 6))
    return wave + 0.01 * np.random.default_rng(1).normal(size=wave.shape)


def best_us(call, count: int, repeats: int = REPEATS) -> float:
    """Least wall time of ``call()`` per sample [us]."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
    return 1e6 * min(times) / count


def filterpy_us(models: int = 1) -> float:
    """Filterpy with ``models`` filters for each current."""
    count = 300 if models == 1 else 50
    samples = noisy_waveforms(count)
    channels = [*range(3), *sorted([*range(3, 6)] * models)]
    filters = [(c, KalmanFilter(dim_x=2 + c // 3, dim_z=1)) for c in channels]

    def run() -> None:
        for n in range(count):
            angle = 2 * np.pi * FREQUENCY_HZ * n / SAMPLING_HZ
            row = np.array([[np.cos(angle), -np.sin(angle), 1.0]])
            for c, each in filters:
                each.predict()
                each.update(samples[n, c], H=row[:, : each.dim_x])

    return best_us(run, count, 3)


def main() -> None:
    samples = noisy_waveforms(COUNT)
    rows = np.empty((COUNT, ROW))
    peer = filterpy_us()
    peers = {"kalman-bank": filterpy_us(int(estimator_parameters("kalman-bank")["models"]))}
    print(f"{'estimator':18} us/sample   filterpy / this")
    for method in estimator_methods():
        estimator = make_estimator(method, SAMPLING_HZ, FREQUENCY_HZ)
        state = estimator.state.copy()
        run_estimator(estimator.step, state, samples, rows)  # compile

        us = best_us(lambda e=estimator, s=state: run_estimator(e.step, s, samples, rows), COUNT)
        ratio = "-" if method in HARMONIC else f"{peers.get(method, peer) / us:.0f}"
        print(f"{method:18} {us:9.3f}   {ratio:>9}")
    print(f"{'filterpy':18} {peer:9.1f}   {1:9d}")


if __name__ == "__main__":
    main()
