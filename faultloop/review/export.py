"""A log in the formats of other tools: COMTRADE, CAN logs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from faultloop.errors import InputError, nearest
from faultloop.io.can.frames import Frame
from faultloop.io.can.log import LoggedFrame, write_can_log
from faultloop.io.comtrade.record import AnalogChannel, Rate, Record, StatusChannel
from faultloop.io.comtrade.write import Block, Extent, check_kind, write_blocks
from faultloop.io.mcap_reader import Log
from faultloop.io.messages import (
    BREAKER_STATUS,
    CAN_FRAME,
    CHANNELS,
    ELEMENTS,
    RECORD_DIGITAL,
    SAMPLED_VALUES,
)
from faultloop.io.output_file import missing_folders
from faultloop.loop.recorded import recorded_scenario
from faultloop.review.rows import RelayRows, relay_rows
from faultloop.review.summary import find_inception

SECOND_NS = 1_000_000_000


def log_to_comtrade(
    log: Log, path: Path, *, relay: str | None = None, revision: str = "2013", format: str = "FLOAT32"
) -> list[Path]:
    """Sampled values of one relay or of all; element bits and breaker poles as status channels.

    Values are primary.  The trigger is the fault's inception: as the plant tells it, else as the samples show
    it, else the first pickup; the first sample where there is none.  Returns the files written; raises
    InputError where the log has no such relay or no samples.
    """
    if relay is not None and relay not in log.relays:
        raise InputError(f"no relay '{relay}'; {nearest(relay, log.relays)}", file=log.path, key="--relay")
    check_kind(path, revision, format)
    names = log.relays if relay is None else (relay,)
    if not names:
        raise InputError("holds no sampled values to export", file=log.path)
    measured = _Measured(len(names))
    for rows in _rows(log, names):
        measured.take(rows)
    if not measured.extent.count:
        raise InputError("holds no sampled values to export", file=log.path)
    bits = _bits(log, names, measured.ever)
    states = [*_poles(log), *_digital(log)]
    head = Record(
        t_ns=np.empty(0, np.int64),
        analog=[channel for name in names for channel in _analog(name)],
        status=[StatusChannel(f"{bit.relay} {bit.name}", NO_STATES, circuit=bit.relay) for bit in bits]
        + [state.channel for state in states],
        rates=measured.rates,
        start_ns=log.start_ns + measured.first_ns,
        trigger_ns=log.start_ns + _trigger_ns(log, measured),
        frequency_hz=_frequency(log),
        station=_one_line(recorded_scenario(log)["scenario"].get("name", log.path.stem)),
        device="faultloop",
    )
    blocks = (
        Block(
            rows[0].t_ns - measured.first_ns,
            _columns(rows),
            [bit.states(rows) for bit in bits] + [state.states(rows[0].t_ns) for state in states],
        )
        for rows in _rows(log, names)
    )
    with missing_folders(path.parent):
        return write_blocks(path, head, measured.extent, blocks, (revision, format))


def log_to_can(log: Log, path: Path) -> list[Path]:
    """The CAN frames as ``.blf``, ``.asc`` or candump ``.log``."""
    frames = (
        LoggedFrame(
            log.start_ns + entry.t_ns,
            Frame(entry.id, entry.data, entry.extended, entry.fd, entry.fd),
            entry.direction == "tx",
        )
        for span in log.stretches()
        for entry in log.entries(CAN_FRAME, from_ns=span[0], to_ns=span[1])
    )
    return [write_can_log(path, frames)]


def _rows(log: Log, names: Sequence[str]) -> Iterator[list[RelayRows]]:
    """Relays' samples and elements, stretch by stretch, at the times at which any of them was sampled: one
    may have been away for a while, or a run cut off."""
    for span in log.stretches():
        found = [relay_rows(log, name, *span, kinds=(SAMPLED_VALUES, ELEMENTS)) for name in names]
        t_ns = found[0].t_ns
        if any(not np.array_equal(rows.t_ns, t_ns) for rows in found):
            t_ns = np.unique(np.concatenate([rows.t_ns for rows in found]))
        if len(t_ns):
            yield [rows.at(t_ns) for rows in found]


class _Measured:
    """What has to be known of all rows before the first is written.

    Attributes
    ----------
    extent : of the analog channels.
    ever : per relay, the bits that ever were on, of ``pickup`` and of ``operate``.
    first_ns : time of the first row [ns since the run's start].
    """

    def __init__(self, relays: int) -> None:
        self.extent = Extent(relays * len(CHANNELS))
        self.ever = [(0, 0)] * relays
        self.first_ns = 0
        self._usual_ns = np.nan
        self._longest_ns = 0

    def take(self, rows: Sequence[RelayRows]) -> None:
        t_ns = rows[0].t_ns
        if not self.extent.count:
            self.first_ns = int(t_ns[0])
            self._usual_ns = float(np.median(np.diff(t_ns))) if len(t_ns) > 1 else np.nan
        steps = np.diff(t_ns, prepend=self.first_ns + self.extent.last_ns)
        self._longest_ns = max(self._longest_ns, int(steps.max()))
        self.extent.take(Block(t_ns - self.first_ns, _columns(rows), ()))
        for place, own in enumerate(rows):
            words = (int(np.bitwise_or.reduce(word)) for word in (own.pickup, own.operate))
            pickup, operate = (old | new for old, new in zip(self.ever[place], words, strict=True))
            self.ever[place] = pickup, operate

    @property
    def rates(self) -> tuple[Rate, ...]:
        """The sampling rate; none, so that the stamps count, where samples are left out."""
        count, last_ns = self.extent.count, self.extent.last_ns
        if count < 2:
            return (Rate(1.0, count),)
        if self._longest_ns > 1.5 * self._usual_ns:
            return ()
        return (Rate(float(round((count - 1) * SECOND_NS / last_ns)), count),)


def _columns(rows: Sequence[RelayRows]) -> list[NDArray[np.float64]]:
    return [column for own in rows for column in own.samples.T]


@dataclass(frozen=True)
class _Bit:
    """A bit of a relay's element words."""

    place: int
    """Of the relay among those exported."""
    relay: str
    name: str
    word: str
    bit: int

    def states(self, rows: Sequence[RelayRows]) -> NDArray[np.bool_]:
        word: NDArray[np.uint64] = getattr(rows[self.place], self.word)
        return (word >> np.uint64(self.bit) & np.uint64(1)).astype(bool)


@dataclass(frozen=True)
class _Changing:
    """A state that is told when it changes."""

    channel: StatusChannel
    t_ns: list[int]
    on: list[bool]
    before: bool
    """Its state until it is told."""

    def states(self, t_ns: NDArray[np.int64]) -> NDArray[np.bool_]:
        return np.array([self.before, *self.on])[np.searchsorted(self.t_ns, t_ns, side="right")]


NO_STATES = np.empty(0, bool)


def _trigger_ns(log: Log, measured: _Measured) -> int:
    """The inception, where it is in the record."""
    first_ns, found = measured.first_ns, find_inception(log).t_ns
    inside = found is not None and first_ns <= found <= first_ns + measured.extent.last_ns
    return found if found is not None and inside else first_ns


def _one_line(text: str) -> str:
    """A name without what a .cfg cannot keep."""
    return "".join(" " if mark in ",\r\n\x1a" else mark for mark in text)


def _analog(name: str) -> list[AnalogChannel]:
    return [
        AnalogChannel(
            name=f"{name} {channel.upper()}",
            values=np.empty(0),
            unit="V" if channel[0] == "v" else "A",
            phase=channel[1].upper(),
            circuit=name,
        )
        for channel in CHANNELS
    ]


def _bits(log: Log, names: Sequence[str], ever: Sequence[tuple[int, int]]) -> list[_Bit]:
    """Those element bits that were ever on."""
    return [
        _Bit(place, relay, name, word, bit)
        for place, relay in enumerate(names)
        for (word, bits), on in zip(log.bits(relay).items(), ever[place], strict=True)
        for bit, name in enumerate(bits)
        if on >> bit & 1
    ]


def _digital(log: Log) -> list[_Changing]:
    """A replayed record's own digital channels."""
    found: dict[int, _Changing] = {}
    for entry in log.walk(RECORD_DIGITAL):
        channel = StatusChannel(entry.name, NO_STATES, circuit="record", normal=int(entry.normal))
        own = found.setdefault(entry.number, _Changing(channel, [], [], before=False))
        own.t_ns.append(entry.t_ns)
        own.on.append(bool(entry.on))
    return list(found.values())


def _poles(log: Log) -> list[_Changing]:
    """Each breaker's poles, on where closed."""
    found = []
    for breaker in log.breakers:
        entries = [e for e in log.walk(BREAKER_STATUS) if e.topic == f"/breaker/{breaker}"]
        t_ns = [entry.t_ns for entry in entries]
        for pole in "abc":
            channel = StatusChannel(f"{breaker} {pole.upper()}", NO_STATES, pole.upper(), breaker, 1)
            closed = [bool(entry.fields[f"pole_{pole}"]) for entry in entries]
            found.append(_Changing(channel, t_ns, closed, before=True))
    return found


def _frequency(log: Log) -> float:
    return float(recorded_scenario(log)["system"].get("frequency_hz", 0))
