"""Strong tracking unscented filter (Wang, Zhao, Xia, Hao 2010; reference 14 of seed paper 001): `stf` in
sigma points, three transforms a step.  For a linear measurement `mstukf` does the same by one.
"""

from __future__ import annotations

from faultloop.jit import njit
from faultloop.relay.estimators.base import CHANNELS, Estimator
from faultloop.relay.estimators.disturbance import is_sample, noise_variance
from faultloop.relay.estimators.filters.harmonic_model import predict_unscented
from faultloop.relay.estimators.filters.strong_tracking import step_strong_unscented
from faultloop.relay.estimators.harmonic_filters import (
    begin,
    bound_frequency,
    filter_of,
    make_state,
    prepare,
    report,
    seen_of,
    set_fading,
    set_initial,
    set_sigma_points,
    settling_samples,
)


@njit
def stukf_step(state, x, out):
    begin(state, x)
    seen = seen_of(state)
    for c in range(CHANNELS):
        f = filter_of(state, c)
        if prepare(state, f, c):
            if is_sample(x[c]):
                step_strong_unscented(f, seen, x[c], noise_variance(state, c))
            else:
                predict_unscented(f)
            bound_frequency(state, f)
    report(state, out)


def make(
    sampling_hz: int,
    frequency_hz: float,
    *,
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
    """Strong tracking unscented filter.

    Parameters
    ----------
    alpha, beta, kappa : of the sigma points; the paper's section 4.
    others : as those of `stf`.

    Raises InputError as `stf` and `ukf`.
    """
    state = make_state(
        "stukf",
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
    return Estimator("stukf", stukf_step, state, settling_samples(sampling_hz, frequency_hz))
