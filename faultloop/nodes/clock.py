"""When a node has something to send."""

from __future__ import annotations

import numpy as np

FOREVER = np.iinfo(np.int64).max


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
