"""The one role of this folder: a step that turns six samples into a row of phasors.

``step(state, x, out)``: state float64[::1], x float64[6] (va vb vc ia ib ic), out float64[14] (re and im of
the six phasors, RMS against cos(2 pi f0 t) with t = n / fs, then frequency_hz and rocof_hz_per_s, NaN
where the method does not estimate them, and until it has measured them for the first time).  The phasor
refers to the time of the newest sample, or of the one `Estimator.delay_samples` before it.

Everything that a step needs or changes is in ``state``: to copy the array is to take a checkpoint.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import types
from numba.core.dispatcher import Dispatcher
from numpy.typing import NDArray

from faultloop.errors import InputError
from faultloop.jit import njit

Array = NDArray[np.float64]

CHANNELS = 6
ROW = 14
FREQUENCY = 12
ROCOF = 13

_VECTOR = types.float64[::1]
_MATRIX = types.float64[:, ::1]

# A compiled step is passed as a value of this type, so a caller that takes it compiles once and serves
# every estimator, the user's own included; the call through the pointer costs about 13 ns.
STEP = types.void(_VECTOR, _VECTOR, _VECTOR)
STEP_FUNCTION = types.FunctionType(STEP)


@dataclass(frozen=True)
class Estimator:
    """A phasor estimator, ready to run.

    Attributes
    ----------
    name : the method's name in a settings file.
    step : plain function or ``@njit``, ``step(state, x, out)`` as the module's docstring says.
    state : (k,) float64, the initial state; run a copy of it.
    settling_samples : samples from the start after which a pure sinusoid at f0 is within 0.1 %: the window of
        a FIR estimator, which is then exact, or a cycle of a recursive one, which goes on converging.
    delay_samples : the row refers to the time of the sample this many before the newest.  0 but for the
        synchrophasor filters, whose time stamp is the window's centre; at f0 a phasor is the same at both.
    """

    name: str
    step: Callable[[Array, Array, Array], Any]
    state: Array
    settling_samples: int
    delay_samples: int = 0


@njit(signature_or_function=types.void(STEP_FUNCTION, _VECTOR, _MATRIX, _MATRIX))
def run_block(step: Callable[..., None], state: Array, samples: Array, phasors: Array) -> None:
    """Compiled loop over a block; one machine code for all estimators."""
    for n in range(samples.shape[0]):
        step(state, samples[n], phasors[n])


def is_compiled(step: Callable[..., Any]) -> bool:
    """True if ``step`` is ``@njit``; it is then ready to be passed as a ``STEP_FUNCTION``.

    Raises
    ------
    InputError : a compiled step that does not fit ``step(state, x, out)`` or returns a value.
    """
    if not isinstance(step, Dispatcher):
        return False
    if STEP.args not in step.overloads:
        try:
            step.compile(STEP.args)
        except Exception as error:  # numba raises many types; all of them mean this
            reason = str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
            raise InputError(
                f"step '{step.__name__}' does not compile as step(state, x, out): {reason}"
            ) from error
    if step.overloads[STEP.args].signature.return_type != types.none:
        raise InputError(f"step '{step.__name__}' returns a value; it should write to out and return nothing")
    return True


def run_estimator(step: Callable[..., Any], state: Array, samples: Array, phasors: Array) -> None:
    """Estimate a block: the compiled loop for a compiled step, a Python loop for a plain function.

    Parameters
    ----------
    step : an estimator's step.
    state : (k,) float64, changed in place.
    samples : (n, 6) float64, C-contiguous, primary V and A.
    phasors : (n, 14) float64, C-contiguous, written.

    Raises
    ------
    TypeError : arrays of another kind (checked here, once per block).
    """
    for name, array in (("samples", samples), ("phasors", phasors)):
        if array.dtype != np.float64 or array.ndim != 2 or not array.flags.c_contiguous:
            raise TypeError(f"{name} should be two-dimensional C-contiguous float64, not {array.dtype}")
    if len(samples) != len(phasors):
        raise TypeError(f"{len(samples)} samples need as many rows of phasors, not {len(phasors)}")
    if is_compiled(step):
        run_block(step, state, samples, phasors)
        return
    for x, out in zip(samples, phasors, strict=True):
        step(state, x, out)
