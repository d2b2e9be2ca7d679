"""Extended Kalman filter on a fundamental, odd harmonics and the frequency (the plain filter beside seed
paper 001, whose STF extends it).

The model is the paper's (filters/harmonic_model.py), six times (harmonic_filters.py).  Departures, for a
relay's filter runs for ever: the variance of the noise is followed and the covariance renewed at a detected
disturbance (disturbance.py); the paper's plain filters have neither, and take a tenth of a second for a sag.
"""

from __future__ import annotations

from faultloop.jit import njit
from faultloop.relay.estimators.base import CHANNELS, Array, Estimator
from faultloop.relay.estimators.disturbance import (
    DETECTION_THRESHOLD,
    NOISE_FLOOR,
    compare,
    follow_variance,
    is_disturbed,
    is_sample,
    noise_variance,
)
from faultloop.relay.estimators.filters.harmonic_model import (
    INNOVATION,
    HarmonicFilter,
    correct_linear,
    predict_extended,
)
from faultloop.relay.estimators.filters.kalman import innovation_of, predicted_variance
from faultloop.relay.estimators.harmonic_filters import (
    begin,
    bound,
    filter_of,
    make_state,
    prepare,
    renew,
    report,
    set_initial,
    settling_samples,
)


@njit(heap=True)
def examine(state: Array, f: HarmonicFilter, c: int, z: float) -> None:
    """Note how far the sample z of channel c is from its prediction."""
    if is_sample(z):
        f.memory[INNOVATION] = innovation_of(f.x, f.row, z)
        compare(state, c, f.memory[INNOVATION], predicted_variance(f.P, f.row))


@njit(heap=True)
def correct_all(state: Array, x: Array) -> None:
    """Renew at a disturbance; correct, and follow the variance of the noise."""
    disturbed = is_disturbed(state)
    for c in range(CHANNELS):
        f = filter_of(state, c)
        if f.P[0, 0] == 0.0:
            continue
        if disturbed:
            renew(state, f, c)
        if is_sample(x[c]):
            predicted = predicted_variance(f.P, f.row)
            correct_linear(f, x[c], noise_variance(state, c))
            follow_variance(state, c, f.memory[INNOVATION], predicted)
        bound(state, f, c)


@njit(heap=True)
def ekf_step(state: Array, x: Array, out: Array) -> None:
    begin(state, x)
    for c in range(CHANNELS):
        f = filter_of(state, c)
        if prepare(state, f, c):
            predict_extended(f)
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
) -> Estimator:
    """Extended Kalman filter.

    Parameters
    ----------
    harmonics : odd harmonics in the model, the fundamental counted; 4 are nine states.
    measurement_variance : least R, over the squared peak of the voltages or currents.
    process_variance : Q of each quadrature per sample, over the squared peak; not given, half a cycle's
        memory.
    frequency_process_variance : Q of the frequency per sample [(rad/s)^2]; not given, two cycles' memory.
    initial_variance : P0 of each quadrature, over the squared peak.
    frequency_initial_variance : P0 of the frequency [(rad/s)^2].
    detection_threshold : squared normalised innovation that is a disturbance.

    Raises InputError for a variance that is not positive, or below 4 samples per cycle for each harmonic.
    """
    state = make_state(
        sampling_hz,
        frequency_hz,
        harmonics=harmonics,
        measurement_variance=measurement_variance,
        process_variance=process_variance,
        frequency_process_variance=frequency_process_variance,
        detection_threshold=detection_threshold,
    )
    set_initial(state, initial_variance, frequency_initial_variance)
    return Estimator("ekf", ekf_step, state, settling_samples(sampling_hz, frequency_hz))
