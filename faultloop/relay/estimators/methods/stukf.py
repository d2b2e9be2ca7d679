"""Strong tracking unscented filter: `stf` in sigma points, three transforms a step.

Wang Xiaoxu, Zhao Lin, Xia Quanxi, Hao Yong, "Strong tracking filter based on unscented transformation",
Control and Decision 25 (7), 2010, pp. 1063-1068: reference 14 of seed paper 001.

For a linear measurement `mstukf` does the same by one transform.  Its departures are those of `stf`; ``form =
"as-written"`` is without them.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from faultloop.jit import njit
from faultloop.relay.estimators.base import CHANNELS, Array, Estimator
from faultloop.relay.estimators.disturbance import noise_variance
from faultloop.relay.estimators.filters.strong_tracking import step_strong_unscented
from faultloop.relay.estimators.harmonic_filters import (
    begin,
    filter_of,
    follow,
    is_due,
    report,
    seen_of,
    set_sigma_points,
)
from faultloop.relay.estimators.methods import stf
from faultloop.relay.estimators.parameters import extends


@njit(heap=True)
def stukf_step(state: Array, x: Array, out: Array) -> None:
    begin(state, x)
    seen = seen_of(state)
    for c in range(CHANNELS):
        f = filter_of(state, c)
        if is_due(state, f, c, x[c]):
            step_strong_unscented(f, seen, x[c], noise_variance(state, c))
            follow(state, f, c)
    report(state, out)


@extends(stf.make)
def make(
    sampling_hz: int,
    frequency_hz: float,
    *,
    alpha: float = 1e-3,
    beta: float = 2.0,
    kappa: float = 0.0,
    **others: Any,
) -> Estimator:
    """Strong tracking unscented filter.

    Parameters
    ----------
    alpha, beta, kappa : of the sigma points; the paper's section 4.
    others : as those of `stf`.

    Raises InputError as `stf`, and for alpha not above 0, beta below alpha^2 or kappa not above -n.
    """
    extended = stf.make(sampling_hz, frequency_hz, **others)
    set_sigma_points(extended.state, alpha, beta, kappa)
    return replace(extended, name="stukf", step=stukf_step)
