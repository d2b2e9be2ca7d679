"""How an estimator's step is run over a block.

A compiled step goes to the shared loop `run_block` by its address, taken once: handing over the dispatcher
itself costs 33 us a call, this 3 us (measured), and blocks in a closed loop may be of one sample.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numba.core import types
from numba.core.dispatcher import Dispatcher
from numpy.typing import NDArray

from faultloop.relay.entry import cached_step
from faultloop.relay.estimators import STEP, is_compiled, run_block, run_estimator

Array = NDArray[np.float64]
Runner = Callable[[Array, Array, Array], None]


class StepAddress(types.WrapperAddressProtocol):
    """A compiled step as numba's first-class function: its address, and the library that holds it."""

    def __init__(self, step: Any) -> None:
        self.compiled = step.get_compile_result(STEP)  # kept: it owns the machine code
        name = self.compiled.fndesc.llvm_cfunc_wrapper_name
        self.address = self.compiled.library.get_pointer_to_function(name)

    def __wrapper_address__(self) -> int:
        return self.address

    def signature(self) -> Any:
        return STEP


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
    address = StepAddress(step)
    loop = run_block.overloads[run_block.signatures[0]].entry_point  # types are known: no dispatch
    return lambda state, x, out: loop(address, state, x, out)
