"""Phasor estimators: from six samples to six phasors, one step per sample.

from faultloop.relay.estimators import make_estimator, run_estimator

estimator = make_estimator("fourier", 4800, 50.0)
state = estimator.state.copy()
run_estimator(estimator.step, state, samples, phasors)   # (n, 6) -> (n, 14)
"""

from __future__ import annotations

from faultloop.relay.estimators.base import (
    CHANNELS,
    FREQUENCY,
    ROCOF,
    ROW,
    STEP,
    STEP_FUNCTION,
    Estimator,
    is_compiled,
    run_block,
    run_estimator,
)
from faultloop.relay.estimators.registry import (
    build_estimator,
    estimator_methods,
    estimator_parameters,
    is_own,
    make_estimator,
    register,
)

__all__ = [
    "CHANNELS",
    "FREQUENCY",
    "ROCOF",
    "ROW",
    "STEP",
    "STEP_FUNCTION",
    "Estimator",
    "build_estimator",
    "estimator_methods",
    "estimator_parameters",
    "is_compiled",
    "is_own",
    "make_estimator",
    "register",
    "run_block",
    "run_estimator",
]
