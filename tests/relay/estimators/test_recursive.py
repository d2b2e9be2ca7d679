"""The recursive estimators against their closed forms, and the detection of a disturbance."""

from __future__ import annotations

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter

from faultloop.errors import InputError
from faultloop.relay.estimators import ROW, make_estimator, run_estimator
from faultloop.relay.estimators import disturbance as shared
from faultloop.relay.estimators.methods import adaptive_kalman

ANGLES = np.array([0.3, -1.8, 2.4, -0.4, -2.5, 1.7])
VOLTS_AMPERES = np.array([1.0, 1.0, 1.0, 0.01, 0.01, 0.01])


def waveform(count, sampling_hz, frequency_hz=50.0, noise=0.0, seed=0):
    """Peak 1 V and 0.01 A, noise over the peak, (count, 6)."""
    turns = np.arange(count)[:, None] * frequency_hz / sampling_hz
    rng = np.random.default_rng(seed)
    wave = np.cos(2 * np.pi * turns + ANGLES) + noise * rng.normal(size=(count, 6))
    return np.ascontiguousarray(wave * VOLTS_AMPERES)


def run(estimator, samples, state=None):
    """Complex peak phasors (n, 6), and the state after every sample (n, k)."""
    state = estimator.state.copy() if state is None else state
    rows = np.empty((len(samples), ROW))
    states = np.empty((len(samples), len(state)))
    for n in range(len(samples)):
        run_estimator(estimator.step, state, samples[n : n + 1], rows[n : n + 1])
        states[n] = state
    return np.sqrt(2) * rows[:, :12].copy().view(np.complex128), states


