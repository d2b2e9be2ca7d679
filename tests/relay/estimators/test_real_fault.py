"""A recorded fault: B-C on a 110 kV line, with an offset and a saturating current transformer."""

from __future__ import annotations

import comtrade
import numpy as np
import pytest

from faultloop.relay.estimators import ROW, estimator_methods, make_estimator, run_estimator

INCEPTION_S = 0.176
FAULT_OHM = 1.70  # estimated by hand from the record
STEADY_S = np.arange(0.20, 0.23, 0.002)


@pytest.fixture(scope="module")
def record(records):
    folder = records / "b-c-to-abc-110kv"
    found = comtrade.load(
        str(folder / "two_phase_fault.cfg"), str(folder / "two_phase_fault.dat"), encoding="cp1251"
    )
    samples = np.array(found.analog[:6], dtype=np.float64).T.copy()
    return samples, int(found.cfg.sample_rates[0][0])


def bc_impedance(method, record):
    samples, sampling_hz = record
    estimator = make_estimator(method, sampling_hz, 50.0)
    rows = np.empty((len(samples), ROW))
    run_estimator(estimator.step, estimator.state.copy(), samples, rows)
    z = rows[:, :12].copy().view(np.complex128)
    with np.errstate(invalid="ignore", divide="ignore"):  # nothing yet in a filter with a long delay
        return np.abs((z[:, 1] - z[:, 2]) / (z[:, 4] - z[:, 5])), sampling_hz


# Of a pair of samples, and of synchrophasor filters, whose windows are longer than the fault stands still.
OTHERS = {"quarter-cycle", "p-class", "m-class"}


@pytest.mark.parametrize("method", sorted(set(estimator_methods()) - OTHERS))
def test_the_loop_impedance_of_a_recorded_fault(method, record):
    impedance, sampling_hz = bc_impedance(method, record)
    assert np.median(impedance[(STEADY_S * sampling_hz).astype(int)]) == pytest.approx(FAULT_OHM, rel=0.04)


def test_the_recursive_methods_are_there_before_the_window_methods(record):
    """Within 25 % of the final impedance to stay for a cycle: the Kalman filter in less than 12 ms."""
    arrival = {}
    for method in ("adaptive-kalman", "fourier"):
        impedance, sampling_hz = bc_impedance(method, record)
        start = int(INCEPTION_S * sampling_hz)
        off = np.abs(impedance[start : start + sampling_hz // 25] / FAULT_OHM - 1) > 0.25
        arrival[method] = (np.nonzero(off)[0][-1] + 1) / sampling_hz
    assert arrival["adaptive-kalman"] < 0.012
    assert arrival["adaptive-kalman"] < arrival["fourier"] - 0.004
