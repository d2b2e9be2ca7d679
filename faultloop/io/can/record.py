"""Frames and messages as records: what the kernels of the bus and of its nodes work on."""

from __future__ import annotations

from struct import Struct
from typing import Any

import numpy as np

LONGEST = 64
"""Bytes of the longest frame."""

FRAME = np.dtype(
    [
        ("id", "i8"),
        ("length", "i8"),
        ("extended", "i8"),
        ("fd", "i8"),
        ("brs", "i8"),
        ("sender", "i8"),  # number of the node
        ("t_ns", "i8"),  # of submission, then of reception
        ("arbitration", "i8"),
        ("order", "i8"),  # of submission
        ("duration_ns", "i8"),  # on the wire
        ("data", "u1", (LONGEST,)),
    ],
    align=True,
)
"""A frame, and what the bus knows of it."""

MESSAGE = np.dtype(
    [
        ("kind", "i8"),  # `Kind`
        ("number", "i8"),  # of the relay, breaker or node
        ("time", "i8"),  # of sending, in ticks
        ("counter", "i8"),
        ("poles", "i8"),  # of a state: these five
        ("st_num", "i8"),
        ("sq_num", "i8"),
        ("test", "i8"),
        ("state", "i8"),  # of a heartbeat: these three
        ("alarms", "i8"),
        ("rejected", "i8"),
        ("page", "i8"),  # of measurements: these two
        ("values", "f8", (3,)),
    ],
    align=True,
)
"""Any message of a node: a state, a heartbeat, a page of measurements."""

Record = Any
"""One element of a structured array, in a kernel."""
Records = Any
"""A structured array: its elements have fields that no type checker knows."""

_HEAD = Struct("<5q")
_DATA: int = (FRAME.fields or {})["data"][1]


def put(frames: Records, place: int, frame: Any) -> None:
    """Write a `Frame` into an array of ``FRAME``."""
    raw = frames[place : place + 1].view(np.uint8)
    _HEAD.pack_into(raw.data, 0, frame.id, len(frame.data), frame.extended, frame.fd, frame.brs)
    raw[_DATA : _DATA + len(frame.data)] = np.frombuffer(frame.data, np.uint8)


def taken(frames: Records, place: int) -> tuple[int, bytes, bool, bool, bool]:
    """The fields of a `Frame` out of an array of ``FRAME``."""
    raw = frames[place : place + 1].view(np.uint8).data
    identifier, length, extended, fd, brs = _HEAD.unpack_from(raw)
    return identifier, bytes(raw[_DATA : _DATA + length]), bool(extended), bool(fd), bool(brs)
