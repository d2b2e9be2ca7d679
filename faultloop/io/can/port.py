"""The CAN port of a node, as kernels: messages into protected frames, and frames into messages.

A refused frame is told by a number (`codes`).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from faultloop.io.can.codes import CRC, FINE, FORMAT, LENGTH, UNKNOWN_ID, VALUE
from faultloop.io.can.differential import encode_set
from faultloop.io.can.e2e import P01_COUNTERS, crc8
from faultloop.io.can.record import FRAME, MESSAGE, Bytes, Record
from faultloop.io.can.table import BY_IDENTIFIER, TICK_NS, Kind
from faultloop.io.can.time_sync import TIME_SYNC, encode_time
from faultloop.jit import njit

TRIP, CLOSE, PILOT, TRANSFER, BREAKER_STATUS = (
    int(kind) for kind in (Kind.TRIP, Kind.CLOSE, Kind.PILOT, Kind.TRANSFER, Kind.BREAKER_STATUS)
)
DIFFERENTIAL = int(Kind.DIFFERENTIAL)
MEASUREMENTS, HEARTBEAT = int(Kind.MEASUREMENTS), int(Kind.HEARTBEAT)
STATE_BYTES = 8
NOBODY = -1

VOLTAGE, CURRENT, FREQUENCY = range(3)
"""Pages of measurements."""
PAGE_SCALES = np.array(  # unit of the last bit, least and greatest raw value, raw value of a NaN
    [
        [[10.0, 0, 65535, 0]] * 3,
        [[1.0, 0, 65535, 0]] * 3,
        [[1e-3, 0, 65535, 0], [1e-2, -32767, 32767, 0], [1e-3, -32767, 32767, -32768]],
    ]
)


def _kinds() -> NDArray[np.int64]:
    kinds = np.full(1 << 11, NOBODY, np.int64)
    for identifier, (kind, _) in BY_IDENTIFIER.items():
        kinds[identifier] = kind
    return kinds


_KINDS = _kinds()


@njit
def kind_of(identifier: int) -> int:
    """First identifier of the kind of message, `NOBODY` where it is none of ours."""
    return _KINDS[identifier] if 0 <= identifier < _KINDS.shape[0] else int(np.int64(NOBODY))


@njit
def ticks(t_ns: int) -> int:
    """Time since the run's start [ns] as a `time` signal (10 us, u32, wrapping)."""
    return t_ns // TICK_NS & 0xFFFFFFFF


@njit
def encode(m: Record, frame: Record) -> None:
    """A ``MESSAGE`` as the ``FRAME`` that carries it."""
    if m.kind == DIFFERENTIAL:
        encode_set(m, frame)
        return
    if m.kind == TIME_SYNC:
        encode_time(m, frame)
        return
    frame.id = m.kind + m.number
    frame.length = STATE_BYTES
    frame.extended = 0
    frame.fd = 0
    frame.brs = 0
    if m.kind == HEARTBEAT:
        _encode_heartbeat(m, frame.data)
    elif m.kind == MEASUREMENTS:
        _encode_measurements(m, frame.data)
    else:
        _encode_state(m, frame)


@njit
def encode_bytes(message: Bytes, frame: Bytes) -> None:
    """`encode` for whoever is not compiled."""
    encode(message.view(MESSAGE)[0], frame.view(FRAME)[0])


@njit
def state_payload(
    identifier: int, counter: int, poles: int, test: bool, st_num: int, sq_num: int, time: int
) -> int:
    """The 8 bytes of a state's frame as an int64, the first byte the least significant."""
    body = counter << 8 | poles << 12 | int(np.int64(test)) << 15
    body |= (st_num & 0xFF) << 16 | (sq_num & 0xFF) << 24 | time << 32
    return body | _crc(identifier, body)


@njit
def state_fields(identifier: int, payload: int) -> tuple[int, int, int, int, int, int, int]:
    """Objection, counter, poles, test, state and sequence number, time of a `state_payload`."""
    counter = payload >> 8 & 0x0F
    objection = FINE
    if payload & 0xFF != _crc(identifier, payload):
        objection = CRC
    elif counter >= P01_COUNTERS:
        objection = VALUE
    poles, test = payload >> 12 & 7, payload >> 15 & 1
    st_num, sq_num, time = payload >> 16 & 0xFF, payload >> 24 & 0xFF, payload >> 32 & 0xFFFFFFFF
    return objection, counter, poles, test, st_num, sq_num, time


@njit(heap=True)
def _crc(identifier: int, payload: int) -> int:
    data = np.empty(STATE_BYTES, np.uint8)
    _put(data, 0, payload, STATE_BYTES)
    return crc8(identifier, data, STATE_BYTES)


@njit
def _put(data: NDArray[np.uint8], place: int, value: int, count: int) -> None:
    """Least significant byte first."""
    for i in range(count):
        data[place + i] = value >> 8 * i & 0xFF


@njit
def _encode_state(m: Record, frame: Record) -> None:
    payload = state_payload(frame.id, m.counter, m.poles, m.test != 0, m.st_num, m.sq_num, m.time)
    _put(frame.data, 0, payload, STATE_BYTES)


@njit
def _encode_heartbeat(m: Record, data: NDArray[np.uint8]) -> None:
    data[0] = m.state
    data[1] = m.alarms
    _put(data, 2, min(m.rejected, 0xFFFF), 2)
    _put(data, 4, m.time, 4)


@njit
def _encode_measurements(m: Record, data: NDArray[np.uint8]) -> None:
    data[0] = m.page
    data[1] = m.counter & 0xFF
    for i in range(3):
        value, scale = m.values[i], PAGE_SCALES[m.page, i]
        raw = scale[3] if math.isnan(value) else min(max(value / scale[0], scale[1]), scale[2])
        _put(data, 2 + 2 * i, np.int64(np.rint(raw)), 2)


@njit
def decode_state(frame: Record, m: Record) -> int:
    """The state message in a frame, or why there is none."""
    kind = kind_of(frame.id)
    if kind == NOBODY or frame.extended:
        return UNKNOWN_ID if kind == NOBODY else FORMAT
    if frame.fd:
        return FORMAT
    if frame.length != STATE_BYTES:
        return LENGTH
    payload = np.int64(0)
    for i in range(STATE_BYTES):
        payload |= np.int64(frame.data[i]) << 8 * i
    objection, counter, poles, test, st_num, sq_num, time = state_fields(frame.id, payload)
    if objection != FINE:
        return objection
    m.kind = kind
    m.number = frame.id - kind
    m.counter = counter
    m.poles = poles
    m.test = test
    m.st_num = st_num
    m.sq_num = sq_num
    m.time = time
    return FINE
