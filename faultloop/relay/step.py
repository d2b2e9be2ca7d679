"""How an estimator's step is run over a block.

A compiled step goes to the shared loop `run_block` by its address, taken once: handing over the dispatcher
itself costs 33 us a call, this 3 us (measured), and blocks in a closed loop may be of one sample.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numba.core.dispatcher import Dispatcher
from numpy.typing import NDArray

from faultloop.jit import Address
from faultloop.relay.entry import cached_step
from faultloop.relay.estimators import STEP, is_compiled, run_block, run_estimator

Array = NDArray[np.float64]
Runner = Callable[[Array, Array, Array], None]


def block_runner(step: Callable[[Array, Array, Array], Any]) -> Runner:
    """``run(state, x (n, k), out (n, j))``, all C-contiguous float64, for a compiled or a plain step.

    Raises
    ------
    InputError : a compiled step of another signature.
    """
    if isinstance(step, Dispatcher) and not step.__module__.startswith("faultloop."):
        step = cached_step(step)
    if not is_compiled(step):
        return lambda state, x, out: run_estimator(step, state, x, out)
    return CompiledRunner(step)


class CompiledRunner:
    """Runs a compiled step over a block."""

    def __init__(self, step: Any) -> None:
        self.step = Address(step, *STEP.args)
        self._loop = run_block.overloads[run_block.signatures[0]].entry_point  # types are known: no dispatch

    def __call__(self, state: Array, x: Array, out: Array) -> None:
        self._loop(self.step, state, x, out)


def step_address(run: Runner) -> int:
    """Of the step that is run, for a kernel that calls it; 0 where it is plain Python."""
    return run.step.address if isinstance(run, CompiledRunner) else 0
