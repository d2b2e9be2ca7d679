"""The cases of the estimators' suite: one phase's fault with a decaying offset, at an instant that nobody
tells the estimator.

Before the fault every phase carries a load current of 0.2 at -20 degrees beside voltages of 1.  At t0 phase a
becomes a fault current of 1 at -80 degrees with the offset that keeps the inductive current continuous, and
nothing else changes: the voltages stay, so that the inception must be seen in this one current.  The
instants are spaced by a 24th of the cycle and fall between the samples.

The reference is the true phasor against cos(2 pi f0 t): at a frequency f it turns by 2 pi (f - f0) t.  The
error is the length of the difference over the true length (total vector error).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from faultloop.relay.estimators import ROW, Estimator, run_estimator

Array = NDArray[np.float64]

NOMINAL_HZ = 50.0
BEFORE_S = 0.3
AFTER_S = 0.16
LOAD, LOAD_ANGLE, FAULT_ANGLE = 0.2, np.radians(-20.0), np.radians(-80.0)
WITHIN = 0.05
PHASES = -2.0 * np.pi / 3.0 * np.arange(3)
HARMONICS = ((3, 0.10), (5, 0.05))
CVT_VOLTAGE, CVT_SIZE, CVT_HZ, CVT_TAU_S = 0.5, 0.1, 20.0, 0.015


@dataclass(frozen=True)
class Grid:
    """Every combination of these; noise is the standard deviation over the fault current's peak.

    ``kind``: ``offset``; ``harmonics``: the fault current has them too; ``cvt``: voltage a falls to 0.5 at t0
    and a decaying oscillation of 0.1 at 20 Hz is on it, and it is the voltage's phasor that is judged.
    """

    taus_ms: tuple[float, ...]
    noises: tuple[float, ...]
    frequencies_hz: tuple[float, ...]
    angles: int = 24
    kind: str = "offset"


OFFSETS = Grid((10, 20, 40, 60, 100, 200), (0.0, 0.01), (49.0, 49.5, 50.0, 50.5, 51.0))
BETWEEN = replace(OFFSETS, taus_ms=(13, 16, 23, 30, 50, 80, 130, 160), frequencies_hz=(49.0, 50.5))
WITH_HARMONICS = replace(OFFSETS, noises=(0.0,), frequencies_hz=(50.0,), kind="harmonics")
WITH_CVT = replace(WITH_HARMONICS, taus_ms=(40,), kind="cvt")


def quick_grid(grid: Grid) -> Grid:
    """Few cases of a grid: every second decay constant, two frequencies, six angles."""
    return replace(
        grid,
        taus_ms=grid.taus_ms[::2],
        frequencies_hz=grid.frequencies_hz[:: max(1, len(grid.frequencies_hz) // 2)][:2],
        angles=6,
    )


class Outcome(NamedTuple):
    """One array each, a place per case.

    stays_ms : from t0 until the error stays within 5 % [ms]; infinite where it never does.
    magnitude_ms : the same of the magnitude alone [ms].
    overshoot : the greatest magnitude over the true one, less 1, from one cycle after t0 on [%].
    tau_ms, frequency_hz : of the case.
    """

    stays_ms: Array
    magnitude_ms: Array
    overshoot: Array
    tau_ms: Array
    frequency_hz: Array


def load_samples(t: Array, frequency_hz: float) -> Array:
    """Voltages and load currents, (n, 6)."""
    angle = 2.0 * np.pi * frequency_hz * t[:, None] + PHASES
    return np.sqrt(2.0) * np.hstack([np.cos(angle), LOAD * np.cos(angle + LOAD_ANGLE)])


def fault_samples(t: Array, t0: float, tau_ms: float, frequency_hz: float, kind: str) -> Array:
    """The samples from t0 on, (n, 6)."""
    samples = load_samples(t, frequency_hz)
    omega = 2.0 * np.pi * frequency_hz

    def current(times: Array | float) -> Array:
        angle = omega * times + FAULT_ANGLE
        wave = np.cos(angle)
        if kind == "harmonics":
            wave = wave + sum(size * np.cos(order * angle) for order, size in HARMONICS)
        return np.sqrt(2.0) * np.asarray(wave)

    at_t0 = LOAD * np.sqrt(2.0) * np.cos(omega * t0 + LOAD_ANGLE)
    samples[:, 3] = current(t) + (at_t0 - current(t0)) * np.exp(-(t - t0) * 1e3 / tau_ms)
    if kind == "cvt":
        swing = np.cos(2.0 * np.pi * CVT_HZ * (t - t0) + omega * t0) * np.exp(-(t - t0) / CVT_TAU_S)
        samples[:, 0] = CVT_VOLTAGE * samples[:, 0] + np.sqrt(2.0) * CVT_SIZE * swing
    return samples


def judge(found: NDArray[np.complex128], truth: NDArray[np.complex128], since: Array) -> list[float]:
    """(stays_ms, magnitude_ms, overshoot %) of one case; ``since`` t0 [s]."""

    def stays(error: Array) -> float:
        outside = np.flatnonzero(~(error <= WITHIN))
        if len(outside) == 0:
            return 0.0
        return np.inf if outside[-1] == len(since) - 1 else 1e3 * float(since[outside[-1] + 1])

    ratio = np.abs(found) / np.abs(truth)
    over = 100.0 * (ratio[since >= 1.0 / NOMINAL_HZ].max() - 1.0)
    return [stays(np.abs(found - truth) / np.abs(truth)), stays(np.abs(ratio - 1.0)), over]


def play(estimator: Estimator, sampling_hz: int, grid: Grid) -> Outcome:
    """Run an estimator over a grid; the load before the fault is run once for each noise and frequency."""
    rows = []
    for noise, frequency_hz in product(grid.noises, grid.frequencies_hz):
        state, done = estimator.state.copy(), 0
        rng = np.random.default_rng([int(1e4 * noise), int(10 * frequency_hz)])
        for k in range(grid.angles):
            # The golden ratio spreads the instants between two samples.
            t0 = BEFORE_S + k / (grid.angles * frequency_hz) + (0.618034 * k % 1.0) / sampling_hz
            first = int(np.ceil(t0 * sampling_hz))
            advance(
                estimator, state, load_samples(np.arange(done, first) / sampling_hz, frequency_hz), noise, rng
            )
            done = first
            t = np.arange(first, first + round(AFTER_S * sampling_hz)) / sampling_hz
            for tau_ms in grid.taus_ms:
                samples = fault_samples(t, t0, tau_ms, frequency_hz, grid.kind)
                phasors = advance(estimator, state.copy(), samples, noise, rng)
                measured = t - estimator.delay_samples / sampling_hz  # the instant that a row refers to
                turning = np.exp(2j * np.pi * (frequency_hz - NOMINAL_HZ) * measured).astype(np.complex128)
                if grid.kind == "cvt":
                    verdict = judge(phasors[:, 0], (CVT_VOLTAGE + 0j) * turning, t - t0)
                else:
                    verdict = judge(phasors[:, 3], np.exp(1j * FAULT_ANGLE) * turning, t - t0)
                rows.append([*verdict, tau_ms, frequency_hz])
    return Outcome(*np.array(rows, dtype=np.float64).T)


def advance(
    estimator: Estimator, state: Array, samples: Array, noise: float, rng: np.random.Generator
) -> NDArray[np.complex128]:
    """The six phasors (n, 6) of noisy samples; the state goes on."""
    noisy = np.ascontiguousarray(samples + noise * np.sqrt(2.0) * rng.normal(size=samples.shape))
    out = np.empty((len(noisy), ROW))
    run_estimator(estimator.step, state, noisy, out)
    return out[:, :12].copy().view(np.complex128)
