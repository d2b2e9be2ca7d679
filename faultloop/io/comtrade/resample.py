"""A record on a relay's clock: what a test set does that plays it into a relay's own A/D converter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.signal import kaiserord, oaconvolve

from faultloop.errors import InputError
from faultloop.io.comtrade.record import SECOND_NS, Rate
from faultloop.io.comtrade.select import SLOTS, SixChannels

STOP_BAND_DB = 70.0
PASS_BAND = 0.3
"""Of the new sampling frequency; what is above its half goes."""


def resample(six: SixChannels, sampling_hz: int) -> SixChannels:
    """The same signals at the times ``k * 1_000_000_000 // sampling_hz`` from the record's first sample on.

    Each stretch of constant rate has its own cubic spline, through its samples and the last one before it, so
    that a slow stretch does not ripple into a fast one.  Where a stretch is faster than `sampling_hz`, a
    low-pass without delay goes before (flat to 0.3, 70 dB down from 0.5 of the new frequency).  A channel's
    skew is taken out.  Missing values are bridged by straight lines; a channel that is not there stays NaN.
    With the same rate and no skew, the samples come back bit by bit.

    Raises
    ------
    InputError : fewer than four samples.
    """
    if len(six.t_ns) < 4:
        raise InputError(f"a record of {len(six.t_ns)} samples: at least 4 are needed to resample it")
    notes = list(six.notes)
    last = ((int(six.t_ns[-1]) + 1) * sampling_hz - 1) // SECOND_NS  # the last k that is not after the record
    times = np.arange(last + 1) * SECOND_NS // sampling_hz
    values = np.empty((len(times), 6))
    for i, slot in enumerate(SLOTS):
        column, bridged = _bridge(six.t_ns, six.values[:, i])
        if bridged:
            notes.append(f"{slot}: {bridged} missing values bridged by straight lines")
        values[:, i] = _column(six, column, six.skew_s[i], times)
    rates = (Rate(float(sampling_hz), len(times)),)
    return replace(six, t_ns=times, values=values, stretches=rates, skew_s=(0.0,) * 6, notes=notes)


def _bridge(t_ns: NDArray[np.int64], column: NDArray[np.float64]) -> tuple[NDArray[np.float64], int]:
    """The column without its gaps, and how many values that were; as it is if there is nothing in it."""
    gaps = np.isnan(column)
    count = int(gaps.sum())
    if count in (0, len(column)):
        return column, 0
    return np.where(gaps, np.interp(t_ns, t_ns[~gaps], column[~gaps]), column), count


def _column(
    six: SixChannels, column: NDArray[np.float64], skew_s: float, times: NDArray[np.int64]
) -> NDArray[np.float64]:
    """One channel at new times."""
    if np.isnan(column).all():
        return np.full(len(times), np.nan)
    if skew_s == 0.0 and len(times) == len(column) and np.abs(times - six.t_ns).max() <= 1:
        return column.copy()
    hz = SECOND_NS * (len(times) - 1) / float(times[-1])
    taken_ns = six.t_ns + skew_s * SECOND_NS
    result, first, done = np.empty(len(times)), 0, 0
    for rate in six.stretches:
        smooth = column.copy()
        smooth[first : rate.stop] = _limit_band(column[first : rate.stop], rate.hz, hz)
        begin = max(min(first - 1, rate.stop - 4), 0)
        spline = CubicSpline(taken_ns[begin : rate.stop], smooth[begin : rate.stop])
        last = rate.stop == len(column)
        end = len(times) if last else int(np.searchsorted(times, taken_ns[rate.stop - 1], side="right"))
        result[done:end] = spline(times[done:end])
        first, done = rate.stop, max(done, end)
    return result


def _limit_band(values: NDArray[np.float64], hz: float, new_hz: float) -> NDArray[np.float64]:
    """Low-pass for decimation, with no delay; the ends are continued by their point reflection."""
    if hz <= 1.001 * new_hz or len(values) < 4:
        return values
    count, beta = kaiserord(STOP_BAND_DB, (0.5 - PASS_BAND) * new_hz / (hz / 2))
    count |= 1  # odd: its delay is a whole number of samples
    cutoff = (0.5 + PASS_BAND) * new_hz / hz  # of the Nyquist frequency
    taps = np.sinc(cutoff * (np.arange(count) - count // 2)) * np.kaiser(count, beta)
    taps /= taps.sum()
    extended = np.pad(values, count // 2, mode="reflect", reflect_type="odd")
    return oaconvolve(extended, taps, mode="valid")
