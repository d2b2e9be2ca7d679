"""Modified strong tracking unscented filter (Wang and others 2017, seed paper 001, eq. 20 to 39).

A fundamental, odd harmonics and the frequency, six times (harmonic_filters.py), each channel with a fading
factor of its own; one sigma-point transform a step.  Where the residuals ask for it the covariance grows, in
either of two ways (filters/strong_tracking.py):

- ``disturbance``: by what a disturbance is expected to change, and the frequency is not touched;
- ``covariance``: as a whole, eq. 26.

The paper says the first in words and the second in symbols.  Its figures for MSTUKF are met by the first.
"""

from __future__ import annotations

from faultloop.jit import njit
from faultloop.relay.estimators.base import CHANNELS, Estimator
from faultloop.relay.estimators.disturbance import is_sample, noise_variance
from faultloop.relay.estimators.filters.harmonic_model import predict_unscented
from faultloop.relay.estimators.filters.strong_tracking import step_disturbed, step_modified
from faultloop.relay.estimators.harmonic_filters import (
    FUNDAMENTAL_CHANGE,
    HARMONIC_CHANGE,
    begin,
    bound_frequency,
    filter_of,
    make_state,
    prepare,
    report,
    set_fading,
    set_initial,
    set_sigma_points,
    settling_samples,
)
from faultloop.relay.estimators.parameters import choice, number


@njit
def mstukf_step(state, x, out):
    begin(state, x)
    for c in range(CHANNELS):
        f = filter_of(state, c)
        if prepare(state, f, c):
            if is_sample(x[c]):
                step_disturbed(f, x[c], noise_variance(state, c))
            else:
                predict_unscented(f)
            bound_frequency(state, f)
    report(state, out)


@njit
def fading_covariance_step(state, x, out):
    begin(state, x)
    for c in range(CHANNELS):
        f = filter_of(state, c)
        if prepare(state, f, c):
            if is_sample(x[c]):
                step_modified(f, x[c], noise_variance(state, c))
            else:
                predict_unscented(f)
            bound_frequency(state, f)
    report(state, out)


STEPS = {"disturbance": mstukf_step, "covariance": fading_covariance_step}


def make(
    sampling_hz: int,
    frequency_hz: float,
    *,
    fading: str = "disturbance",
    fundamental_change: float = 0.3,
    harmonic_change: float = 0.03,
    harmonics: int = 4,
    measurement_variance: float = 1e-3,
    process_variance: float | None = None,
    frequency_process_variance: float | None = None,
    initial_variance: float = 1000.0,
    frequency_initial_variance: float = 1.0,
    softening_factor: float = 8.0,
    forgetting_factor: float = 0.95,
    frequency_share: float = 0.0,
    alpha: float = 1e-3,
    beta: float = 2.0,
    kappa: float = 0.0,
) -> Estimator:
    """Modified strong tracking unscented filter.

    Parameters
    ----------
    fading : ``disturbance`` or ``covariance`` (eq. 26).
    fundamental_change, harmonic_change : variance that a disturbance adds to each quadrature of the
        fundamental, and of each harmonic, over the squared peak; for ``disturbance``.
    alpha, beta, kappa : of the sigma points; the paper's section 4.
    others : as those of `stf`.

    Raises InputError as `stf` and `ukf`.
    """
    step = STEPS[choice("fading", fading, tuple(STEPS))]
    state = make_state(
        "mstukf",
        sampling_hz,
        frequency_hz,
        harmonics=harmonics,
        measurement_variance=measurement_variance,
        process_variance=process_variance,
        frequency_process_variance=frequency_process_variance,
    )
    set_initial(state, initial_variance, frequency_initial_variance)
    set_fading(state, softening_factor, forgetting_factor, frequency_share)
    set_sigma_points(state, alpha, beta, kappa)
    state[FUNDAMENTAL_CHANGE] = number("fundamental_change", fundamental_change, above=0.0)
    state[HARMONIC_CHANGE] = number("harmonic_change", harmonic_change, above=0.0)
    return Estimator("mstukf", step, state, settling_samples(sampling_hz, frequency_hz))
