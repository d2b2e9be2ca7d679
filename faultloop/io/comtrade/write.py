"""Write a COMTRADE record: revision 1999 or 2013, .cfg with .dat or .cff."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from datetime import datetime, timedelta
from itertools import chain
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from faultloop.errors import InputError, nearest
from faultloop.io.comtrade.config import FORMATS
from faultloop.io.comtrade.data import ASCII_MISSING
from faultloop.io.comtrade.record import SECOND_NS, AnalogChannel, Record
from faultloop.io.comtrade.rows import ANALOG_TYPES, MISSING
from faultloop.io.output_file import OutputFiles

# Greatest raw value: symmetric about zero, and the value that stands for "missing" left out.
_FULL_SCALE = {"ASCII": 99_998, "BINARY": 2**15 - 1, "BINARY32": 2**31 - 1}
_STAMP_LIMIT = 2**32 - 2
REVISIONS = ("1999", "2013")
ROWS = 1 << 15  # written at a time


@dataclass(slots=True)
class _Scaled:
    """How a channel is written: value = a * raw + b."""

    a: float
    b: float
    least: float
    greatest: float
    values: NDArray[np.float64]
    missing: float
    dtype: type

    def raw(self, part: slice) -> NDArray:
        """Raw values of some samples."""
        values = self.values[part]
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
    _check(path, record, revision, format)
    stamps, multiplier, nanoseconds = _stamps(record, revision)
    scaled = [_scale(channel, format) for channel in record.analog]
    config = _config_text(record, revision, format, scaled, multiplier, nanoseconds).encode("utf-8")
    rows = _ascii_rows if format == "ASCII" else _binary_rows(format)
    parts = [slice(k, min(k + ROWS, len(record))) for k in range(0, len(record), ROWS)]
    data = (rows(record, stamps, scaled, part) for part in parts)
    if path.suffix.lower() == ".cff":
        size = len(rows(record, stamps, scaled, slice(0, 1))) * len(record)
        kind = "DAT ASCII" if format == "ASCII" else f"DAT {format}: {size}"
        head = [_heading("CFG"), config, _heading("INF"), b"\r\n", _heading("HDR"), b"\r\n", _heading(kind)]
        return _write_files(path, {path: chain(head, data)})
    upper = path.suffix.isupper()
    return _write_files(path, {path.with_suffix(".DAT" if upper else ".dat"): data, path: [config]})


def _heading(kind: str) -> bytes:
    return f"--- file type: {kind} ---\r\n".encode("ascii")


def _check(path: Path, record: Record, revision: str, format: str) -> None:
    suffix = path.suffix.lower()
    if suffix not in (".cfg", ".cff"):
        raise InputError("the name of a COMTRADE record must end in .cfg or .cff", file=path)
    if revision not in REVISIONS:
        raise InputError(
            f"'{revision}' cannot be written: it must be 1999 or 2013", file=path, key="revision"
        )
    if format not in FORMATS:
        raise InputError(f"no data format '{format}': {nearest(format, FORMATS)}", file=path, key="format")
    texts = [record.station, record.device]
    for channel in (*record.analog, *record.status):
        texts += [channel.name, channel.phase, channel.circuit]
        if len(channel.values) != len(record):
            raise InputError(
                f"{len(channel.values)} values, but {len(record)} times", file=path, key=channel.name
            )
    texts += [channel.unit for channel in record.analog]
    if record.rates and record.rates[-1].stop != len(record):
        raise InputError(f"the rates are of {record.rates[-1].stop} samples, not {len(record)}", file=path)
    for text in texts:
        if any(mark in text for mark in ",\r\n\x1a"):
            raise InputError(f"{text!r} has a comma or a line break, which a .cfg cannot keep", file=path)


def _stamps(record: Record, revision: str) -> tuple[NDArray[np.int64], int, bool]:
    """Time stamps [counts], the multiplication factor of a count, and whether its base is nanoseconds.

    Microseconds, as 1999 has them; more where the record is longer than 71 minutes.  2013 may state times in
    nanoseconds, which it does if those of the record need it.
    """
    duration_us = int(record.t_ns[-1]) // 1000 if len(record) else 0
    count_us = duration_us // _STAMP_LIMIT + 1
    nanoseconds = revision == "2013" and (record.start_ns % 1000 != 0 or record.trigger_ns % 1000 != 0)
    count_ns = count_us * 1000
    stamps = (record.t_ns + count_ns // 2) // count_ns
    return stamps, count_ns if nanoseconds else count_us, nanoseconds


def _scale(channel: AnalogChannel, format: str) -> _Scaled:
    values = channel.values
    present = values[~np.isnan(values)]
    if not np.isfinite(present).all():
        raise InputError("a value is infinite", key=channel.name)
    if format == "FLOAT32":
        limit = float(np.finfo(np.float32).max)
        if len(present) and np.abs(present).max() >= limit:
            raise InputError(f"a value does not fit into FLOAT32 (+-{limit:.3g})", key=channel.name)
        return _Scaled(1.0, 0.0, -limit, limit, values, MISSING["FLOAT32"], np.float32)
    full = _FULL_SCALE[format]
    low, high = (float(present.min()), float(present.max())) if len(present) else (0.0, 0.0)
    b = low / 2 + high / 2
    a = max(high / 2 - low / 2, 0.0) / full
    if a < np.finfo(float).tiny:  # a constant: b alone says it
        a = 1.0
    missing = ASCII_MISSING if format == "ASCII" else MISSING[format]
    return _Scaled(a, b, -full, full, values, missing, np.int64)


def _config_text(
    record: Record, revision: str, format: str, scaled: list[_Scaled], multiplier: int, nanoseconds: bool
) -> str:
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
    lines += [f"{_number(rate.hz)},{rate.stop}" for rate in record.rates] or [f"0,{len(record)}"]
    lines += [_time_line(record.start_ns, nanoseconds), _time_line(record.trigger_ns, nanoseconds)]
    lines += [format, str(multiplier)]
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


_Rows = Callable[[Record, NDArray[np.int64], list[_Scaled], slice], bytes]
"""Some samples as they stand in a .dat."""


def _binary_rows(format: str) -> _Rows:
    def write(record: Record, stamps: NDArray[np.int64], scaled: list[_Scaled], part: slice) -> bytes:
        words = -(-len(record.status) // 16)
        kind = [("number", "<u4"), ("stamp", "<u4"), ("analog", ANALOG_TYPES[format], (len(scaled),))]
        numbers = np.arange(len(record))[part] + 1
        rows = np.zeros(len(numbers), [*kind, ("status", "<u2", (words,))])
        rows["number"], rows["stamp"] = numbers, stamps[part]
        for i, channel in enumerate(scaled):
            rows["analog"][:, i] = channel.raw(part)
        for i, channel in enumerate(record.status):
            rows["status"][:, i // 16] |= channel.values[part].astype(np.uint16) << (i % 16)
        return rows.tobytes()

    return write


def _ascii_rows(record: Record, stamps: NDArray[np.int64], scaled: list[_Scaled], part: slice) -> bytes:
    import pyarrow as pa
    from pyarrow import csv

    columns = [np.arange(len(record))[part] + 1, stamps[part], *(channel.raw(part) for channel in scaled)]
    columns += [channel.values[part].astype(np.int8) for channel in record.status]
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
