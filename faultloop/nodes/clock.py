"""When a node has something to send."""

from __future__ import annotations

from typing import Any, NamedTuple, overload

import numpy as np
from numpy.typing import NDArray

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


class Cyclic:
    """Due at every multiple of an interval, counted from zero so that no rounding adds up."""

    def __init__(self, rate_hz: float, first: int = 0) -> None:
        self.rate_hz = rate_hz
        self.count = first
        self.next_ns = self._due()

    @classmethod
    def since(cls, start_ns: int, rate_hz: float) -> Cyclic:
        """Due at the multiples from `start_ns` on."""
        cyclic = cls(rate_hz, first=max(0, int(start_ns * rate_hz / 1e9)))
        while cyclic.next_ns < start_ns:
            cyclic.poll(start_ns)
        return cyclic

    def _due(self) -> int:
        return round(self.count * 1e9 / self.rate_hz) if self.rate_hz > 0 else FOREVER

    def poll(self, t_ns: int) -> bool:
        if t_ns < self.next_ns:
            return False
        self.count += 1
        self.next_ns = self._due()
        return True
