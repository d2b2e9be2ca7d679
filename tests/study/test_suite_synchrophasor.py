"""The class tests of synchrophasors: their signals, their judgement, and what they say of our filters."""

from __future__ import annotations

import numpy as np
import pytest

from faultloop.relay.estimators import FREQUENCY, ROCOF, make_estimator, run_estimator
from faultloop.study.suites import run_suite
from faultloop.study.suites.synchrophasor.classes import M, P, class_tests
from faultloop.study.suites.synchrophasor.measure import Errors, errors, outside, step_response, subject
from faultloop.study.suites.synchrophasor.signals import CURRENT, Tone, modulated, ramp, steady, step

WAVES = {
    "steady": steady(60.0, -1.7, 0.8),
    "modulated": modulated(50.0, 4.0, magnitude=0.1, angle=0.1),
    "up": ramp(50.0, 1.0, 1.0, 0.5),
    "down": ramp(50.0, 2.0, -4.0, 0.5),
}


@pytest.mark.parametrize("name", WAVES)
def test_frequency_and_rocof_are_the_derivatives_of_the_angle(name):
    wave = WAVES[name]
    nominal = 60.0 if name == "steady" else 50.0
    t = np.linspace(0.0, 3.0, 1001)
    h = 1e-4
    slope = (wave.angle(t + h) - wave.angle(t - h)) / (4 * np.pi * h)
    np.testing.assert_allclose(wave.frequency(t), nominal + slope, atol=3e-4)
    kinks = np.array([0.5, 1.5, 2.5])
    smooth = np.abs(t[:, None] - kinks).min(axis=1) > 2 * h
    curve = (wave.frequency(t + h) - wave.frequency(t - h)) / (2 * h)
    np.testing.assert_allclose(wave.rocof(t)[smooth], curve[smooth], atol=1e-4)


def test_samples_are_the_phasor_on_its_carrier_in_positive_sequence():
    wave = modulated(50.0, 5.0, magnitude=0.1, angle=0.1)
    t = np.arange(960) / 4800  # one period of it
    samples = wave.samples(t, 50.0)
    np.testing.assert_allclose(samples[:, :3].sum(axis=1), 0.0, atol=1e-12)
    carried = np.sqrt(2) * np.abs(wave.phasor(t)) * np.cos(2 * np.pi * 50 * t + wave.angle(t) - 2 * np.pi / 3)
    np.testing.assert_allclose(samples[:, 1], carried, atol=1e-12)
    np.testing.assert_allclose(
        np.sqrt((samples[:, 3:] ** 2).mean(axis=0)), CURRENT * np.sqrt(1.005), rtol=1e-3
    )


def test_a_harmonic_has_the_phase_sequence_of_its_order():
    t = np.arange(960) / 4800
    for order, sequence in ((2, -1), (3, 0), (4, 1)):
        tone = steady(50.0, tone=Tone(50.0 * order, 0.1, order)).samples(t, 50.0) - steady(50.0).samples(
            t, 50.0
        )
        lag = round(4800 / 50 / order / 3 * sequence)
        np.testing.assert_allclose(tone[96:, 1], np.roll(tone[:, 0], lag)[96:], atol=1e-12)


def test_judgement_of_a_known_response():
    """A phasor that follows 10 ms late and linearly, within 20 ms, and then overshoots by 4 %."""
    t = np.arange(-4800, 4800) / 4800
    progress = np.interp(t, [0.0, 0.02, 0.025, 0.03], [0.0, 1.0, 1.04, 1.0])
    tve = 100 * 0.1 * np.abs(progress - (t >= 0))
    zero = np.zeros_like(t)
    found = Errors(t, tve, zero, np.where(np.abs(t) < 0.0101, 1.0, 0.0), zero.astype(complex))
    judged = step_response(found, 0.0, progress, (1.0, 0.005, 0.4))
    assert judged.tve_s == pytest.approx(0.018, abs=3e-4)  # 1 % is a tenth of the step
    assert judged.fe_s == 0.0
    assert judged.rfe_s == pytest.approx(0.0202, abs=3e-4)
    assert judged.delay_s == pytest.approx(0.01, abs=1e-5)
    assert judged.overshoot == pytest.approx(4.0, abs=1e-6)
    assert outside(np.array([False, True])) == float("inf")


def test_class_p_has_the_magnitude_error_of_its_formula():
    """The triangle passes sinc^2(dF / f0); the standard divides by sin(pi (f0 + 1.625 dF) / (2 f0))."""
    for offset in (-2.0, 0.7, 2.0):
        found = errors(subject("p-class", 50.0), steady(50.0, offset), 0.3)
        expected = np.sinc(offset / 50) ** 2 / np.sin(np.pi * (50 + 1.625 * offset) / 100)
        np.testing.assert_allclose(np.abs(found.phasor), expected, rtol=2e-6)


def test_class_m_stops_what_it_must():
    """A tone at f0 + 25 Hz alone moves the phasor by less than 0.36 %."""
    found = errors(subject("m-class", 50.0), steady(50.0, 25.0), 0.4)
    assert np.abs(found.phasor).max() < 0.0036


@pytest.mark.parametrize("part", ["p-50", "p-60", "m-50", "m-60"])
def test_the_class_filter_holds_every_limit(part):
    (report,) = run_suite("synchrophasor", [part], quick=True)
    assert report.held, [check.what for check in report.checks if not check.held]
    assert len(report.checks) == {"p": 26, "m": 27}[part[0]]
    assert all(np.isfinite(check.value) for check in report.checks)


def test_the_limits_are_missed_by_what_should_miss_them():
    """Class P lets tones pass; class M is too slow for P; a Fourier filter without a delay lags."""

    def missed(method, kind):
        outcomes = class_tests(subject(method, 50.0), kind, True)
        return {(o.row.split()[0], o.quantity) for o in outcomes if not o.value <= o.limit}

    assert missed("p-class", M) == {("out", "TVE"), ("out", "FE")}
    assert {("magnitude", "TVE response"), ("angle", "TVE response")} <= missed("m-class", P)
    assert {("frequency", "TVE"), ("angle", "delay")} <= missed("fourier", P)


def test_frequency_is_held_while_there_is_no_voltage():
    estimator = make_estimator("p-class", 4800, 50.0)
    samples = steady(50.0, 1.0).samples(np.arange(2400) / 4800, 50.0)
    samples[1000:1800] = 0.0
    rows = np.empty((2400, 14))
    run_estimator(estimator.step, estimator.state.copy(), samples, rows)
    np.testing.assert_allclose(rows[300:1000, FREQUENCY], 51.0, atol=1e-9)
    assert np.ptp(rows[1200:1800, FREQUENCY]) == 0.0
    np.testing.assert_allclose(rows[2000:, FREQUENCY], 51.0, atol=1e-9)
    np.testing.assert_allclose(rows[2000:, ROCOF], 0.0, atol=1e-6)


def test_the_delay_is_that_of_the_rows():
    """A step shows half-way `delay_samples` after it."""
    for method in ("p-class", "m-class"):
        one = subject(method, 60.0)
        found = errors(one, step(60.0, 0.4 + 1e-5, magnitude=0.1), 0.8)
        half = found.t[np.argmax(np.abs(found.phasor) > 1.05)]
        assert abs(half - 0.4) <= 1.5 / 4800
