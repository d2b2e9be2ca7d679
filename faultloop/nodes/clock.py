"""When a node has something to send."""

from __future__ import annotations

from typing import Any, NamedTuple, overload

import numpy as np
from numpy.typing import NDArray

from faultloop.io.can.record import Record
from faultloop.jit import njit

FOREVER = np.iinfo(np.int64).max
SECOND_NS = 1_000_000_000


class SampleClock(NamedTuple):
    """When each sample is taken, counted from the run's start: nothing adds up."""

    sampling_hz: int

    @overload
    def ns(self, k: int) -> int: ...
    @overload
    def ns(self, k: NDArray[np.int64]) -> NDArray[np.int64]: ...
    def ns(self, k: Any) -> Any:
        """Time of sample `k`, or of an array of them [ns]."""
        return k * SECOND_NS // self.sampling_hz

    def first_from(self, t_ns: int) -> int:
        """Number of the first sample that is not before `t_ns`."""
        k = t_ns * self.sampling_hz // SECOND_NS
        while self.ns(k) < t_ns:
            k += 1
        return k


CYCLIC = np.dtype([("rate_hz", "f8"), ("count", "i8"), ("next_ns", "i8")])


@njit
def tick(c: Record, t_ns: int) -> bool:
    """Is a ``CYCLIC`` due at ``t_ns``?  Then the next is due at ``next_ns``, a multiple of the interval that
    is counted from zero, so that no rounding adds up; a rate of 0 is never due."""
    if t_ns < c.next_ns:
        return False
    c.count += 1
    c.next_ns = due_ns(c)
    return True


@njit
def due_ns(c: Record) -> int:
    """When number ``count`` is due [ns]."""
    return int(np.int64(np.rint(c.count * 1e9 / c.rate_hz))) if c.rate_hz > 0 else int(np.int64(FOREVER))


class Cyclic:
    """Due at every multiple of an interval.

    Parameters
    ----------
    start_ns : the first is not before this.
    record : a view of one ``CYCLIC``, shape (1,), to be used; a new one where not given.
    """

    def __init__(self, rate_hz: float, start_ns: int = 0, *, record: Any = None) -> None:
        self.record = np.zeros(1, CYCLIC) if record is None else record
        self.record[0] = (rate_hz, max(0, int(start_ns * rate_hz / 1e9)), 0)
        self.record["next_ns"] = due_ns(self.record[0])
        while self.next_ns < start_ns:
            self.poll(start_ns)

    @property
    def next_ns(self) -> int:
        """When it is due next."""
        return int(self.record["next_ns"][0])

    def poll(self, t_ns: int) -> bool:
        """Is it due?  Once for each time."""
        return tick(self.record[0], t_ns)
