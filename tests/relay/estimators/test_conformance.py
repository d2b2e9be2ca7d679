"""One test of the Estimator role, over every registered method."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from faultloop.errors import InputError
from faultloop.relay.estimators import (
    CHANNELS,
    FREQUENCY,
    ROW,
    Estimator,
    estimator_methods,
    estimator_parameters,
    is_compiled,
    make_estimator,
    register,
    run_estimator,
)
from faultloop.relay.estimators.fir import fir_step

RATES = [(4800, 50.0), (4800, 60.0), (960, 60.0), (4000, 60.0), (1200, 50.0)]
PHASORS = np.array([63.5e3, 63.5e3j, -40e3 - 10e3j, 812 * np.exp(-1.2j), 3.7j, 12e3 + 5e3j])

# How near a steady sinusoid each comes in the end, where that is not 1e-6: the mean of a sinusoid over sigma
# points of an uncertain frequency is smaller than the sinusoid, by P_w dt^2 / 2 of it in every sample; the
# prior of kalman-bank, of two peaks, still weighs 1e-5 when its frequency is first measured.
STEADY = {"ukf": 2e-4, "stukf": 2e-4, "mstukf": 2e-4, "kalman-bank": 2e-5}
# And three times the settling time after a step: a fading covariance moves the frequency of a voltage
# that collapses to a tenth, and so small a voltage brings it back slowly.
AFTER_A_STEP = STEADY | {"stf": 1e-3, "stukf": 1e-3}

each_method = pytest.mark.parametrize("method", estimator_methods())
each_rate = pytest.mark.parametrize(("sampling_hz", "frequency_hz"), RATES, ids=lambda v: f"{v:g}")


def sinusoids(phasors, count, sampling_hz, frequency_hz, first=0):
    turns = np.arange(first, first + count) * frequency_hz / sampling_hz
    return np.ascontiguousarray(np.sqrt(2) * np.real(phasors * np.exp(2j * np.pi * turns)[:, None]))


def run(estimator: Estimator, samples, state=None):
    """Complex phasors (n, 6) and the state after."""
    state = estimator.state.copy() if state is None else state
    rows = np.full((len(samples), ROW), 7.0)
    run_estimator(estimator.step, state, samples, rows)
    known = np.isfinite(rows[:, FREQUENCY:])
    assert (known[:, 0] == known[:, 1]).all()
    assert (np.diff(known[:, 0].astype(int)) >= 0).all(), "known once, known for ever"
    return rows[:, : 2 * CHANNELS].copy().view(np.complex128), state


def close(found, expected, relative=1e-6):
    """Within ``relative`` of each channel's magnitude."""
    return np.all(np.abs(found - expected) <= relative * np.abs(expected))


@each_method
@each_rate
def test_a_pure_sinusoid_is_exact_against_the_reference(method, sampling_hz, frequency_hz):
    estimator = make_estimator(method, sampling_hz, frequency_hz)
    settle = estimator.settling_samples
    found, _ = run(estimator, sinusoids(PHASORS, 7 * settle + 150, sampling_hz, frequency_hz))
    exact = settle if estimator.step is fir_step else 7 * settle
    assert close(found[settle - 1 :], PHASORS, 1e-3)
    assert close(found[exact - 1 :], PHASORS, STEADY.get(method, 1e-6))


@each_method
def test_the_frequency_is_unknown_before_it_is_measured(method):
    """NaN on a dead line and while settling, then within 10 mHz; no 50 Hz that nobody measured."""
    estimator = make_estimator(method, 4800, 50.0)
    dead, settle = 500, estimator.settling_samples
    samples = np.zeros((dead + 3 * settle, CHANNELS))
    balanced = np.exp(-2j * np.pi / 3 * np.arange(6))
    samples[dead:] = sinusoids(balanced, 3 * settle, 4800, 50.8)
    rows = np.empty((len(samples), ROW))
    run_estimator(estimator.step, estimator.state.copy(), samples, rows)
    found = rows[:, FREQUENCY]
    assert np.isnan(found[: dead + min(settle, 20)]).all()
    if np.isfinite(found[-1]):
        assert np.isfinite(found[dead + 2 * settle :]).all()
        np.testing.assert_allclose(found[np.isfinite(found)], 50.8, atol=0.15)
        assert abs(found[-1] - 50.8) < 0.02


