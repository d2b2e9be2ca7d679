"""Sampled values as they arrive, made into the unbroken rows that a relay runs over."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from faultloop.io.can.frames import Frame, SampledValues, decode
from faultloop.io.can.table import CURRENT_LSB, VOLTAGE_LSB
from faultloop.nodes.clock import SECOND_NS, SampleClock
from faultloop.relay.quantities import WIDE

BRIDGED = 2
"""Missing samples in a row that are interpolated, as subscribers of merging units do; more break the rows."""
WAITS = 8
"""Samples for which one waits for the parallel line's of the same number."""
AHEAD_NS = SECOND_NS
"""A sample that is further ahead of the clock is refused: its number would make all true ones look old."""


class _Segment(NamedTuple):
    first: int
    rows: list[tuple[float, ...]]


class SampleStream:
    """One relay's frames of sampled values, checked and put in order.

    A lost sample is bridged by a straight line where `BRIDGED` allows.  Otherwise the rows begin anew at a
    whole cycle of the run, where the phasors' reference is what it was.

    Parameters
    ----------
    sampling_hz : samples per second.
    cycle : samples in the smallest number of whole cycles.
    """

    def __init__(self, sampling_hz: int, cycle: int) -> None:
        self.next_count = 0
        self.lost = 0
        """Samples that never came."""
        self.bridged = 0
        """Of them, those that were interpolated."""
        self.rejected = 0
        """Frames that were not a new, valid sample."""
        self._clock = SampleClock(sampling_hz)
        self._cycle = cycle
        self._last: tuple[float, ...] | None = None
        self._segment: _Segment | None = None
        self._segments: list[_Segment] = []

    def receive(self, t_ns: int, frame: Frame) -> bool:
        """Take a frame that came at `t_ns`; True if it is a new sample."""
        message = decode(frame)
        if not isinstance(message, SampledValues) or self._implausible(t_ns, message):
            self.rejected += 1
            return False
        count, values = message.sample_count, message.values
        if not self._bridge(count, values):
            self._segment = None
        self.next_count, self._last = count + 1, values
        if self._segment is None:
            if count % self._cycle:
                return True
            self._segment = _Segment(count, [])
            self._segments.append(self._segment)
        self._segment.rows.append(values)
        return True

    def _implausible(self, t_ns: int, message: SampledValues) -> bool:
        ahead_ns = self._clock.ns(message.sample_count) - t_ns
        again = message.sample_count < self.next_count
        return again or ahead_ns > AHEAD_NS or any(math.isnan(value) for value in message.values)

    def _bridge(self, count: int, values: tuple[float, ...]) -> bool:
        """Rows for the samples that are missing before `count`; False if they are too many."""
        gap = count - self.next_count
        if gap == 0:
            return True
        if self._last is None:
            return False
        self.lost += gap
        if gap > BRIDGED:
            return False
        self.bridged += gap
        if self._segment is not None:
            for k in range(1, gap + 1):
                part = k / (gap + 1)
                row = [a + (b - a) * part for a, b in zip(self._last, values, strict=True)]
                self._segment.rows.append(tuple(row))
        return True

    def take(self) -> list[tuple[int, NDArray[np.float64]]]:
        """What has come since the last time: number of the first sample and rows (n, 6), for each run of
        samples without a break."""
        taken = [(segment.first, np.array(segment.rows)) for segment in self._segments if segment.rows]
        if self._segment is not None:
            self._segment = _Segment(self.next_count, [])
        self._segments = [] if self._segment is None else [self._segment]
        return taken


class BesideStream:
    """The residual current of another relay's samples, for the rows of one that measures it, too.

    A row waits for the other's sample of its number, at most until `WAITS` further ones of its own have
    come; it then has none.
    """

    def __init__(self, sampling_hz: int, cycle: int) -> None:
        self._stream = SampleStream(sampling_hz, cycle)
        self._residual: dict[int, float] = {}
        self._waiting: list[tuple[int, NDArray[np.float64]]] = []

    def receive(self, t_ns: int, frame: Frame) -> None:
        """Take one of the other's frames."""
        self._stream.receive(t_ns, frame)

    def join(self, taken: list[tuple[int, NDArray[np.float64]]]) -> list[tuple[int, NDArray[np.float64]]]:
        """What `SampleStream.take` gave, as rows (n, WIDE) as far as they are whole."""
        for first, rows in self._stream.take():
            self._residual |= dict(enumerate(rows[:, 3:].sum(axis=1).tolist(), first))
        self._waiting += taken
        joined, left = [], []
        newest = max((first + len(rows) for first, rows in self._waiting), default=0)
        for first, rows in self._waiting:
            count = 0
            if not left:
                while count < len(rows) and (
                    first + count in self._residual or first + count < newest - WAITS
                ):
                    count += 1
            if count:
                wide = np.full((count, WIDE), np.nan)
                wide[:, :6] = rows[:count]
                wide[:, -1] = [self._residual.pop(first + k, np.nan) for k in range(count)]
                joined.append((first, wide))
            if count < len(rows):
                left.append((first + count, rows[count:]))
        self._waiting = left
        done = left[0][0] if left else newest
        self._residual = {number: i for number, i in self._residual.items() if number >= done}
        return joined


def quantised(samples: NDArray[np.float64]) -> NDArray[np.float64]:
    """Samples (..., 6) as a frame carries them: to 10 mV and 1 mA."""
    lsb = np.array([VOLTAGE_LSB] * 3 + [CURRENT_LSB] * 3)
    return np.round(samples / lsb) * lsb
