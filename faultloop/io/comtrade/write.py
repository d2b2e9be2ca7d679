"""Write a COMTRADE record: revision 1999 or 2013, .cfg with .dat or .cff."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from itertools import chain
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from faultloop.errors import InputError, nearest
from faultloop.io.comtrade.config import FORMATS
from faultloop.io.comtrade.data import ASCII_MISSING
from faultloop.io.comtrade.record import SECOND_NS, Record
from faultloop.io.comtrade.rows import ANALOG_TYPES, MISSING
from faultloop.io.output_file import OutputFiles

# Greatest raw value: symmetric about zero, and the value that stands for "missing" left out.
_FULL_SCALE = {"ASCII": 99_998, "BINARY": 2**15 - 1, "BINARY32": 2**31 - 1}
_STAMP_LIMIT = 2**32 - 2
REVISIONS = ("1999", "2013")
ROWS = 1 << 15  # written at a time


class Block(NamedTuple):
    """Consecutive rows of a record: times since its first [ns] (n,); values and states by channel (n,)."""

    t_ns: NDArray[np.int64]
    analog: Sequence[NDArray[np.float64]]
    status: Sequence[NDArray[np.bool_]]


class Extent:
    """What has to be known of all rows of a record before its first can be written.

    Attributes
    ----------
    count, last_ns : number of rows, time of the last.
    low, high : (channels,) least and greatest value; +-inf of a channel without any.
    """

    def __init__(self, channels: int) -> None:
        self.count = self.last_ns = 0
        self.low, self.high = np.full(channels, np.inf), np.full(channels, -np.inf)

    def take(self, block: Block) -> None:
        if not len(block.t_ns):
            return
        self.count += len(block.t_ns)
        self.last_ns = int(block.t_ns[-1])
        for channel, values in enumerate(block.analog):
            self.low[channel] = np.fmin(self.low[channel], np.fmin.reduce(values))
            self.high[channel] = np.fmax(self.high[channel], np.fmax.reduce(values))


@dataclass(slots=True)
class _Scaled:
    """How a channel is written: value = a * raw + b."""

    a: float
    b: float
    least: float
    greatest: float
    missing: float
    dtype: type

    def raw(self, values: NDArray[np.float64]) -> NDArray:
        absent = np.isnan(values)
        with np.errstate(invalid="ignore"):
            counts = (values - self.b) / self.a
            if self.dtype is np.int64:
                counts = np.clip(np.rint(counts), self.least, self.greatest)
        return np.where(absent, self.missing, counts).astype(self.dtype)


def write_comtrade(
    path: Path | str, record: Record, revision: str = "2013", format: str = "BINARY"
) -> list[Path]:
    """Write a record.

    Parameters
    ----------
    path : ``.cfg``, beside which the ``.dat`` is put, or ``.cff``.
    record : what to write; its values are scaled channel by channel to the full range of the format.
    revision : "1999" or "2013".
    format : "ASCII", "BINARY", "BINARY32" or "FLOAT32".  The standard gives 1999 only the first two and no
        ``.cff``; readers take the others all the same.

    Returns the files written.  They are written aside and renamed, the .cfg last: there is no .cfg without
    its whole .dat.  A value read back differs by at most half a step, which is the channel's range divided by
    199996 (ASCII), 65534 (BINARY) or 4.3e9 (BINARY32); FLOAT32 keeps 24 bits of it.

    Raises
    ------
    InputError : revision, format and suffix do not go together, a name has a comma or a line break, a value
        does not fit, or the files cannot be written.
    """
    path = Path(path)
    for channel in (*record.analog, *record.status):
        if len(channel.values) != len(record):
            raise InputError(
                f"{len(channel.values)} values, but {len(record)} times", file=path, key=channel.name
            )
    extent = Extent(len(record.analog))
    for block in _blocks(record):
        extent.take(block)
    return write_blocks(path, record, extent, _blocks(record), (revision, format))


def _blocks(record: Record) -> Iterator[Block]:
    for first in range(0, len(record), ROWS):
        part = slice(first, first + ROWS)
        analog = [channel.values[part] for channel in record.analog]
        yield Block(record.t_ns[part], analog, [channel.values[part] for channel in record.status])


def write_blocks(
    path: Path | str, head: Record, extent: Extent, blocks: Iterable[Block], kind: tuple[str, str]
) -> list[Path]:
    """Write a record that need not be in memory at once, as ``write_comtrade`` does.

    Parameters
    ----------
    head : the record; its times and its channels' values are not looked at.
    extent : of all of ``blocks``, which follow each other.
    kind : revision and format.
    """
    path, (revision, format) = Path(path), kind
    check_kind(path, revision, format)
    _check_head(path, head, extent.count)
    clock = _Clock.of(head, extent, revision)
    scaled = [
        _scale(channel.name, format, float(low), float(high))
        for channel, low, high in zip(head.analog, extent.low, extent.high, strict=True)
    ]
    config = _config_text(head, extent.count, kind, scaled, clock).encode("utf-8")
    data = _data(blocks, scaled, clock, None if format == "ASCII" else _row_type(head, format))
    if path.suffix.lower() == ".cff":
        size = _row_type(head, format).itemsize * extent.count if format != "ASCII" else 0
        dat = "DAT ASCII" if format == "ASCII" else f"DAT {format}: {size}"
        before = [_heading("CFG"), config, _heading("INF"), b"\r\n", _heading("HDR"), b"\r\n", _heading(dat)]
        return _write_files(path, {path: chain(before, data)})
    upper = path.suffix.isupper()
    return _write_files(path, {path.with_suffix(".DAT" if upper else ".dat"): data, path: [config]})


def _heading(kind: str) -> bytes:
    return f"--- file type: {kind} ---\r\n".encode("ascii")


def check_kind(path: Path, revision: str, format: str) -> None:
    """Raises InputError where no record of this kind can get this name."""
    if path.suffix.lower() not in (".cfg", ".cff"):
        raise InputError("the name of a COMTRADE record must end in .cfg or .cff", file=path)
    if revision not in REVISIONS:
        raise InputError(
            f"'{revision}' cannot be written: it must be 1999 or 2013", file=path, key="revision"
        )
    if format not in FORMATS:
        raise InputError(f"no data format '{format}': {nearest(format, FORMATS)}", file=path, key="format")


def _check_head(path: Path, head: Record, count: int) -> None:
    texts = [head.station, head.device]
    for channel in (*head.analog, *head.status):
        texts += [channel.name, channel.phase, channel.circuit]
    texts += [channel.unit for channel in head.analog]
    if head.rates and head.rates[-1].stop != count:
        raise InputError(f"the rates are of {head.rates[-1].stop} samples, not {count}", file=path)
    for text in texts:
        if any(mark in text for mark in ",\r\n\x1a"):
            raise InputError(f"{text!r} has a comma or a line break, which a .cfg cannot keep", file=path)


class _Clock(NamedTuple):
    """Microseconds, as 1999 has them; more where the record is longer than 71 minutes.  2013 may state times
    in nanoseconds, which it does if those of the record need it."""

    count_us: int
    """What a time stamp counts."""
    nanoseconds: bool
    """Whether the .cfg's times have them; the multiplication factor's base then is a nanosecond, too."""

    @classmethod
    def of(cls, record: Record, extent: Extent, revision: str) -> _Clock:
        nanoseconds = revision == "2013" and (record.start_ns % 1000 != 0 or record.trigger_ns % 1000 != 0)
        return cls(extent.last_ns // 1000 // _STAMP_LIMIT + 1, nanoseconds)

    @property
    def multiplier(self) -> int:
        return self.count_us * 1000 if self.nanoseconds else self.count_us

    def stamps(self, t_ns: NDArray[np.int64]) -> NDArray[np.int64]:
        count_ns = self.count_us * 1000
        return (t_ns + count_ns // 2) // count_ns


def _scale(name: str, format: str, low: float, high: float) -> _Scaled:
    if low > high:  # no value at all
        low = high = 0.0
    if not (np.isfinite(low) and np.isfinite(high)):
        raise InputError("a value is infinite", key=name)
    if format == "FLOAT32":
        limit = float(np.finfo(np.float32).max)
        if max(-low, high) >= limit:
            raise InputError(f"a value does not fit into FLOAT32 (+-{limit:.3g})", key=name)
        return _Scaled(1.0, 0.0, -limit, limit, MISSING["FLOAT32"], np.float32)
    full = _FULL_SCALE[format]
    b = low / 2 + high / 2
    a = max(high / 2 - low / 2, 0.0) / full
    if a < np.finfo(float).tiny:  # a constant: b alone says it
        a = 1.0
    missing = ASCII_MISSING if format == "ASCII" else MISSING[format]
    return _Scaled(a, b, -full, full, missing, np.int64)


def _config_text(
    record: Record, count: int, kind: tuple[str, str], scaled: list[_Scaled], clock: _Clock
) -> str:
    revision, format = kind
    lines = [
        f"{record.station},{record.device},{revision}",
        f"{len(record.analog) + len(record.status)},{len(record.analog)}A,{len(record.status)}D",
    ]
    for i, (channel, s) in enumerate(zip(record.analog, scaled, strict=True), 1):
        primary, secondary = channel.ratio if min(channel.ratio) > 0 else (1.0, 1.0)
        lines.append(
            f"{i},{channel.name},{channel.phase},{channel.circuit},{channel.unit},{_number(s.a)},{_number(s.b)},"
            f"{_number(channel.skew_s * 1e6)},{_number(s.least)},{_number(s.greatest)},"
            f"{_number(primary)},{_number(secondary)},{channel.scale or 'P'}"
        )
    for i, channel in enumerate(record.status, 1):
        lines.append(f"{i},{channel.name},{channel.phase},{channel.circuit},{channel.normal}")
    lines.append(_number(record.frequency_hz))
    lines.append(str(len(record.rates)))
    lines += [f"{_number(rate.hz)},{rate.stop}" for rate in record.rates] or [f"0,{count}"]
    lines += [_time_line(t_ns, clock.nanoseconds) for t_ns in (record.start_ns, record.trigger_ns)]
    lines += [format, str(clock.multiplier)]
    if revision == "2013":
        quality = record.time_quality
        lines += [f"{quality.time_code},{quality.local_code}", f"{quality.quality},{quality.leap_second}"]
    return "\r\n".join(lines) + "\r\n"


def _number(value: float) -> str:
    """As short as it can be without losing a bit."""
    return str(int(value)) if value == int(value) and abs(value) < 1e15 else repr(float(value))


def _time_line(t_ns: int, nanoseconds: bool) -> str:
    seconds, rest = divmod(t_ns, SECOND_NS)
    fraction = f"{rest:09}" if nanoseconds else f"{rest // 1000:06}"
    return (datetime(1970, 1, 1) + timedelta(seconds=seconds)).strftime("%d/%m/%Y,%H:%M:%S.") + fraction


def _row_type(head: Record, format: str) -> np.dtype:
    """A row of a binary .dat."""
    words = -(-len(head.status) // 16)
    kind = [("number", "<u4"), ("stamp", "<u4"), ("analog", ANALOG_TYPES[format], (len(head.analog),))]
    return np.dtype([*kind, ("status", "<u2", (words,))])


def _data(
    blocks: Iterable[Block], scaled: list[_Scaled], clock: _Clock, row_type: np.dtype | None
) -> Iterator[bytes]:
    """The rows as they stand in a .dat: binary of this type, or ASCII."""
    first = 1
    for block in blocks:
        numbers = np.arange(first, first + len(block.t_ns))
        first += len(numbers)
        stamps = clock.stamps(block.t_ns)
        raw = [channel.raw(values) for channel, values in zip(scaled, block.analog, strict=True)]
        if row_type is None:
            yield _ascii_rows([numbers, stamps, *raw, *(states.astype(np.int8) for states in block.status)])
        else:
            rows = np.zeros(len(numbers), row_type)
            rows["number"], rows["stamp"] = numbers, stamps
            for i, values in enumerate(raw):
                rows["analog"][:, i] = values
            for i, states in enumerate(block.status):
                rows["status"][:, i // 16] |= states.astype(np.uint16) << (i % 16)
            yield rows.tobytes()


def _ascii_rows(columns: list[NDArray]) -> bytes:
    import pyarrow as pa
    from pyarrow import csv

    table = pa.table([pa.array(column) for column in columns], names=[str(i) for i in range(len(columns))])
    sink = pa.BufferOutputStream()
    csv.write_csv(table, sink, csv.WriteOptions(include_header=False))
    return sink.getvalue().to_pybytes().replace(b"\n", b"\r\n")


def _write_files(path: Path, contents: Mapping[Path, Iterable[bytes]]) -> list[Path]:
    with OutputFiles(path) as files:
        for name, parts in contents.items():
            with files.new(name).open("wb") as stream:
                for part in parts:
                    stream.write(part)
    return list(contents)
