"""Unscented Kalman filter on a fundamental, odd harmonics and the frequency (the plain filter beside seed
paper 001, whose MSTUKF extends it): `ekf` with sigma points in place of the Jacobian, eq. 22 to 25.
"""

from __future__ import annotations

from faultloop.jit import njit
from faultloop.relay.estimators.base import CHANNELS, Estimator
from faultloop.relay.estimators.disturbance import DETECTION_THRESHOLD, NOISE_FLOOR
from faultloop.relay.estimators.filters.harmonic_model import predict_unscented
from faultloop.relay.estimators.harmonic_filters import (
    begin,
    filter_of,
    make_state,
    prepare,
    report,
    set_initial,
    set_sigma_points,
    settling_samples,
)
from faultloop.relay.estimators.methods.ekf import correct_all, examine


@njit
def ukf_step(state, x, out):
    begin(state, x)
    for c in range(CHANNELS):
        f = filter_of(state, c)
        if prepare(state, f, c):
            predict_unscented(f)
            examine(state, f, c, x[c])
    correct_all(state, x)
    report(state, out)


def make(
    sampling_hz: int,
    frequency_hz: float,
    *,
    harmonics: int = 4,
    measurement_variance: float = NOISE_FLOOR**2,
    process_variance: float | None = None,
    frequency_process_variance: float | None = None,
    initial_variance: float = 9.0,
    frequency_initial_variance: float = 1.0,
    detection_threshold: float = DETECTION_THRESHOLD,
    alpha: float = 1e-3,
    beta: float = 2.0,
    kappa: float = 0.0,
) -> Estimator:
    """Unscented Kalman filter.

    Parameters
    ----------
    alpha, beta, kappa : of the sigma points; the paper's section 4.
    others : as those of `ekf`.

    Raises InputError as `ekf`, and for alpha not above 0, beta below alpha^2 or kappa not above -n.
    """
    state = make_state(
        "ukf",
        sampling_hz,
        frequency_hz,
        harmonics=harmonics,
        measurement_variance=measurement_variance,
        process_variance=process_variance,
        frequency_process_variance=frequency_process_variance,
        detection_threshold=detection_threshold,
    )
    set_initial(state, initial_variance, frequency_initial_variance)
    set_sigma_points(state, alpha, beta, kappa)
    return Estimator("ukf", ukf_step, state, settling_samples(sampling_hz, frequency_hz))
