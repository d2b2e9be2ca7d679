"""A record on a relay's clock: what a test set does that plays it into a relay's own A/D converter."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

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
MOST_SAMPLES = 2**24
"""58 minutes of 4800 Hz: 0.8 GB."""
_MARGIN_NS = 100_000_000
_TOLD = 8

Span = tuple[int, int]


def resample(
    six: SixChannels,
    sampling_hz: int,
    *,
    least_hz: float = 0.0,
    shortest_s: float = 0.0,
    window_s: tuple[float, float] | None = None,
) -> SixChannels:
    """The same signals at times ``k * 1_000_000_000 // sampling_hz`` ns from the record's first sample on.

    Each stretch of constant rate has its own cubic spline, through its samples and the last one before it, so
    that a slow stretch does not ripple into a fast one.  Where a stretch is faster than `sampling_hz`, a
    low-pass without delay goes before (flat to 0.3, 70 dB down from 0.5 of the new frequency).  A channel's
    skew is taken out.  Missing values are bridged by straight lines; a channel that is not there stays NaN.
    With the same rate and no skew, the samples come back bit by bit.

    Parameters
    ----------
    least_hz : where two samples (or two values of a channel that has some) are further apart than by
        ``1 / least_hz``, nothing is made up between them: there the result has no samples, and a warning says
        so.  Its ``t_ns`` then has gaps; one entry of its ``stretches`` is one piece without any.
    shortest_s : a piece between two such gaps that is shorter is left out, too.
    window_s : from, to [s]: the samples at these times only.

    Raises
    ------
    InputError : fewer than four samples, or less than two of the new ones; too many of them.
    """
    if len(six.t_ns) < 4:
        raise InputError(f"a record of {len(six.t_ns)} samples: at least 4 are needed to resample it")
    window = (0.0, float("inf")) if window_s is None else window_s
    six = _crop(six, window)
    bridged = [_bridge(six.t_ns, six.values[:, i]) for i in range(6)]
    notes, warnings = list(six.notes), list(six.warnings)
    pieces = _pieces(six, least_hz, shortest_s)
    times = [_times(six.t_ns, piece, sampling_hz, window) for piece in pieces]
    pieces = [piece for piece, own in zip(pieces, times, strict=True) if len(own) >= 2]
    times = [own for own in times if len(own) >= 2]
    warnings += _told(six.t_ns, pieces, least_hz)
    if not pieces:
        raise InputError(_nothing(six, sampling_hz, least_hz, warnings))
    notes += [f"{slot}: {count} missing value{'s' * (count > 1)} bridged by straight lines"
              for slot, (_, count) in zip(SLOTS, bridged, strict=True) if count]  # fmt: skip
    values = np.empty((sum(len(own) for own in times), 6))
    for i in range(6):
        done = 0
        for piece, own in zip(pieces, times, strict=True):
            values[done : done + len(own), i] = _column(six, i, bridged[i][0], own, piece, sampling_hz)
            done += len(own)
    stops = np.cumsum([len(own) for own in times])
    return replace(
        six,
        t_ns=np.concatenate(times),
        values=values,
        stretches=tuple(Rate(float(sampling_hz), int(stop)) for stop in stops),
        skew_s=(0.0,) * 6,
        notes=notes,
        warnings=warnings,
    )


def sample_times(numbers: NDArray[np.int64], sampling_hz: int) -> NDArray[np.int64]:
    """``k * 1_000_000_000 // sampling_hz`` [ns], without overflow in a record that goes on for years."""
    seconds, rest = np.divmod(numbers, sampling_hz)
    return seconds * SECOND_NS + rest * SECOND_NS // sampling_hz


