"""The relay's decision, sample by sample: what is shared first, then every function, then the words of bits.

The part that calls the functions is composed from ``FUNCTIONS``: for each one a loop over its instances,

    for k in range(c.count.pdis): pdis(g, q, c.pdis[k], s.pdis[k])

It is compiled once, as any kernel here, and kept in numba's cache under this file's name (measured beside the
chain written by hand before: the same time per sample).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from numpy.typing import NDArray

from faultloop.jit import njit
from faultloop.relay.functions import FUNCTIONS
from faultloop.relay.functions.function import Function
from faultloop.relay.quantities import Record, begin, finish


def compose(functions: Iterable[Function]) -> Callable[[Record, Record], None]:
    """``step(c, s)``: one sample of every instance of every function, in their order."""
    lines = ["def step_functions(c, s):", "    g, q = c.shared, s.shared"]
    names: dict[str, Any] = {"__name__": __name__}
    for function in functions:
        key = function.key
        names[f"step_{key}"] = function.step
        lines.append(f"    for k in range(c.count.{key}):")
        lines.append(f"        step_{key}(g, q, c.{key}[k], s.{key}[k])")
    exec(compile("\n".join(lines), __file__, "exec"), names)
    return njit(names["step_functions"])


step_functions = compose(FUNCTIONS)


@njit
def decide(
    constants: NDArray, state: NDArray, samples: NDArray, phasors: NDArray, loops: NDArray, words: NDArray
) -> int:
    """Run a block; stop after the first sample at which an output changed or there is something to tell.

    Parameters
    ----------
    constants, state : records ``CONSTANTS``, ``STATE``, shape (1,).
    samples : (n, 6), or (n, WIDE).
    phasors, loops : (n, 14) with their frequency, (n, 12).
    words : (n, 2) uint64, written: pickup and operate bits.

    Returns the number of samples done.
    """
    c, s = constants[0], state[0]
    g, q = c.shared, s.shared
    q.changed = 0
    for n in range(words.shape[0]):
        poles, close, pilot, notices, transfer = q.poles, q.close_poles, q.pilot, q.notices, q.transfer
        sets = q.phasors
        begin(g, q, samples[n], phasors[n], loops[n])
        step_functions(c, s)
        finish(g, q, words[n])
        same = q.poles == poles and q.close_poles == close and q.pilot == pilot and q.transfer == transfer
        if not same or q.notices != notices or q.phasors != sets:
            return n + 1
    return words.shape[0]
