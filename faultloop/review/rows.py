"""One relay's part of a log on one time base, and the instants at which a person reads it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from faultloop.io.mcap_reader import Log
from faultloop.io.messages import (
    CHANNELS,
    ELEMENTS,
    LOOP_IMPEDANCES,
    LOOPS,
    PHASORS,
    SAMPLED,
    SAMPLED_VALUES,
    Message,
    values,
)

Times = NDArray[np.int64]
Span = tuple[int, int | None]
"""On and off [ns]; None where it lasts to the log's end."""


@dataclass(frozen=True)
class RelayRows:
    """What a relay saw and made of it; a row that the log does not have is NaN, or no bit.

    Attributes
    ----------
    t_ns : (n,) [ns since the run's start], increasing.
    samples : (n, 6) va vb vc ia ib ic [V, A].
    phasors : (n, 6) complex, RMS [V, A].
    frequency : (n,) [Hz].
    loops : (n, 6) complex, AG BG CG AB BC CA [ohm].
    pickup, operate : (n,) bit sets, named by ``bits``.
    """

    name: str
    t_ns: Times
    samples: NDArray[np.float64]
    phasors: NDArray[np.complex128]
    frequency: NDArray[np.float64]
    loops: NDArray[np.complex128]
    pickup: NDArray[np.uint64]
    operate: NDArray[np.uint64]
    bits: dict[str, tuple[str, ...]]

    def __len__(self) -> int:
        return len(self.t_ns)

    def at(self, t_ns: Times) -> RelayRows:
        """The same on a clock that has these times and more: NaN, and no bit, where there is no row."""
        if np.array_equal(t_ns, self.t_ns):
            return self
        place = np.searchsorted(t_ns, self.t_ns)

        def wider(array: np.ndarray, absent: float) -> np.ndarray:
            out = np.full((len(t_ns), *array.shape[1:]), absent, array.dtype)
            out[place] = array
            return out

        return RelayRows(
            self.name,
            t_ns,
            wider(self.samples, np.nan),
            wider(self.phasors, np.nan),
            wider(self.frequency, np.nan),
            wider(self.loops, np.nan),
            wider(self.pickup, 0),
            wider(self.operate, 0),
            self.bits,
        )

    def broken_at_gaps(self) -> RelayRows:
        """With a row of no numbers in each gap, so that no line is drawn across it."""
        steps = np.diff(self.t_ns)
        gaps = np.flatnonzero(steps > 1.5 * self.interval_ns)
        if not len(gaps):
            return self
        return self.at(np.sort(np.concatenate([self.t_ns, self.t_ns[gaps] + steps[gaps] // 2])))

    @property
    def interval_ns(self) -> float:
        """Sampling interval, the median of what the log has."""
        return float(np.median(np.diff(self.t_ns))) if len(self) > 1 else np.nan

    @property
    def sampling_hz(self) -> float:
        """From the whole record where it has no gap: the times themselves are rounded to 1 ns."""
        steps = np.diff(self.t_ns)
        if not len(steps) or np.ptp(steps) > 1:
            return round(1e9 / self.interval_ns, 3) if len(steps) else np.nan
        return round(len(steps) * 1e9 / float(self.t_ns[-1] - self.t_ns[0]), 3)

    @cached_property
    def spans(self) -> dict[str, list[Span]]:
        """When each bit that ever was on was on, by its IEC 61850 data name."""
        found: dict[str, list[Span]] = {}
        for word in ("pickup", "operate"):
            bits = getattr(self, word)
            ever = int(np.bitwise_or.reduce(bits)) if len(bits) else 0
            for place, name in enumerate(self.bits[word]):
                if name and ever >> place & 1:
                    on = (bits >> np.uint64(place) & np.uint64(1)).astype(bool)
                    found.setdefault(name, []).extend(spans_of(on, self.t_ns))
        return found

    def first_pickup(self) -> tuple[int, str] | None:
        """Time and name of the first element that started (``.Str``)."""
        starts = [(spans[0][0], name) for name, spans in self.spans.items() if name.endswith(".Str")]
        return min(starts, default=None)


def spans_of(on: NDArray[np.bool_], t_ns: Times) -> list[Span]:
    """Stretches in which ``on`` (n,) is true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], on, [False]]).astype(np.int8)))
    return [
        (int(t_ns[start]), int(t_ns[stop]) if stop < len(t_ns) else None)
        for start, stop in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
    ]


def relay_rows(
    log: Log,
    relay: str,
    from_ns: int | None = None,
    to_ns: int | None = None,
    kinds: Sequence[Message] = SAMPLED,
) -> RelayRows:
    """What the log has of ``relay`` between two times (the second not included; everything where they are not
    given), of some kinds of messages or all.  Raises InputError where its content is damaged."""
    span = () if from_ns is None and to_ns is None else (from_ns, to_ns)

    def rows(message: Message) -> np.ndarray | None:
        topic = message.topic_for(relay)
        return log.array(topic, *span) if topic in log.topics and message in kinds else None

    found = {message.name: rows(message) for message in SAMPLED}
    clocks = [array["t_ns"] for array in found.values() if array is not None]
    t_ns = clocks[0] if clocks else np.empty(0, np.int64)
    if any(not np.array_equal(t_ns, other) for other in clocks) or (np.diff(t_ns) <= 0).any():
        t_ns = np.unique(np.concatenate(clocks))

    def matrix(message: Message, columns: int) -> NDArray[np.float64]:
        array = found[message.name]
        if array is None:
            return np.broadcast_to(np.nan, (len(t_ns), columns))
        if len(array) == len(t_ns) and np.array_equal(array["t_ns"], t_ns):
            return values(array)
        out = np.full((len(t_ns), columns), np.nan)
        out[np.searchsorted(t_ns, array["t_ns"])] = values(array)
        return out

    words = np.zeros((2, len(t_ns)), np.uint64)
    elements = found[ELEMENTS.name]
    if elements is not None and len(elements):
        place = np.searchsorted(t_ns, elements["t_ns"])
        words[0, place], words[1, place] = elements["pickup"], elements["operate"]
    phasors = matrix(PHASORS, 2 * len(CHANNELS) + 2)
    bits = log.bits(relay) if elements is not None else {"pickup": (), "operate": ()}
    return RelayRows(
        relay,
        t_ns,
        matrix(SAMPLED_VALUES, len(CHANNELS)),
        _complex_pairs(phasors[:, :12]),
        phasors[:, 12],
        _complex_pairs(matrix(LOOP_IMPEDANCES, 2 * len(LOOPS))),
        words[0],
        words[1],
        bits,
    )


def _complex_pairs(pairs: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Real and imaginary parts side by side (n, 2 k) as (n, k); a view, where they lie so in memory."""
    return (
        pairs.copy().view(np.complex128) if pairs.strides[-1] != pairs.itemsize else pairs.view(np.complex128)
    )


def change_before(rows: RelayRows, pickup_ns: int, cycle_ns: float) -> int | None:
    """First sample at which the waves left their course of one cycle before, within four cycles of a pickup.

    The superimposed quantity x(t) - x(t - T) counts as a change where it exceeds five times what it was in
    the cycle before, and 5 % of the greatest change of the three voltages or currents up to the pickup; three
    samples in a row, so that one outlier is none.  None where nothing is found.
    """
    step = rows.interval_ns
    if not step > 0:
        return None
    cycle = max(round(cycle_ns / step), 1)
    stop = int(np.searchsorted(rows.t_ns, pickup_ns)) + 1
    start = max(stop - 4 * cycle, 2 * cycle)
    if start >= stop:
        return None
    x = rows.samples[start - 2 * cycle : stop]
    change = np.abs(x[cycle:] - x[:-cycle])
    before = change[:cycle].max(axis=0)
    greatest = np.repeat([change[:, :3].max(), change[:, 3:].max()], 3)
    beyond = change[cycle:] > np.maximum(5 * before, 0.05 * greatest)
    lasting = beyond[:-2] & beyond[1:-1] & beyond[2:]
    found = np.flatnonzero(lasting.any(axis=1))
    return int(rows.t_ns[start + found[0]]) if len(found) else None


def last_before(rows: RelayRows, t_ns: float) -> int | None:
    """Index of the last row before ``t_ns`` whose phasors are all numbers."""
    stop = int(np.searchsorted(rows.t_ns, t_ns))
    good = np.flatnonzero(np.isfinite(rows.phasors[:stop]).all(axis=1))
    return int(good[-1]) if len(good) else None


def steadiest(rows: RelayRows, start_ns: float, stop_ns: float, cycle_ns: float) -> int | None:
    """Index of the row in [start, stop) whose phasors moved least in the half cycle before it.

    The last one of those within 10 % of the least: the decaying offset is smallest there.  Rows that are not
    numbers are no candidates; None where there is none.
    """
    half = max(round(cycle_ns / 2 / rows.interval_ns), 1) if rows.interval_ns > 0 else 1
    first = int(np.searchsorted(rows.t_ns, start_ns))
    stop = int(np.searchsorted(rows.t_ns, stop_ns))
    window = rows.phasors[max(first - half, 0) : stop]
    good = np.asarray(np.isfinite(window).all(axis=1))
    if stop <= first or not good[first - stop :].any():
        return None
    if len(window) <= half:
        return first + int(np.flatnonzero(good[first - stop :])[-1])
    size = np.array([np.abs(window[good, k : k + 3]).max() for k in (0, 3)])
    scaled = window / np.repeat(np.where(size > 0, size, 1.0), 3)
    moved = np.abs(scaled[half:] - scaled[:-half]).max(axis=1)
    moved[~np.isfinite(moved)] = np.inf
    if not np.isfinite(moved).any():
        return first + int(np.flatnonzero(good[first - stop :])[-1])
    calm = np.flatnonzero(moved <= 1.1 * moved.min() + 1e-9)
    return stop - len(moved) + int(calm[-1])


def faulted_loop(
    rows: RelayRows, index: int, trips: Sequence[str], fault_type: str | None
) -> tuple[str, str] | None:
    """Name of the faulted loop at a row, and from what it is known; None where no loop is defined."""
    known = {"ABC": "BC", "ABCG": "BC", "ABG": "AB", "BCG": "BC", "CAG": "CA"}
    if trips and known.get(trips[0], trips[0]) in LOOPS:
        return known.get(trips[0], trips[0]), "trip"
    selected = [
        name.partition(".")[2]
        for place, name in enumerate(rows.bits["pickup"])
        if name.startswith("PHS") and int(rows.pickup[index]) >> place & 1
    ]
    if selected and selected[0] in LOOPS:
        return ("BC" if {"AB", "BC", "CA"} <= set(selected) else selected[0]), "phase selection"
    if fault_type is not None and known.get(fault_type, fault_type) in LOOPS:
        return known.get(fault_type, fault_type), "fault type"
    size = np.abs(rows.loops[index])
    if np.isnan(size).all():
        return None
    return LOOPS[int(np.nanargmin(size))], "smallest impedance"
