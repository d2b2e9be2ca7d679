"""Modified strong tracking unscented filter: `stukf` with one sigma-point transform a step.

Wang Yi, Liu Heng, Hou Xingzhe, Li Songnong, Ye Jun, Sun Hongliang, Zheng Ke, "Transient voltage disturbance
detection based on modified strong tracking UKF", Power System Protection and Control, 2017, doi
10.7667/PSPC161472, eq. 20 to 39 (seed paper 001).

Where the residuals ask for it the covariance grows, in either of two ways (filters/strong_tracking.py):

- ``disturbance``, the default, is ours: by what a disturbance is expected to change, and the frequency is not
  touched;
- ``covariance``: as a whole, eq. 26.

The paper says the first in words and the second in symbols.  Its figures for MSTUKF are met by the first.
The filter as it is written is ``fading = "covariance"``, ``form = "as-written"``, ``frequency_share = 1``
and the numbers that `stf` names; the other departures of the default are those of `stf`.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from faultloop.jit import njit
from faultloop.relay.estimators.base import CHANNELS, Array, Estimator
from faultloop.relay.estimators.disturbance import noise_variance
from faultloop.relay.estimators.filters.strong_tracking import step_disturbed, step_modified
from faultloop.relay.estimators.harmonic_filters import (
    FUNDAMENTAL_CHANGE,
    HARMONIC_CHANGE,
    begin,
    filter_of,
    follow,
    is_due,
    report,
)
from faultloop.relay.estimators.methods import stukf
from faultloop.relay.estimators.parameters import choice, extends, number


@njit(heap=True)
def mstukf_step(state: Array, x: Array, out: Array) -> None:
    begin(state, x)
    for c in range(CHANNELS):
        f = filter_of(state, c)
        if is_due(state, f, c, x[c]):
            step_disturbed(f, x[c], noise_variance(state, c))
            follow(state, f, c)
    report(state, out)


@njit(heap=True)
def fading_covariance_step(state: Array, x: Array, out: Array) -> None:
    begin(state, x)
    for c in range(CHANNELS):
        f = filter_of(state, c)
        if is_due(state, f, c, x[c]):
            step_modified(f, x[c], noise_variance(state, c))
            follow(state, f, c)
    report(state, out)


STEPS = {"disturbance": mstukf_step, "covariance": fading_covariance_step}


@extends(stukf.make)
def make(
    sampling_hz: int,
    frequency_hz: float,
    *,
    fading: str = "disturbance",
    fundamental_change: float = 0.3,
    harmonic_change: float = 0.03,
    **others: Any,
) -> Estimator:
    """Modified strong tracking unscented filter.

    Parameters
    ----------
    fading : ``disturbance`` (ours) or ``covariance`` (eq. 26).
    fundamental_change, harmonic_change : variance that a disturbance adds to each quadrature of the
        fundamental, and of each harmonic, over the squared peak; for ``disturbance``.
    others : as those of `stukf`.

    Raises InputError as `stukf`.
    """
    extended = stukf.make(sampling_hz, frequency_hz, **others)
    extended.state[FUNDAMENTAL_CHANGE] = number("fundamental_change", fundamental_change, above=0.0)
    extended.state[HARMONIC_CHANGE] = number("harmonic_change", harmonic_change, above=0.0)
    return replace(extended, name="mstukf", step=STEPS[choice("fading", fading, tuple(STEPS))])
