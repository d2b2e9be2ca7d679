"""Strong tracking filter (Zhou, Xi, Zhang 1991; seed paper 001, eq. 4 to 12): the extended filter on a
fundamental, odd harmonics and the frequency, whose covariance fades as far as the residuals ask for.

The filter is `step_strong` (filters/strong_tracking.py), six times (harmonic_filters.py), each channel with a
factor of its own.  R is fixed, as in the paper: what the factor reads is the residuals over it.
"""

from __future__ import annotations

from faultloop.jit import njit
from faultloop.relay.estimators.base import CHANNELS, Estimator
from faultloop.relay.estimators.disturbance import is_sample, noise_variance
from faultloop.relay.estimators.filters.harmonic_model import predict_extended
from faultloop.relay.estimators.filters.strong_tracking import step_strong
from faultloop.relay.estimators.harmonic_filters import (
    begin,
    bound_frequency,
    filter_of,
    make_state,
    prepare,
    report,
    set_fading,
    set_initial,
    settling_samples,
)


@njit
def stf_step(state, x, out):
    begin(state, x)
    for c in range(CHANNELS):
        f = filter_of(state, c)
        if prepare(state, f, c):
            if is_sample(x[c]):
                step_strong(f, x[c], noise_variance(state, c))
            else:
                predict_extended(f)
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
) -> Estimator:
    """Strong tracking filter.

    Parameters
    ----------
    harmonics : odd harmonics in the model, the fundamental counted; 4 are nine states.
    measurement_variance : R, over the squared peak of the voltages or currents.
    process_variance : Q of each quadrature per sample, over the squared peak; not given, half a cycle's
        memory (the paper: 1e-8, which is three cycles at its 128 samples).
    frequency_process_variance : Q of the frequency per sample [(rad/s)^2]; not given, two cycles' memory.
    initial_variance : P0 of each quadrature, over the squared peak.
    frequency_initial_variance : P0 of the frequency, and the most it can grow to [(rad/s)^2].
    softening_factor : beta of eq. 10: residuals up to sqrt(beta R) count as noise.
    forgetting_factor : rho of eq. 12.
    frequency_share : alpha of eq. 9 for the frequency.  The paper's 1 lets every step of the amplitude throw
        the frequency off, and it returns slowly where the amplitude is small.

    Raises InputError for a variance that is not positive, or below 4 samples per cycle for each harmonic.
    """
    state = make_state(
        "stf",
        sampling_hz,
        frequency_hz,
        harmonics=harmonics,
        measurement_variance=measurement_variance,
        process_variance=process_variance,
        frequency_process_variance=frequency_process_variance,
    )
    set_initial(state, initial_variance, frequency_initial_variance)
    set_fading(state, softening_factor, forgetting_factor, frequency_share)
    return Estimator("stf", stf_step, state, settling_samples(sampling_hz, frequency_hz))