@each_method
def test_a_step_change_is_forgotten(method):
    """Ten times the current, a tenth of the voltage, at an odd moment."""
    estimator = make_estimator(method, 4800, 50.0)
    settle = estimator.settling_samples
    after = PHASORS * np.array([0.1, 0.9, 1, 10, 10, 1])
    before = sinusoids(PHASORS, settle + 37, 4800, 50.0)
    samples = np.vstack([before, sinusoids(after, 3 * settle + 20, 4800, 50.0, first=len(before))])
    found, _ = run(estimator, samples)
    assert close(found[len(before) + settle :], after, 1e-3)
    assert close(found[len(before) + 3 * settle :], after, AFTER_A_STEP.get(method, 1e-6))


@each_method
def test_scaling_scales(method):
    estimator = make_estimator(method, 1200, 50.0)
    rng = np.random.default_rng(3)
    samples = sinusoids(PHASORS, 120, 1200, 50.0)
    samples[50:] *= np.array([0.2, 1, 1, 15, 1, 1])
    samples += rng.normal(scale=0.01, size=samples.shape) * np.abs(PHASORS)
    found, _ = run(estimator, samples)
    scaled, _ = run(estimator, samples * 2.0**-9)  # a power of two: no rounding of the input
    np.testing.assert_allclose(scaled * 2.0**9, found, rtol=1e-9, atol=1e-9)


@each_method
def test_a_later_start_turns_the_reference_only(method):
    """The same waveform s samples later gives the same phasors, turned by s samples of reference."""
    estimator = make_estimator(method, 4000, 60.0)
    samples = sinusoids(PHASORS, 150, 4000, 60.0)
    samples[70:] *= 1.7
    shift = 23
    found, _ = run(estimator, samples)
    later, _ = run(estimator, np.vstack([np.zeros((shift, CHANNELS)), samples]))
    turned = found * np.exp(-2j * np.pi * 60 / 4000 * shift)
    assert np.abs(later[shift:] - turned).max() < 1e-9 * np.abs(turned).max()


@each_method
def test_channels_do_not_leak(method):
    """In the steady state, what one channel carries does not show in another."""
    estimator = make_estimator(method, 1200, 50.0)
    settle = 7 * estimator.settling_samples
    base = sinusoids(PHASORS, settle + 30, 1200, 50.0)
    found, _ = run(estimator, base)
    for c in range(CHANNELS):
        other = base.copy()
        other[:, c] = sinusoids(np.array([2.0 - 1j]), len(base), 1200, 50.0)[:, 0]
        changed, _ = run(estimator, other)
        untouched = np.arange(CHANNELS) != c
        assert close(changed[settle:, untouched], found[settle:, untouched], STEADY.get(method, 1e-6))
        assert close(changed[settle:, c], 2.0 - 1j, STEADY.get(method, 1e-6))


@each_method
def test_a_copied_state_replays_the_same_bits(method):
    estimator = make_estimator(method, 4800, 60.0)
    rng = np.random.default_rng(11)
    samples = sinusoids(PHASORS, 400, 4800, 60.0) * np.linspace(1, 2, 400)[:, None]
    samples += rng.normal(size=samples.shape)
    whole, _ = run(estimator, samples)
    first, state = run(estimator, samples[:173])
    saved = state.copy()
    once, end = run(estimator, samples[173:], state)
    again, end_again = run(estimator, samples[173:], saved)
    assert np.array_equal(np.vstack([first, once]), whole)
    assert np.array_equal(once, again)
    assert np.array_equal(end, end_again, equal_nan=True)


@each_method
def test_python_and_compiled_steps_agree(method):
    estimator = make_estimator(method, 1200, 60.0)
    assert is_compiled(estimator.step)
    rng = np.random.default_rng(5)
    samples = sinusoids(PHASORS, 90, 1200, 60.0)
    samples[45:] *= 3.0
    samples += rng.normal(size=samples.shape)
    compiled, _ = run(estimator, samples)
    plain = Estimator(method, estimator.step.py_func, estimator.state, estimator.settling_samples)
    assert not is_compiled(plain.step)
    found, _ = run(plain, samples)
    np.testing.assert_allclose(found, compiled, rtol=1e-11, atol=1e-9)


