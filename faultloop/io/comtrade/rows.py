"""The rows of a binary .dat: taken apart only where their length is the one that the file has.

A binary row has no mark of its own.  Its sample number is the check: at the right length the numbers count;
at any other they are pieces of values.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from faultloop.errors import InputError
from faultloop.io.comtrade.config import Config

FLOAT32_MISSING = -np.finfo(np.float32).max  # 0xFF7FFFFF
ANALOG_TYPES = {"BINARY": "<i2", "BINARY32": "<i4", "FLOAT32": "<f4"}
MISSING = {"BINARY": -32768, "BINARY32": -(2**31), "FLOAT32": FLOAT32_MISSING}
_TRIED = 200
"""Rows whose numbers must count, one by one, for a length to be called the file's."""


def row_type(config: Config, format: str | None = None) -> np.dtype:
    """A row of a binary .dat: number, stamp, analog values, status bits in words of 16."""
    words = -(-len(config.status) // 16)
    return np.dtype(
        [
            ("number", "<u4"),
            ("stamp", "<u4"),
            ("analog", ANALOG_TYPES[format or config.format], (len(config.analog),)),
            ("status", "<u2", (words,)),
        ]
    )


def read_rows(content: bytes, config: Config) -> NDArray[np.void]:
    """The rows of the file, as many as the .cfg says, or all where it says 0.

    Raises
    ------
    InputError : fewer rows than stated; rows of another length than the .cfg has (with the length that fits,
        where there is one); values of another kind.
    """
    kind = row_type(config)
    found = len(content) // kind.itemsize
    rows = np.frombuffer(content, kind, config.samples or found) if found >= config.samples else None
    if rows is None or not _count_by_one(rows["number"]):
        fitting = _fitting_length(content, kind.itemsize)
        if fitting is not None and fitting != kind.itemsize:
            raise InputError(_misfit(content, config, kind.itemsize, fitting))
        if rows is None:
            raise InputError(f"cut off: {config.samples} samples expected, {found} found")
        if fitting is None and not _increase(rows["number"]) and not _increase(rows["stamp"].view("<i4")):
            _refuse_unless_blank(rows, config, kind.itemsize)
    if not (np.diff(rows["number"]) == 1).all():  # nearly every file's do count
        _check_alignment(rows["number"], kind.itemsize)
    _check_kind(rows["analog"], config.format)
    return rows


def _count_by_one(numbers: NDArray[np.uint32]) -> bool:
    """True where the numbers count 1, 2, 3 but for a few breaks: lost samples, a counter that starts anew."""
    steps = np.diff(numbers)  # unsigned: they are only compared with 1
    return int(np.count_nonzero(steps == 1)) >= 0.95 * len(steps)


def _check_alignment(numbers: NDArray[np.uint32], length: int) -> None:
    """Bytes lost or put in between leave every later row a piece of two: its number is no neighbour's.

    A counter that starts anew, or at 16 bits, jumps once.  Read a byte too early, a number that counts by one
    counts by 256.
    """
    steps = np.diff(numbers.astype(np.int64))
    usual = int(np.median(steps)) if len(steps) else 0
    shifted = (steps > 0) & (steps % 256 == 0)
    wild = np.flatnonzero((steps < 0) | (steps > 1000 * max(usual, 1)) | shifted)
    if usual > 0 and len(wild) > 2 + len(steps) // 1000:
        row = int(wild[0]) + 1
        raise InputError(
            f"from row {row + 1} on, at byte {row * length}, the sample numbers do not count: "
            "bytes are missing there, or too many"
        )


def _increase(numbers: NDArray) -> bool:
    """True where the numbers go up by regular steps (a decimated stretch counts in fives)."""
    steps = np.diff(numbers.astype(np.int64))
    if len(steps) == 0:
        return True
    _, counts = np.unique(steps, return_counts=True)
    # A stamp's steps are rounded: 417, 416, 417.  Pieces of values have nearly as many steps as rows.
    return int(np.count_nonzero(steps > 0)) >= 0.95 * len(steps) and len(counts) <= max(4, len(steps) // 8)


def _refuse_unless_blank(rows: NDArray[np.void], config: Config, length: int) -> None:
    """Some recorders fill neither number nor stamp: then they are all the same."""
    if all((rows[name] == rows[name][0]).all() for name in ("number", "stamp")):
        return
    raise InputError(
        f"rows of {length} bytes ({_what(config)}) do not fit: their sample numbers do not count (1, 2, 3 ..)"
    )


def _fitting_length(content: bytes, length: int) -> int | None:
    """The shortest row length [bytes] at which the numbers count; None where there is none."""
    for tried in range(8, min(2 * length + 128, len(content) // 3 + 1)):
        count = min(len(content) // tried, _TRIED)
        numbers = np.ndarray((count,), "<u4", content, 0, (tried,))
        if numbers[1] == numbers[0] + 1 and (np.diff(numbers.astype(np.int64)) == 1).all():
            return tried
    return None


def _misfit(content: bytes, config: Config, length: int, fitting: int) -> str:
    others = [name for name in ANALOG_TYPES if row_type(config, name).itemsize == fitting]
    more = fitting - length
    if others:
        reason = f", as {' or '.join(others)} has them"
    elif more % 2 == 0 and config.format == "BINARY":
        reason = (
            f": {abs(more) // 2} {'more' if more > 0 else 'less'} of analog values and words of status bits"
        )
    else:
        reason = ""
    return (
        f"rows of {length} bytes ({_what(config)}) do not fit: their sample numbers do not count; "
        f"rows of {fitting} bytes do ({len(content) // fitting} of them{reason})"
    )


def _what(config: Config) -> str:
    return f"{config.format}, {len(config.analog)} analog, {len(config.status)} status"


def _check_kind(analog: NDArray, format: str) -> None:
    """32-bit integers and floats have rows of one length: an AC signal of one is none in the other.

    Small integers are denormal floats or, below zero, NaN; floats of ordinary size are all integers of 7e8 to
    1.5e9, which no AC signal is.
    """
    if format not in ("BINARY32", "FLOAT32") or analog.size == 0:
        return
    integers = np.ascontiguousarray(analog).view("<i4").ravel()
    integers = integers[(integers != 0) & (integers != MISSING["BINARY32"])]
    with np.errstate(invalid="ignore"):
        size = np.abs(integers.view("<f4"))
        ordinary = np.count_nonzero((size > 1e-12) & (size < 1e12))
        none = np.count_nonzero(~(size > 1e-30))
    if len(integers) < 100:
        return
    if format == "FLOAT32" and none > 0.5 * len(integers):
        raise InputError("the values are no FLOAT32: most are too small or no number; BINARY32 perhaps")
    if format == "BINARY32" and ordinary > 0.99 * len(integers) and (integers < 0).any():
        raise InputError("the values are no BINARY32: as FLOAT32 all have an ordinary size; as integers none")
