"""Properties that hold for any input."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from faultloop.relay.estimators import ROW, estimator_methods, make_estimator, run_estimator

each_method = pytest.mark.parametrize("method", estimator_methods())
quick = settings(max_examples=25, deadline=None, derandomize=True)

ESTIMATORS = {method: make_estimator(method, 1200, 50.0) for method in estimator_methods()}
SETTLED = 8 * 24

# Sigma points of an uncertain frequency shrink a sinusoid a little, and a prior weighs a little
# (test_conformance.py says how much).
# After eight cycles the frequency of a strong tracking filter is still on its way from where the start threw
# it; in a channel a hundred times smaller than its neighbour it takes longest.
EXACT = {"kalman-bank": 2e-5, "ukf": 2e-4, "stukf": 1e-3, "mstukf": 2e-4, "stf": 1e-3}

magnitudes = st.lists(st.floats(0.1, 1e4), min_size=6, max_size=6)
angles = st.lists(st.floats(-np.pi, np.pi), min_size=6, max_size=6)


def phasors_of(method, samples):
    estimator = ESTIMATORS[method]
    rows = np.empty((len(samples), ROW))
    run_estimator(estimator.step, estimator.state.copy(), np.ascontiguousarray(samples), rows)
    return rows[:, :12].copy().view(np.complex128)


def wave(phasors, first=0, count=SETTLED + 30):
    turns = np.arange(first, first + count) * 50 / 1200
    return np.sqrt(2) * np.real(phasors * np.exp(2j * np.pi * turns)[:, None])


@each_method
@quick
@given(magnitudes, angles)
def test_any_steady_state_is_exact(method, magnitude, angle):
    truth = np.array(magnitude) * np.exp(1j * np.array(angle))
    found = phasors_of(method, wave(truth))[SETTLED:]
    # A dwarf beside a giant in its group is as exact as the group's noise floor lets it be.
    scale = np.maximum(np.abs(truth), 1e-2 * np.repeat(np.abs(truth).reshape(2, 3).max(axis=1), 3))
    assert np.all(np.abs(found - truth) <= EXACT.get(method, 1e-6) * scale)


@each_method
@quick
@given(angles, st.floats(-np.pi, np.pi))
def test_phase_rotation_turns_the_phasors(method, angle, turn):
    truth = np.exp(1j * np.array(angle))
    found = phasors_of(method, wave(truth))[SETTLED:]
    turned = phasors_of(method, wave(truth * np.exp(1j * turn)))[SETTLED:]
    assert np.abs(turned - found * np.exp(1j * turn)).max() < 2 * EXACT.get(method, 1e-6)


@each_method
@quick
@given(arrays(np.float64, (60, 6), elements=st.floats(-1e3, 1e3)), st.integers(-40, 40))
def test_scaling_by_a_power_of_two_scales_the_bits(method, samples, exponent):
    samples = np.round(samples, 3)  # nothing so small that scaling would round it
    scaled = phasors_of(method, samples * 2.0**exponent) * 2.0**-exponent
    found = phasors_of(method, samples)
    assert np.abs(scaled - found).max() <= 1e-12 * max(1.0, np.abs(found).max())


@each_method
@quick
@given(arrays(np.float64, (60, 6), elements=st.floats(-1e3, 1e3)), st.integers(1, 60))
def test_a_time_shift_turns_the_reference_only(method, samples, shift):
    samples = np.round(samples, 3)
    if method == "taylor-kalman":
        # Spikes among zeros leave its ten states undetermined, and rounding decides what is a disturbance.
        samples = 0.002 * samples + wave(1e3 * np.ones(6), count=60)
    later = phasors_of(method, np.vstack([np.zeros((shift, 6)), samples]))[shift:]
    found = phasors_of(method, samples) * np.exp(-2j * np.pi * 50 / 1200 * shift)
    assert np.abs(later - found).max() <= 1e-7 * max(1.0, np.abs(found).max())


@each_method
@quick
@given(arrays(np.float64, (80, 6), elements=st.floats(-1e99, 1e99)))
def test_no_finite_input_gives_nan(method, samples):
    assert np.isfinite(phasors_of(method, samples)).all()


RECURSIVE = [m for m in ESTIMATORS if ESTIMATORS[m].step.__name__ not in ("fir_step", "centred_step")]


@pytest.mark.parametrize("method", RECURSIVE)
@quick
@given(arrays(np.float64, (80, 6), elements=st.floats(width=64)))
def test_no_input_at_all_gives_nan_in_a_recursive_filter(method, samples):
    """NaN, infinite, or beyond 1e100, whose square would be: a missing sample."""
    assert np.isfinite(phasors_of(method, samples)).all()
