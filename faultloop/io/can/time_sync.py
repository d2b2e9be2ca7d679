"""TIME_SYNC frames: SYNC and follow-up of AUTOSAR's CanTSyn (Specification of Time Synchronization over CAN,
document 674, R20-11), both with CRC; 8 bytes, big endian.

    byte 0      1     2                     3              4-7
    SYNC 0x20   CRC   domain, sequence      0              seconds of the time base at T0
    FUP  0x28   CRC   the same as its SYNC  SGW << 2 | OVS nanoseconds from there to T1, but OVS seconds

T1 is when the SYNC frame has ended on the bus: every node stamps that by its own clock.  The CRC is CRC-8H2F
over bytes 2 to 7 and then the data id of the sequence.

A ``MESSAGE`` of this kind: ``page`` the type, ``counter`` the sequence, ``st_num`` the domain, ``time``
seconds or nanoseconds, ``alarms`` byte 3 (SGW is 0: no gateway is between the master and this bus).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from faultloop.io.can.codes import CRC, FINE, FORMAT, LENGTH, VALUE
from faultloop.io.can.e2e import table_of_one_byte
from faultloop.io.can.record import FRAME, MESSAGE, Bytes, Record
from faultloop.io.can.table import Kind
from faultloop.jit import njit

TIME_SYNC = int(Kind.TIME_SYNC)
BYTES = 8
SYNC, FOLLOW_UP = 0x20, 0x28
SEQUENCES = 16
OVERFLOW = 3
"""Bits of a follow-up's seconds."""
_STEP = table_of_one_byte(0x2F)


@njit
def data_id(page: int, sequence: int) -> int:
    """DataIDList: 0x00 to 0x0F of SYNC, 0x10 to 0x1F of follow-ups."""
    return sequence if page == SYNC else 0x10 + sequence


@njit
def crc8h2f(data: NDArray[np.uint8], first: int, end: int, last: int) -> int:
    """CRC-8H2F (polynomial 0x2F, start and final XOR 0xFF) over some bytes, and then one more."""
    crc = np.int64(0xFF)
    for k in range(first, end):
        crc = np.int64(_STEP[crc ^ np.int64(data[k])])
    return int(np.int64(_STEP[crc ^ last]) ^ 0xFF)


@njit
def encode_time(m: Record, frame: Record) -> None:
    """The frame of a SYNC or a follow-up."""
    data = frame.data
    frame.id = TIME_SYNC
    frame.length = BYTES
    frame.extended = 0
    frame.fd = 0
    frame.brs = 0
    data[0] = m.page
    data[2] = m.st_num << 4 | m.counter
    data[3] = m.alarms
    for k in range(4):
        data[4 + k] = m.time >> 8 * (3 - k) & 0xFF
    data[1] = crc8h2f(data, 2, BYTES, data_id(m.page, m.counter))


@njit
def decode_time(frame: Record, m: Record) -> int:
    """The message in a frame of this kind, or why there is none."""
    if frame.extended or frame.fd:
        return FORMAT
    if frame.length != BYTES:
        return LENGTH
    data = frame.data
    page, sequence = np.int64(data[0]), np.int64(data[2]) & 0xF
    if page != SYNC and page != FOLLOW_UP:  # without CRC, of an offset time base, or none at all
        return VALUE
    if np.int64(data[1]) != crc8h2f(data, 2, BYTES, data_id(page, sequence)):
        return CRC
    m.kind = TIME_SYNC
    m.number = 0
    m.page = page
    m.counter = sequence
    m.st_num = np.int64(data[2]) >> 4
    m.alarms = data[3]
    time = np.int64(0)
    for k in range(4):
        time = time << 8 | np.int64(data[4 + k])
    m.time = time
    return FINE


@njit
def encode_time_bytes(message: Bytes, frame: Bytes) -> None:
    """`encode_time` for whoever is not compiled."""
    encode_time(message.view(MESSAGE)[0], frame.view(FRAME)[0])


@njit
def decode_time_bytes(frame: Bytes, message: Bytes) -> int:
    """`decode_time` for whoever is not compiled."""
    return decode_time(frame.view(FRAME)[0], message.view(MESSAGE)[0])
