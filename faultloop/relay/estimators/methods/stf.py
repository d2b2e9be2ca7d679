"""Strong tracking filter: the extended filter on a fundamental, odd harmonics and the frequency, whose
covariance fades as far as the residuals ask for.

Zhou Donghua, Xi Yugeng, Zhang Zhongjun, "A suboptimal multiple fading extended Kalman filter", Acta
Automatica Sinica 17 (6), 1991; as in Wang Yi, Liu Heng and others, "Transient voltage disturbance detection
based on modified strong tracking UKF", Power System Protection and Control, 2017, eq. 4 to 12 (seed paper
001).

The filter is `step_strong` (filters/strong_tracking.py), six times (harmonic_filters.py), each channel with a
factor of its own.

Departures of the default form, ``bounded``, for the paper's filter runs away under a steady residual that its
model does not have.  With 10 % of the 25th harmonic the fundamental was found at 74 times its size: V stays
above beta R, lambda multiplies P in every sample, and P grows without limit wherever the samples say nothing.

- R is followed (eq. 10 of seed paper 000, disturbance.py) and not fixed: what persists becomes noise.
- No factor widens a variance beyond the initial one, which is the squared peak and not 1000 times that.
- The estimates are bounded (harmonic_filters.py).

``as-written`` has none of the three.  With the paper's numbers (section 4: softening_factor 1.8,
frequency_share 1, process_variance and frequency_process_variance 1e-8, initial_variance and
frequency_initial_variance 1000) it is the paper's filter, but for R, P0 and Q being in squared peaks: that
is its per unit.
"""

from __future__ import annotations

from faultloop.jit import njit
from faultloop.relay.estimators.base import CHANNELS, Array, Estimator
from faultloop.relay.estimators.disturbance import noise_variance
from faultloop.relay.estimators.filters.strong_tracking import step_strong
from faultloop.relay.estimators.harmonic_filters import (
    begin,
    filter_of,
    follow,
    is_due,
    make_state,
    report,
    set_as_written,
    set_fading,
    set_initial,
    settling_samples,
)
from faultloop.relay.estimators.parameters import choice

FORMS = ("bounded", "as-written")


@njit(heap=True)
def stf_step(state: Array, x: Array, out: Array) -> None:
    begin(state, x)
    for c in range(CHANNELS):
        f = filter_of(state, c)
        if is_due(state, f, c, x[c]):
            step_strong(f, x[c], noise_variance(state, c))
            follow(state, f, c)
    report(state, out)


def make(
    sampling_hz: int,
    frequency_hz: float,
    *,
    harmonics: int = 4,
    measurement_variance: float = 1e-3,
    process_variance: float | None = None,
    frequency_process_variance: float | None = None,
    initial_variance: float = 1.0,
    frequency_initial_variance: float = 1.0,
    softening_factor: float = 8.0,
    forgetting_factor: float = 0.95,
    frequency_share: float = 0.0,
    form: str = "bounded",
) -> Estimator:
    """Strong tracking filter.

    Parameters
    ----------
    harmonics : odd harmonics in the model, the fundamental counted; 4 are nine states.
    measurement_variance : least R, over the squared peak of the voltages or currents.
    process_variance : Q of each quadrature per sample, over the squared peak; not given, half a cycle's
        memory (the paper: 1e-8, which is three cycles at its 128 samples).
    frequency_process_variance : Q of the frequency per sample [(rad/s)^2]; not given, two cycles' memory.
    initial_variance : P0 of each quadrature, and the most that fading makes of it, over the squared peak.
    frequency_initial_variance : P0 of the frequency, and the most it can grow to [(rad/s)^2].
    softening_factor : beta of eq. 10: residuals up to sqrt(beta R) count as noise.
    forgetting_factor : rho of eq. 12.
    frequency_share : alpha of eq. 9 for the frequency.  The paper's 1 lets every step of the amplitude throw
        the frequency off, and it returns slowly where the amplitude is small.
    form : ``bounded``, with R followed and all estimates bounded; or ``as-written``, R fixed and no bounds.

    Raises InputError for a variance that is not positive, or below 4 samples per cycle for each harmonic.
    """
    state = make_state(
        sampling_hz,
        frequency_hz,
        harmonics=harmonics,
        measurement_variance=measurement_variance,
        process_variance=process_variance,
        frequency_process_variance=frequency_process_variance,
    )
    set_initial(state, initial_variance, frequency_initial_variance)
    set_fading(state, softening_factor, forgetting_factor, frequency_share)
    if choice("form", form, FORMS) == "as-written":
        set_as_written(state)
    return Estimator("stf", stf_step, state, settling_samples(sampling_hz, frequency_hz))
