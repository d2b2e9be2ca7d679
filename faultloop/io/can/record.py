"""Frames and messages as records: what the kernels of the bus and of its nodes work on."""

from __future__ import annotations

from struct import Struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

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
        ("values", "f8", (7,)),
    ],
    align=True,
)
"""Any message of a node: a state, a heartbeat, a page of measurements, the currents of a line end."""

Record = Any
"""One element of a structured array, in a kernel."""
Records = Any
"""A structured array: its elements have fields that no type checker knows."""

_FRAME, _MESSAGE = Struct("<10q64s"), Struct("<12q7d")
Bytes = NDArray[np.uint8]
"""The bytes of one record.  Python calls a kernel with them within 1 us, with a record itself, whose type
numba must find out, within 14."""


def put(frames: Records, place: int, frame: Any) -> None:
    """Write a `Frame` into an array of ``FRAME``."""
    head = (frame.id, len(frame.data), frame.extended, frame.fd, frame.brs)
    _FRAME.pack_into(frames, place * FRAME.itemsize, *head, 0, 0, 0, 0, 0, frame.data)


def taken(frames: Records, place: int) -> tuple[int, bytes, bool, bool, bool]:
    """The fields of a `Frame` out of an array of ``FRAME``."""
    return delivered(frames, place)[2]


def delivered(frames: Records, place: int) -> tuple[int, int, tuple[int, bytes, bool, bool, bool]]:
    """Time, number of the sender and the fields of a `Frame`."""
    identifier, length, extended, fd, brs, sender, t_ns, _, _, _, data = _FRAME.unpack_from(
        frames, place * FRAME.itemsize
    )
    return t_ns, sender, (identifier, data[:length], extended != 0, fd != 0, brs != 0)


def new_frame(frame: Any = None) -> Bytes:
    """The bytes of a ``FRAME``; empty where none is given."""
    raw = np.zeros(FRAME.itemsize, np.uint8)
    if frame is not None:
        put(raw, 0, frame)
    return raw


def new_message(*fields: float) -> Bytes:
    """The bytes of a ``MESSAGE`` with its first fields, in their order; the others are 0."""
    raw: Any = np.empty(MESSAGE.itemsize, np.uint8)
    _MESSAGE.pack_into(raw, 0, *fields, *_ZEROS[len(fields) :])
    return raw


def message_fields(message: Any) -> tuple[Any, ...]:
    """All fields of a ``MESSAGE``, the values last."""
    return _MESSAGE.unpack(message)


_ZEROS = (0,) * 12 + (0.0,) * 7
