"""The .dat: one array of numbers per channel.

The `comtrade` package reads it field by field in Python; here NumPy and pyarrow do: 70 MB of ASCII in 2.7 s
against 16.5 s, 68 MB of binary in 1.2 s against 3.5 s (bench/comtrade_files.py).  The tests hold the two
against each other on every record.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from faultloop.errors import InputError
from faultloop.io.comtrade.config import Config
from faultloop.io.comtrade.rows import MISSING, read_rows

ASCII_MISSING = 99999
STAMP_MISSING = 0xFFFFFFFF


@dataclass(slots=True)
class Data:
    """The numbers of a .dat; stamps in counts, NaN where missing."""

    numbers: NDArray[np.int64]  # (samples,) of the samples, from 0
    stamps: NDArray[np.float64]  # (samples,)
    analog: list[NDArray[np.float64]]  # scaled by a and b
    status: list[NDArray[np.bool_]]
    numbered: bool = True  # False: the file's own numbers do not increase, and these are the rows' order


def read_data(content: bytes, config: Config) -> Data:
    """Take a .dat apart.  Raises InputError where it is not what the .cfg says."""
    read = _read_ascii if config.format == "ASCII" else _read_binary
    return read(content, config)


def _read_binary(content: bytes, config: Config) -> Data:
    rows = read_rows(content, config)
    words = np.ascontiguousarray(rows["status"].T)
    status = [(words[i >> 4] >> (i & 15) & 1).astype(bool) for i in range(len(config.status))]
    raw = np.ascontiguousarray(rows["analog"].T)  # one pass over the rows, then every channel is contiguous
    with np.errstate(invalid="ignore"):  # a signalling NaN is a NaN
        analog = [_scaled(raw[i].astype(float), i, config) for i in range(len(config.analog))]
    numbers = _numbers(rows["number"].astype(np.int64))
    if numbers is None:
        return Data(np.arange(len(rows)), _stamps(rows["stamp"]), analog, status, numbered=False)
    return Data(numbers, _stamps(rows["stamp"]), analog, status)


def _stamps(raw: NDArray[np.uint32]) -> NDArray[np.float64]:
    """Stamps that may count from the trigger, negative before it, or go on past 2**32.

    Both are one thing: the difference of two neighbours, taken as a signed number.  0xFFFFFFFF is "missing"
    but where it is the -1 between a lower and a higher one.
    """
    if not len(raw):
        return np.empty(0)
    if raw.max() < 1 << 31 and (raw[1:] > raw[:-1]).all():  # nearly every file's
        return raw.astype(float)
    steps = np.diff(raw).view(np.int32).astype(np.int64)
    first = int(raw[:1].view(np.int32)[0])
    stamps = (first + np.concatenate([[0], np.cumsum(steps)])).astype(float)
    rises = np.concatenate([[1], steps, [1]]) > 0
    missing = (raw == STAMP_MISSING) & ~(rises[:-1] & rises[1:])
    stamps[missing] = np.nan
    return stamps


def _read_ascii(content: bytes, config: Config) -> Data:
    import pyarrow as pa
    from pyarrow import csv

    content = content.removeprefix(b"\xef\xbb\xbf").rstrip(b"\x1a\x00 \t\r\n")
    if not content.isascii():
        place = next(i for i, byte in enumerate(content) if byte > 0x7F)
        raise InputError(f"byte {content[place]:#04x} at {place}: an ASCII .dat has none above 0x7f")
    analog, status = len(config.analog), len(config.status)
    columns = 2 + analog + status
    names = [str(i) for i in range(columns)]
    if content:
        first = content[: content.find(b"\n") if b"\n" in content else None].rstrip()
        names += ["trailing"] * (first.count(b",") == columns and first.endswith(b","))
    wrong: list[str] = []

    def skip(row: csv.InvalidRow) -> str:
        wrong.append(
            f"a row of {row.actual_columns} values where {columns} are due: '{(row.text or '')[:40]}'"
        )
        return "skip"

    try:
        table = csv.read_csv(
            pa.py_buffer(content + b"\n"),
            read_options=csv.ReadOptions(column_names=names),
            parse_options=csv.ParseOptions(quote_char=False, invalid_row_handler=skip),
            convert_options=csv.ConvertOptions(column_types=dict.fromkeys(names[:columns], pa.float64())),
        )
    except pa.ArrowInvalid as error:
        raise InputError(f"not the numbers of an ASCII .dat: {str(error).splitlines()[0]}") from error
    if wrong and len(wrong) + table.num_rows >= config.samples:
        raise InputError(wrong[0])
    if table.num_rows < config.samples:
        raise InputError(f"cut off: {config.samples} samples expected, {table.num_rows} found")
    samples = config.samples or table.num_rows
    values = [table.column(i).to_numpy()[:samples] for i in range(columns)]
    numbers = _numbers(values[0])
    return Data(
        np.arange(samples) if numbers is None else numbers,
        values[1],
        [_scaled(np.array(values[2 + i]), i, config) for i in range(analog)],
        [np.nan_to_num(values[2 + analog + i]) != 0 for i in range(status)],
        numbers is not None,
    )


def _numbers(values: NDArray) -> NDArray[np.int64] | None:
    """Sample numbers from 0; None where the file's numbers do not increase from row to row."""
    if not len(values) or not (np.abs(values) <= STAMP_MISSING).all():  # a NaN is not, either
        return None
    numbers = values.astype(np.int64) - int(values[0])
    return numbers if (np.diff(numbers) > 0).all() else None


def _scaled(raw: NDArray[np.float64], index: int, config: Config) -> NDArray[np.float64]:
    """a * raw + b, NaN where missing: what a recorder divides by zero is missing, too."""
    channel = config.analog[index]
    missing = raw == _missing(config, channel.least)
    with np.errstate(over="ignore", invalid="ignore"):
        raw *= channel.a
        raw += channel.b
        total = raw.sum()
    if missing.any() or not np.isfinite(total):
        raw[missing | ~np.isfinite(raw)] = np.nan
    return raw


def _missing(config: Config, least: float) -> float:
    """The raw value that stands for none.

    1991 has an empty field in ASCII and FFFF in binary; that is -1, too, and an ordinary value where values
    can be negative: so it is missing only in a channel that is stated to have no negative values.
    """
    if config.revision != "1991":
        return ASCII_MISSING if config.format == "ASCII" else MISSING[config.format]
    return -1.0 if config.format == "BINARY" and least >= 0 else np.nan