def sample_numbers(t_ns: NDArray[np.int64], sampling_hz: int) -> NDArray[np.int64]:
    """The first k whose time is not before ``t_ns``: of a sample's own time, its number."""
    seconds, rest = np.divmod(t_ns, SECOND_NS)
    return seconds * sampling_hz - (-rest * sampling_hz // SECOND_NS)


def _crop(six: SixChannels, window_s: tuple[float, float]) -> SixChannels:
    """The source's samples in the window, and a margin that the filters need."""
    lasts_s = float(six.t_ns[-1]) / SECOND_NS
    if not (0 <= window_s[0] < window_s[1] and window_s[0] < lasts_s):
        raise InputError(
            f"from {window_s[0]:g} s to {window_s[1]:g} s: the record lasts from 0 to {lasts_s:.6g} s",
            key="--from, --to",
        )
    begin, end = (int(min(edge, lasts_s) * SECOND_NS) for edge in window_s)
    first = int(np.searchsorted(six.t_ns, begin - _MARGIN_NS))
    stop = int(np.searchsorted(six.t_ns, end + _MARGIN_NS, side="right"))
    stretches = [Rate(rate.hz, min(rate.stop, stop) - first) for rate in six.stretches]
    before = [0, *(rate.stop for rate in stretches)]
    return replace(
        six,
        t_ns=six.t_ns[first:stop],
        values=six.values[first:stop],
        stretches=tuple(r for r, last in zip(stretches, before, strict=False) if r.stop > max(last, 0)),
    )


def _pieces(six: SixChannels, least_hz: float, shortest_s: float) -> list[Span]:
    """Where the samples are close enough together: first and one past the last of each piece."""
    t_ns = six.t_ns
    if least_hz <= 0:
        return [(0, len(t_ns))]
    limit_ns = 1.001 * SECOND_NS / least_hz
    broken = np.diff(t_ns) > limit_ns
    for column in six.values.T:
        known = np.flatnonzero(~np.isnan(column))
        if len(known) in (0, len(column)):
            continue
        edges = [0, *known.tolist(), len(column) - 1]
        for left in np.flatnonzero(np.diff(t_ns[edges]) > limit_ns):
            broken[edges[left] : edges[left + 1]] = True
    # The first sample after a break may be the last of a decimated stretch: an envelope's, an average's.
    edges = [-1, *(np.flatnonzero(broken) + 1).tolist(), len(t_ns)]
    found = [(a + 1, b) for a, b in pairwise(edges) if b - a - 1 >= 4]
    if len(found) == 1 and found[0] == (0, len(t_ns)):
        return found
    return [(a, b) for a, b in found if t_ns[b - 1] - t_ns[a] >= shortest_s * SECOND_NS]


def _times(
    t_ns: NDArray[np.int64], piece: Span, sampling_hz: int, window_s: tuple[float, float]
) -> NDArray[np.int64]:
    """The new times in a piece: from the first that is not before it to the last that is not after it."""
    first = -(-int(t_ns[piece[0]]) * sampling_hz // SECOND_NS)
    last = ((int(t_ns[piece[1] - 1]) + 1) * sampling_hz - 1) // SECOND_NS
    first = max(first, int(np.ceil(window_s[0] * sampling_hz - 1e-6)))
    if np.isfinite(window_s[1]):
        last = min(last, int(np.ceil(window_s[1] * sampling_hz - 1e-6)) - 1)
    if last - first >= MOST_SAMPLES:
        raise InputError(
            f"{(last - first) / sampling_hz:.6g} s at {sampling_hz} Hz are too much at once: "
            f"choose at most {MOST_SAMPLES // sampling_hz} s of it with --from and --to"
        )
    return sample_times(np.arange(first, last + 1, dtype=np.int64), sampling_hz)


def _told(t_ns: NDArray[np.int64], pieces: list[Span], least_hz: float) -> list[str]:
    """One line for each stretch that has no samples, if they are few."""
    if not pieces:
        return []
    edges = [(0, pieces[0][0])] if pieces[0][0] > 0 else []
    edges += [(a[1] - 1, b[0]) for a, b in pairwise(pieces)]
    edges += [(pieces[-1][1] - 1, len(t_ns) - 1)] if pieces[-1][1] < len(t_ns) else []
    told = []
    for first, last in edges[:_TOLD]:
        begin, end = float(t_ns[first]) / SECOND_NS, float(t_ns[last]) / SECOND_NS
        hz = SECOND_NS / float(np.median(np.diff(t_ns[first : last + 1])))
        what = f"{hz:.4g} samples/s" if hz < least_hz else "values missing"
        told.append(
            f"blank from {begin:.6g} to {end:.6g} s: {what}, and the relay needs {least_hz:g} samples/s; "
            "it starts anew after that"
        )
    if len(edges) > _TOLD:
        told.append(f"and {len(edges) - _TOLD} more blank stretches")
    return told


def _nothing(six: SixChannels, sampling_hz: int, least_hz: float, warnings: list[str]) -> str:
    lasts_s = float(six.t_ns[-1] - six.t_ns[0]) / SECOND_NS
    if lasts_s < 2 / sampling_hz:
        return f"lasts {1e3 * lasts_s:.3g} ms, less than two samples of a relay at {sampling_hz} Hz"
    hz = (len(six.t_ns) - 1) / lasts_s
    return f"{hz:.4g} samples/s, or values missing all the time: a relay needs {least_hz:g} samples/s"


def _bridge(t_ns: NDArray[np.int64], column: NDArray[np.float64]) -> tuple[NDArray[np.float64], int]:
    """The column without its gaps, and how many values that were; as it is if there is nothing in it."""
    gaps = ~np.isfinite(column)
    count = int(gaps.sum())
    if count in (0, len(column)):
        return column, 0
    return np.where(gaps, np.interp(t_ns, t_ns[~gaps], column[~gaps]), column), count


def _column(
    six: SixChannels, i: int, column: NDArray[np.float64], times: NDArray[np.int64], piece: Span, new_hz: int
) -> NDArray[np.float64]:
    """Channel ``i`` at new times in a piece."""
    a, b = piece
    if np.isnan(column).all():
        return np.full(len(times), np.nan)
    if six.skew_s[i] == 0.0 and len(times) == b - a and np.abs(times - six.t_ns[a:b]).max() <= 1:
        return column[a:b].copy()
    # From the piece's own beginning: a float keeps nanoseconds for a hundred days only.
    zero = int(six.t_ns[a])
    taken, new = six.t_ns[a:b] - zero + six.skew_s[i] * SECOND_NS, times - zero
    values, result = column[a:b], np.empty(len(times))
    first, done = 0, 0
    for hz, stop in _within(six.stretches, piece):
        begin = max(min(first - 1, stop - 4), 0)
        smooth = values[begin:stop].copy()
        smooth[first - begin :] = _limit_band(values[first:stop], hz, new_hz)
        spline = CubicSpline(taken[begin:stop], smooth)
        end = len(new) if stop == b - a else int(np.searchsorted(new, taken[stop - 1], side="right"))
        result[done:end] = spline(new[done:end])
        first, done = stop, max(done, end)
    return result


def _within(stretches: tuple[Rate, ...], piece: Span) -> list[Rate]:
    """The stretches in a piece, their ends counted from its beginning."""
    a, b = piece
    found, last = [], a + 1  # a single sample has no rate of its own
    for rate in stretches:
        stop = min(rate.stop, b)
        if stop > last:
            found.append(Rate(rate.hz, stop - a))
            last = stop
    return found


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
