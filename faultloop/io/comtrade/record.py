"""What a COMTRADE record holds."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from faultloop.errors import InputError

SECOND_NS = 1_000_000_000
LONGEST_NS = 2**60
"""36 years: what a record may last, so that its start and its end both are int64 nanoseconds."""


class Rate(NamedTuple):
    """A stretch of the record with one sampling rate [Hz], up to but not including sample `stop`."""

    hz: float
    stop: int


@dataclass(slots=True, eq=False)
class AnalogChannel:
    """One analog channel.

    `values` has the file's own unit, and is primary or secondary as `scale` ("P", "S", or "" where the file
    does not say) has it.  `ratio` is the instrument transformer's, primary and secondary; (0, 0) if not
    stated.
    """

    name: str
    """As the file has it."""
    values: NDArray[np.float64]
    """(samples,), NaN where missing."""
    unit: str = ""
    phase: str = ""
    """As the file has it."""
    circuit: str = ""
    """What it measures, as the file has it."""
    scale: str = "P"
    ratio: tuple[float, float] = (1.0, 1.0)
    skew_s: float = 0.0
    """Its samples are taken this much after the record's times."""

    @property
    def to_primary(self) -> float:
        """Factor from `values` to primary; NaN for secondary values of a transformer with no stated ratio."""
        primary, secondary = self.ratio
        if self.scale != "S":
            return 1.0
        return primary / secondary if primary > 0 and secondary > 0 else float("nan")


@dataclass(slots=True, eq=False)
class StatusChannel:
    """One status (digital) channel."""

    name: str
    """As the file has it."""
    values: NDArray[np.bool_]
    """(samples,)"""
    phase: str = ""
    """As the file has it."""
    circuit: str = ""
    """What it watches, as the file has it."""
    normal: int = 0
    """Its state while nothing happens."""


@dataclass(slots=True)
class TimeQuality:
    """The last two lines of a 2013 .cfg, as they are there."""

    time_code: str = "0"  # offset of the times in the file from UTC, as -5h30
    local_code: str = "0"  # offset of local time from UTC
    quality: str = "0"  # of the clock, as one hexadecimal digit: 0 locked, F unreliable
    leap_second: str = "3"  # 3: not known


@dataclass(slots=True, eq=False)
class Record:
    """A COMTRADE record: all channels share `t_ns`."""

    t_ns: NDArray[np.int64]
    """(samples,) since the first sample [ns]."""
    analog: list[AnalogChannel]
    """In the order of the file."""
    status: list[StatusChannel] = field(default_factory=list)
    """In the order of the file."""
    rates: tuple[Rate, ...] = ()
    """Stretches of constant rate; empty: the times are from time stamps."""
    start_ns: int = 0
    """Of the first sample, as if the file's clock were UTC [ns since 1970]; 0: unknown."""
    trigger_ns: int = 0
    """Of the trigger, in the same way."""
    frequency_hz: float = 0.0
    """Nominal, as the file states it; 0 if it does not."""
    station: str = ""
    """The station's name."""
    device: str = ""
    """The recorder's name."""
    revision: str = "2013"
    """1991, 1999 or 2013."""
    time_quality: TimeQuality = field(default_factory=TimeQuality)
    """Of the recorder's clock."""
    encoding: str = "utf-8"
    """Of the texts in the file."""
    notes: list[str] = field(default_factory=list)
    """What a user should know of how it was read."""

    def __len__(self) -> int:
        return len(self.t_ns)

    @property
    def analog_names(self) -> list[str]:
        """Of the analog channels."""
        return [channel.name for channel in self.analog]

    @property
    def stretches(self) -> tuple[Rate, ...]:
        """The stretches of constant rate, found from the times where the file does not state them."""
        return self.rates or stretches_of(self.t_ns)


def times_of(rates: tuple[Rate, ...], numbers: NDArray[np.int64]) -> NDArray[np.int64]:
    """Times [ns] of samples numbered from 0, from the rates; sample 0 is at 0.

    A sample is 1/rate after the one before, with the rate of its own stretch.  The last rate goes on.
    Raises InputError where that makes more than 36 years.
    """
    if len(numbers) and float(numbers[-1]) / min(rate.hz for rate in rates) > LONGEST_NS / SECOND_NS:
        slowest = min(rate.hz for rate in rates)
        raise InputError(f"{numbers[-1] + 1} samples at {slowest:g} Hz would take more than 36 years")
    t_ns = np.empty(len(numbers), np.int64)
    origin, origin_ns, first = 0, 0, 0  # the sample before the stretch, its time, the stretch's first sample
    for i, (hz, stop) in enumerate(rates):
        last = i == len(rates) - 1
        inside = (numbers >= first) & ((numbers < stop) | last)
        t_ns[inside] = origin_ns + _duration_ns(numbers[inside] - origin, hz)
        origin_ns += int(_duration_ns(np.array([stop - 1 - origin]), hz)[0])
        origin, first = stop - 1, stop
    return t_ns


def _duration_ns(intervals: NDArray[np.int64], hz: float) -> NDArray[np.int64]:
    if hz == int(hz):
        return intervals * SECOND_NS // int(hz)  # exact, as the sample times of a run are
    return np.rint(intervals * (SECOND_NS / hz)).astype(np.int64)


def stretches_of(t_ns: NDArray[np.int64]) -> tuple[Rate, ...]:
    """Stretches of constant rate in times that come from rounded stamps.

    A stretch ends where an interval differs by more than 20 % from the median of its first ones; its rate is
    rounded to a whole number of hertz if that moves its last time by no more than 2 us.
    """
    if len(t_ns) < 2:
        return (Rate(1.0, len(t_ns)),) if len(t_ns) else ()
    steps = np.diff(t_ns)
    found, first = [], 0  # index of the stretch's first interval
    while first < len(steps):
        usual = float(np.median(steps[first : first + 15]))
        odd = np.flatnonzero(np.abs(steps[first:] - usual) > 0.2 * usual)
        stop = first + int(odd[0]) if len(odd) else len(steps)
        stop = max(stop, first + 1)
        hz = SECOND_NS * (stop - first) / float(t_ns[stop] - t_ns[first])
        if abs(round(hz) - hz) <= hz * 2000 / float(t_ns[stop] - t_ns[first]) and round(hz) > 0:
            hz = float(round(hz))
        found.append(Rate(hz, stop + 1))
        first = stop
    return tuple(found)