@each_method
def test_one_bad_sample_is_forgotten(method):
    """A missing (NaN) or infinite sample must not stay in the state for ever."""
    estimator = make_estimator(method, 1200, 50.0)
    settle = estimator.settling_samples
    samples = sinusoids(PHASORS, 9 * settle + 60, 1200, 50.0)
    samples[settle + 5, 1] = np.nan
    samples[settle + 9, 4] = np.inf
    found, _ = run(estimator, samples)
    assert close(found[2 * settle + 10 :], PHASORS, 1e-3)
    assert close(found[9 * settle + 10 :], PHASORS, STEADY.get(method, 1e-6))


@each_method
def test_too_few_samples_per_cycle_are_refused(method):
    with pytest.raises(InputError, match="sampling_hz"):
        make_estimator(method, 90, 50.0)


def test_unknown_names_are_refused_with_the_nearest():
    with pytest.raises(InputError, match="did you mean 'fourier'"):
        make_estimator("furier", 4800, 50.0)
    with pytest.raises(InputError, match="window_cycles: 'fourier' has no such parameter"):
        make_estimator("fourier", 4800, 50.0, window_cycles=2)
    with pytest.raises(InputError, match=r"sampling_hz: 4800\.5 should be a whole number"):
        make_estimator("fourier", 4800.5, 50.0)  # pyright: ignore[reportArgumentType]
    with pytest.raises(InputError, match="frequency_hz"):
        make_estimator("fourier", 4800, -50.0)


def test_a_user_adds_a_plain_python_estimator():
    def step(state, x, out):
        state[0] += 1
        out[:] = np.nan
        out[:12:2] = x
        out[1:12:2] = state[0]

    def make(sampling_hz, frequency_hz, *, gain=1.0):
        return Estimator("mine", step, np.zeros(1), 1)

    register("mine", make)
    assert "mine" in estimator_methods()
    assert estimator_parameters("mine") == {"gain": 1.0}
    found, _ = run(make_estimator("mine", 100, 50.0, gain=2.0), np.ones((3, 6)))
    assert np.array_equal(found[:, 0], 1 + 1j * np.array([1, 2, 3]))


def test_a_step_of_the_wrong_shape_is_refused():
    import numba

    @numba.njit
    def returns(state, x, out):
        return x[0]

    with pytest.raises(InputError, match="return nothing"):
        is_compiled(returns)


def test_arrays_of_another_kind_are_refused():
    estimator = make_estimator("fourier", 1200, 50.0)
    state, rows = estimator.state.copy(), np.empty((5, ROW))
    for samples in (np.ones((5, 6), np.float32), np.ones((6, 5)).T, np.ones((4, 6)), np.ones(6)):
        with pytest.raises(TypeError, match="samples"):
            run_estimator(estimator.step, state, samples, rows)


def test_the_reference_does_not_drift():
    """Ten million samples later the same phasor comes out."""
    estimator = make_estimator("fourier", 4000, 60.0)
    state = estimator.state.copy()
    start = 10_000_000
    state[0] = start
    samples = sinusoids(PHASORS, 100, 4000, 60.0, first=start % 200)  # 200 samples are three whole cycles
    found, _ = run(estimator, samples, state)
    assert close(found[estimator.settling_samples :], PHASORS, 1e-12)


COUNT_COMPILATIONS = """
import numpy as np
from faultloop.relay.estimators import base, make_estimator, estimator_methods
for method in estimator_methods():
    estimator = make_estimator(method, 1200, 50.0)
    base.run_estimator(estimator.step, estimator.state.copy(), np.ones((9, 6)), np.empty((9, 14)))
    assert not estimator.step.stats.cache_misses, (method, estimator.step.stats)
assert not base.run_block.stats.cache_misses
assert len(base.run_block.signatures) == 1
print("warm")
"""


def test_a_second_process_compiles_nothing():
    """One caller for all methods, and every kernel comes from the file cache."""
    for method in estimator_methods():
        is_compiled(make_estimator(method, 1200, 50.0).step)
    done = subprocess.run(
        [sys.executable, "-c", COUNT_COMPILATIONS], capture_output=True, text=True, check=False
    )
    assert done.stdout == "warm\n", done.stderr
