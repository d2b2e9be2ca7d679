"""DIFFERENTIAL frames: the currents of one end of a line at one instant, 32 bytes on CAN FD.

A ``MESSAGE`` of this kind: ``time`` in microseconds of the sender's clock (modulo 2^32), ``counter``,
``poles`` the mask of phases that are valid, ``state`` how the clock is synchronized, ``alarms`` a mask of
`EXTERNAL`, `TRANSFERS`, `BARE`, ``page`` the counter of the last set that was heard of relay ``sq_num``,
``st_num`` how long before ``time`` that was [us] (0: nothing of late), ``rejected`` the hash of what both
ends agree on, ``values`` real and imaginary parts of ia ib ic [A RMS].
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from faultloop.io.can.codes import CRC, FINE, FORMAT, LENGTH
from faultloop.io.can.e2e import crc16
from faultloop.io.can.record import FRAME, MESSAGE, Bytes, Record
from faultloop.io.can.table import PHASOR_LSB, Kind
from faultloop.jit import njit

BYTES = 32
DIFFERENTIAL = int(Kind.DIFFERENTIAL)
EXTERNAL, TRANSFERS, BARE = 1, 2, 4
GREATEST = (1 << 23) - 1
"""Of 24 bits, signed."""


@njit
def put_number(data: NDArray[np.uint8], place: int, value: int, count: int) -> None:
    """Least significant byte first."""
    for i in range(count):
        data[place + i] = value >> 8 * i & 0xFF


@njit
def number_at(data: NDArray[np.uint8], place: int, count: int) -> int:
    """Least significant byte first, without a sign."""
    value = np.int64(0)
    for i in range(count):
        value |= np.int64(data[place + i]) << 8 * i
    return int(value)


@njit
def encode_set(m: Record, frame: Record) -> None:
    """The frame of a set; a value that is none takes its phase's validity away, one that is too large is
    limited."""
    data = frame.data
    frame.id = DIFFERENTIAL + m.number
    frame.length = BYTES
    frame.extended = 0
    frame.fd = 1
    frame.brs = 1
    valid = m.poles
    for k in range(6):
        value = m.values[k] / PHASOR_LSB
        if math.isnan(value):
            valid &= ~(1 << k // 2)
            value = 0.0
        raw = np.int64(np.rint(min(max(value, -GREATEST), GREATEST)))
        put_number(data, 8 + 3 * k, raw & 0xFFFFFF, 3)
    data[2] = m.counter & 0xFF
    flags = valid | m.state << 3 | (m.alarms & EXTERNAL) << 5 | (m.alarms & TRANSFERS) << 5
    data[3] = flags | m.test << 7
    put_number(data, 4, m.time, 4)
    data[26] = (m.alarms & BARE) >> 2 | (m.sq_num & 0xF) << 1
    data[27] = m.page
    put_number(data, 28, m.rejected, 2)
    put_number(data, 30, m.st_num, 2)
    put_number(data, 0, crc16(frame.id, data, BYTES), 2)


@njit
def decode_set(frame: Record, m: Record) -> int:
    """The set in a frame of this kind, or why there is none."""
    if frame.extended or not frame.fd:
        return FORMAT
    if frame.length != BYTES:
        return LENGTH
    data = frame.data
    if number_at(data, 0, 2) != crc16(frame.id, data, BYTES):
        return CRC
    flags = np.int64(data[3])
    m.kind = DIFFERENTIAL
    m.number = frame.id - DIFFERENTIAL
    m.counter = data[2]
    m.poles = flags & 7
    m.state = flags >> 3 & 3
    m.alarms = flags >> 5 & 3 | (data[26] & 1) << 2
    m.test = flags >> 7
    m.time = number_at(data, 4, 4)
    m.rejected = number_at(data, 28, 2)
    m.page = data[27]
    m.st_num = number_at(data, 30, 2)
    m.sq_num = data[26] >> 1 & 0xF
    for k in range(6):
        raw = number_at(data, 8 + 3 * k, 3)
        m.values[k] = (raw - (1 << 24) if raw >> 23 else raw) * PHASOR_LSB
    return FINE


@njit
def encode_set_bytes(message: Bytes, frame: Bytes) -> None:
    """`encode_set` for whoever is not compiled."""
    encode_set(message.view(MESSAGE)[0], frame.view(FRAME)[0])


@njit
def decode_set_bytes(frame: Bytes, message: Bytes) -> int:
    """`decode_set` for whoever is not compiled."""
    return decode_set(frame.view(FRAME)[0], message.view(MESSAGE)[0])
