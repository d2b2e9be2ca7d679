"""Unscented Kalman filter on a fundamental, odd harmonics and the frequency (the plain filter beside seed
paper 001, whose MSTUKF extends it): `ekf` with sigma points in place of the Jacobian, eq. 22 to 25.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from faultloop.jit import njit
from faultloop.relay.estimators.base import CHANNELS, Array, Estimator
from faultloop.relay.estimators.filters.harmonic_model import predict_unscented
from faultloop.relay.estimators.harmonic_filters import (
    begin,
    filter_of,
    prepare,
    report,
    set_sigma_points,
)
from faultloop.relay.estimators.methods import ekf
from faultloop.relay.estimators.parameters import extends


@njit(heap=True)
def ukf_step(state: Array, x: Array, out: Array) -> None:
    begin(state, x)
    for c in range(CHANNELS):
        f = filter_of(state, c)
        if prepare(state, f, c):
            predict_unscented(f)
            ekf.examine(state, f, c, x[c])
    ekf.correct_all(state, x)
    report(state, out)


@extends(ekf.make)
def make(
    sampling_hz: int,
    frequency_hz: float,
    *,
    alpha: float = 1e-3,
    beta: float = 2.0,
    kappa: float = 0.0,
    **others: Any,
) -> Estimator:
    """Unscented Kalman filter.

    Parameters
    ----------
    alpha, beta, kappa : of the sigma points; the paper's section 4.
    others : as those of `ekf`.

    Raises InputError as `ekf`, and for alpha not above 0, beta below alpha^2 or kappa not above -n.
    """
    extended = ekf.make(sampling_hz, frequency_hz, **others)
    set_sigma_points(extended.state, alpha, beta, kappa)
    return replace(extended, name="ukf", step=ukf_step)
