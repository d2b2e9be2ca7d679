"""What has to be known of the whole of a relay's record, from one pass over it in stretches.

A log may be longer than memory: figures of the whole are gathered here, and what is looked at more closely is
read as a stretch of time (`rows.relay_rows`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from faultloop.io.mcap_reader import Log
from faultloop.io.messages import CHANNELS, ELEMENTS, PHASORS, SAMPLED_VALUES
from faultloop.jit import njit
from faultloop.review.rows import RelayRows, Span, relay_rows

SURVEYED = (SAMPLED_VALUES, PHASORS, ELEMENTS)
_DONE: WeakKeyDictionary[Log, dict[str, Survey]] = WeakKeyDictionary()


@dataclass
class Survey:
    """A relay's record as a whole.

    Attributes
    ----------
    count, first_ns, last_ns : number and span of its samples [ns since the run's start]; None without any.
    interval_ns : sampling interval [ns], the median of the first stretch; NaN with less than two samples.
    spans : when each bit that ever was on was on, by its IEC 61850 data name.
    not_numbers : (6,) samples that are no numbers.
    peaks : (6,) greatest instantaneous value; ``peak_ns`` its time; ``rms`` the greatest RMS phasor; NaN
        where there is none.
    gaps : number of gaps in the samples.
    frequency_hz : median of what was measured, NaN where nothing was.
    """

    name: str
    count: int = 0
    first_ns: int | None = None
    last_ns: int | None = None
    interval_ns: float = np.nan
    spans: dict[str, list[Span]] = field(default_factory=dict)
    not_numbers: NDArray[np.int64] = field(default_factory=lambda: np.zeros(len(CHANNELS), np.int64))
    peaks: NDArray[np.float64] = field(default_factory=lambda: np.full(len(CHANNELS), np.nan))
    peak_ns: NDArray[np.int64] = field(default_factory=lambda: np.zeros(len(CHANNELS), np.int64))
    rms: NDArray[np.float64] = field(default_factory=lambda: np.full(len(CHANNELS), np.nan))
    gaps: int = 0
    frequency_hz: float = np.nan
    _steps: tuple[int, int] | None = None
    _frequencies: list[float] = field(default_factory=list)

    def __len__(self) -> int:
        return self.count

    @property
    def sampling_hz(self) -> float:
        """From the whole record where it has no gap: the times themselves are rounded to 1 ns."""
        if self._steps is None or self.first_ns is None or self.last_ns is None:
            return np.nan
        if self._steps[1] - self._steps[0] > 1:
            return round(1e9 / self.interval_ns, 3) if self.interval_ns > 0 else np.nan
        return round((self.count - 1) * 1e9 / float(self.last_ns - self.first_ns), 3)

    def first_pickup(self) -> tuple[int, str] | None:
        """Time and name of the first element that started (``.Str``)."""
        starts = [(spans[0][0], name) for name, spans in self.spans.items() if name.endswith(".Str")]
        return min(starts, default=None)

    def take(self, rows: RelayRows) -> None:
        """The next stretch of the record."""
        if not len(rows):
            return
        self._take_times(rows.t_ns)
        self._take_values(rows)
        for name, spans in rows.spans.items():
            self._take_spans(name, spans, int(rows.t_ns[0]))
        for name, spans in self.spans.items():
            if spans[-1][1] is None and name not in rows.spans:
                spans[-1] = (spans[-1][0], int(rows.t_ns[0]))

    def _take_times(self, t_ns: NDArray[np.int64]) -> None:
        steps = np.diff(t_ns) if self.last_ns is None else np.diff(t_ns, prepend=self.last_ns)
        if len(steps):
            if not self.interval_ns > 0:
                self.interval_ns = float(np.median(steps))
            low, high = int(steps.min()), int(steps.max())
            known = self._steps or (low, high)
            self._steps = min(known[0], low), max(known[1], high)
            self.gaps += int((steps > 1.5 * self.interval_ns).sum())
        self.first_ns = int(t_ns[0]) if self.first_ns is None else self.first_ns
        self.last_ns = int(t_ns[-1])
        self.count += len(t_ns)

    def _take_values(self, rows: RelayRows) -> None:
        _take(rows.samples, rows.t_ns, self.not_numbers, self.peaks, self.peak_ns)
        _take_phasors(rows.phasors, self.rms)
        frequency = rows.frequency[np.isfinite(rows.frequency)]
        if len(frequency):
            self._frequencies.append(float(np.median(frequency)))
            self.frequency_hz = float(np.median(self._frequencies))

    def _take_spans(self, name: str, spans: list[Span], begin_ns: int) -> None:
        known = self.spans.setdefault(name, [])
        if known and known[-1][1] is None:
            if spans[0][0] == begin_ns:  # goes on
                spans = [(known.pop()[0], spans[0][1]), *spans[1:]]
            else:
                known[-1] = (known[-1][0], begin_ns)
        known.extend(spans)


@njit
def _take(
    samples: NDArray[np.float64],
    t_ns: NDArray[np.int64],
    not_numbers: NDArray[np.int64],
    peaks: NDArray[np.float64],
    peak_ns: NDArray[np.int64],
) -> None:
    """Greatest instantaneous values; in one pass, as a minute of two relays has 10 million samples."""
    for channel in range(samples.shape[1]):
        greatest, at, numbers = -1.0, -1, 0
        for row in range(samples.shape[0]):
            size = abs(samples[row, channel])
            numbers += math.isfinite(size)
            if size > greatest:
                greatest, at = size, row
        not_numbers[channel] += samples.shape[0] - numbers
        if numbers and not peaks[channel] >= greatest:
            peaks[channel], peak_ns[channel] = greatest, t_ns[at]


@njit
def _take_phasors(phasors: NDArray[np.complex128], greatest: NDArray[np.float64]) -> None:
    """Greatest RMS values that are finite."""
    for row in range(phasors.shape[0]):
        for channel in range(phasors.shape[1]):
            size = abs(phasors[row, channel])
            if math.isfinite(size) and not greatest[channel] >= size:
                greatest[channel] = size


def survey(log: Log, relay: str) -> Survey:
    """Of a relay's whole record; made once for a log, of all its relays in one pass.  Raises InputError where
    its content is damaged."""
    if log not in _DONE:
        found = {name: Survey(name) for name in log.relays}
        for span in log.stretches():
            for name, own in found.items():
                own.take(relay_rows(log, name, *span, kinds=SURVEYED))
        _DONE[log] = found
    return _DONE[log][relay]