@pytest.mark.parametrize("harmonics", [1, 3])
@pytest.mark.parametrize("forgetting", [1.0, 0.95])
def test_rls_is_batch_least_squares_from_sample_2n_plus_1(harmonics, forgetting):
    """Eq. 1 of the paper, with its columns: the offset's initial value, and no square roots."""
    count, fs, tau = 60, 1200, 0.03
    samples = waveform(count, fs, noise=0.05)
    samples += 0.7 * np.exp(-np.arange(count)[:, None] / (fs * tau)) * VOLTS_AMPERES
    estimator = make_estimator(
        "rls",
        fs,
        50.0,
        harmonics=harmonics,
        forgetting_factor=forgetting,
        time_constant_ms=1e3 * tau,
        initial_covariance=1e16,
        detection_threshold=3e4,  # only the first sample is a disturbance
    )
    found, states = run(estimator, samples)
    assert states[-1, shared.RENEWALS] == 1
    k = np.arange(count)
    angle = 2 * np.pi * 50 * k / fs
    columns = [np.exp(-k / (fs * tau))]
    for j in range(1, harmonics + 1):
        columns += [np.cos(j * angle), -np.sin(j * angle)]
    model = np.column_stack(columns)
    for n in range(2 * harmonics + 1, count + 1):
        weight = forgetting ** (0.5 * (n - 1 - k[:n]))[:, None]
        batch = np.linalg.lstsq(weight * model[:n], weight * samples[:n], rcond=None)[0]
        expected = batch[1] + 1j * batch[2]
        np.testing.assert_allclose(found[n - 1], expected, rtol=0, atol=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize("offset", ["decaying", "initial-value"])
def test_kalman_with_a_known_variance_is_filterpys(offset):
    count, fs, tau, variance = 150, 1200, 0.04, np.array([1e-3, 1e-7])
    decay = np.exp(-1 / (fs * tau))
    samples = waveform(count, fs, noise=0.03)
    samples[:, 3:] += 0.008 * np.exp(-np.arange(count)[:, None] / (fs * 0.06))
    estimator = make_estimator("adaptive-kalman", fs, 50.0, offset=offset, memory_cycles=1.5, wave_noise=0.0)
    state = estimator.state.copy()
    state[shared.VARIANCE_GAIN] = 0.0
    state[shared.VARIANCE : shared.VARIANCE + 6] = np.repeat(variance, 3)
    found, states = run(estimator, samples, state)
    assert states[-1, shared.RENEWALS] == 1  # at the first sample
    process = 2.0 / (1.5 * fs / 50) ** 2
    for c in range(6):
        offsets = c // 3
        peer = KalmanFilter(dim_x=2 + offsets, dim_z=1)
        spread = 9.0 if offsets else 1.0
        peer.P = spread * np.square(samples[0, 3 * offsets : 3 * offsets + 3]).max() * np.eye(2 + offsets)
        peer.R[:] = variance[offsets]
        transition = decay if offset == "decaying" else 1.0
        peer.F = np.diag([1.0, 1.0, transition][: 2 + offsets])
        for n in range(count):
            if n:
                noise = [process * variance[offsets]] * 2
                if offsets:
                    noise.append((transition * peer.x[2, 0] * (1 - decay)) ** 2)
                peer.predict(Q=np.diag(noise))
            angle = 2 * np.pi * 50 * n / fs
            row = [np.cos(angle), -np.sin(angle), 1.0 if offset == "decaying" else decay**n]
            peer.update(samples[n, c], H=np.array([row[: 2 + offsets]]))
            expected = peer.x[0, 0] + 1j * peer.x[1, 0]
            assert abs(found[n, c] - expected) < 1e-9 * VOLTS_AMPERES[c]


def test_the_two_forms_of_the_offset_are_one_filter():
    """Zhang and Chen's eq. 3, 4 and eq. 11, 12 are one filter in two coordinates, renewals included."""
    samples = waveform(700, 4800, noise=0.01)
    n = np.arange(350)
    samples[350:, 3] = 0.2 * (np.cos(0.0654498 * (n + 350)) - np.cos(22.9) * np.exp(-n / 150))
    a, _ = run(make_estimator("adaptive-kalman", 4800, 50.0, offset="decaying"), samples)
    b, _ = run(make_estimator("adaptive-kalman", 4800, 50.0, offset="initial-value"), samples)
    assert np.abs(a - b).max() < 1e-9


def test_the_variance_of_eq_10_is_unbiased():
    """White noise of a known variance, and a filter whose model is true (a long memory)."""
    fs, count, noise = 1200, 20_000, 0.04
    estimator = make_estimator("adaptive-kalman", fs, 50.0, memory_cycles=100.0)
    _, states = run(estimator, waveform(count, fs, noise=noise, seed=4))
    steady = states[2000:]
    innovation = steady[:, adaptive_kalman.INNOVATION : adaptive_kalman.INNOVATION + 6] / VOLTS_AMPERES
    predicted = steady[:, adaptive_kalman.PREDICTED : adaptive_kalman.PREDICTED + 6] / VOLTS_AMPERES**2
    averaged = steady[:, shared.VARIANCE : shared.VARIANCE + 6] / VOLTS_AMPERES**2
    # 108000 samples of standard deviation sqrt(2) R: 0.43 % of R
    assert np.mean(innovation**2 - predicted) == pytest.approx(noise**2, rel=0.015)
    assert averaged.mean() == pytest.approx(noise**2, rel=0.025)
    assert averaged.mean(axis=0) == pytest.approx(np.full(6, noise**2), rel=0.06)


@pytest.mark.parametrize("method", ["rls", "adaptive-kalman"])
@pytest.mark.parametrize("sampling_hz", [960, 4800])
@pytest.mark.parametrize("frequency_hz", [49.0, 50.0, 51.0])
def test_no_disturbance_in_a_noisy_steady_state(method, sampling_hz, frequency_hz):
    estimator = make_estimator(method, sampling_hz, 50.0)
    samples = waveform(20_000, sampling_hz, frequency_hz, noise=0.01, seed=8)
    turns = np.arange(20_000)[:, None] * frequency_hz / sampling_hz
    samples += 0.03 * np.cos(2 * np.pi * 5 * turns + ANGLES) * VOLTS_AMPERES
    state = estimator.state.copy()
    rows = np.empty((len(samples), ROW))
    run_estimator(estimator.step, state, samples[:sampling_hz], rows[:sampling_hz])
    before = state[shared.RENEWALS]
    run_estimator(estimator.step, state, samples[sampling_hz:], rows[sampling_hz:])
    assert state[shared.RENEWALS] == before


@pytest.mark.parametrize("method", ["rls", "adaptive-kalman"])
def test_an_inception_is_detected_within_samples(method):
    """One phase to five times its current and 60 % of its voltage, 24 inception angles, 1 % noise."""
    fs, before = 4800, 480
    estimator = make_estimator(method, fs, 50.0)
    delays = []
    for start in range(before, before + 96, 4):
        samples = waveform(start + 60, fs, noise=0.01, seed=start)
        after = np.arange(60)
        angle = 2 * np.pi * 50 * (start + after) / fs + ANGLES[3]
        fault = 0.05 * (np.cos(angle) - np.cos(angle[0]) * np.exp(-after / (fs * 0.04)))
        samples[start:, 3] = (
            fault + samples[start - 1, 3] + 1e-4 * np.random.default_rng(start).normal(size=60)
        )
        samples[start:, 0] *= 0.6
        _, states = run(estimator, samples)
        renewals = states[:, shared.RENEWALS]
        delays.append(int(np.argmax(renewals > renewals[start - 1])) - start)
    assert min(delays) >= 0
    assert max(delays) <= 12  # 2.5 ms
    assert np.median(delays) <= 4


def test_impossible_parameters_are_refused():
    wrong = [
        ("rls", {"harmonics": 0}, "harmonics: 0 should be at least 1"),
        ("rls", {"harmonics": 13}, "sampling_hz"),
        ("rls", {"forgetting_factor": 1.01}, "forgetting_factor"),
        ("rls", {"time_constant_ms": "40"}, "not a finite number"),
        ("rls", {"noise_floor": 0.0}, "noise_floor: 0 should be above 0"),
        ("adaptive-kalman", {"noise_floor": 0.1, "detection_threshold": 100.0}, "detection_threshold"),
        ("adaptive-kalman", {"offset": "decayin"}, "did you mean 'decaying'"),
        ("adaptive-kalman", {"memory_cycles": True}, "memory_cycles"),
        ("least-squares", {"window_cycles": 0.1}, "shorter than the 4 unknowns"),
        ("least-squares", {"window_cycles": 0.25, "offset_terms": 3, "harmonics": 4}, "unknowns"),
        ("mimic-fourier", {"time_constant_ms": -40.0}, "should be at least 1"),
    ]
    for method, parameters, message in wrong:
        with pytest.raises(InputError, match=message):
            make_estimator(method, 1200, 50.0, **parameters)


def test_what_is_left_of_a_voltage_before_is_not_taken_for_a_frequency():
    """A three-phase fault behind a source of 15 times the line: the voltages fall to 7 %, with offsets.
    Before: a frequency of 0.4 Hz beside the true one, and phasors 2.5 degrees ahead for cycles."""
    fs, fault, tau = 4800, 600, 0.012
    k = np.arange(3 * fault)
    samples = waveform(len(k), fs)
    after = k[fault:, None] - fault
    turns = k[fault:, None] / 96
    samples[fault:, :3] = 0.07 * np.cos(2 * np.pi * turns + ANGLES[:3] - 0.7)
    samples[fault:, :3] += 0.035 * np.array([0.1, -1.0, 0.9]) * np.exp(-after / (fs * tau))
    samples[fault:, 3:] = 0.03 * np.cos(2 * np.pi * turns + ANGLES[3:] - 1.4)
    found, _ = run(make_estimator("kalman-bank", fs, 50.0), samples)
    angle = np.degrees(np.angle(found * np.exp(-1j * (ANGLES - np.repeat([0.7, 1.4], 3)))))
    assert np.abs(angle[fault + 192 :, 3:]).max() < 0.5
