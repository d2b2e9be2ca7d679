"""Frames to messages and back.

The messages of relays and breakers pass through the kernels of the `port`, sampled values through `struct`.
The tests hold these codecs against cantools with ``faultloop.dbc``, byte for byte.  `decode` never raises:
what is not a good frame of ours comes back as a `Rejection`.
"""

from __future__ import annotations

import math
from enum import Enum
from struct import Struct
from struct import error as StructError
from typing import NamedTuple

from faultloop.io.can import differential, port, time_sync
from faultloop.io.can.e2e import crc16_p05
from faultloop.io.can.record import Bytes, message_fields, new_frame, new_message, taken
from faultloop.io.can.table import BY_IDENTIFIER, BY_KIND, CURRENT_LSB, VOLTAGE_LSB, Kind


class Frame(NamedTuple):
    """A frame as it is on a bus; `brs`: its data phase runs at the data bit rate (CAN FD)."""

    id: int
    data: bytes
    extended: bool = False
    fd: bool = False
    brs: bool = False


class Rejection(Enum):
    """Why a frame is not acted upon; the value is the text for a log."""

    UNKNOWN_ID = "unknown identifier"
    FORMAT = "wrong frame format"  # extended, or FD where classic is due
    LENGTH = "wrong length"
    NOT_AUTHENTICATED = "plain, where only authenticated frames are taken"
    TAG = "wrong authentication tag"
    CRC = "wrong CRC"
    VALUE = "value out of range"
    TEST = "sent under test"
    STALE = "too old, or from the future"
    BEFORE_START = "sent before this node started"
    OLD = "older than one accepted before, or the same again"
    INCONSISTENT = "other poles under the same state number"
    SEQUENCE = "out of sequence, and no further frame confirms it yet"
    SETTINGS = "of an end that is set otherwise"
    JUMP = "a time that jumps"

    @property
    def code(self) -> int:
        """Its number in the kernels of the `port`."""
        return 1 + REJECTIONS.index(self)


REJECTIONS = tuple(Rejection)


def ticks(t_ns: int) -> int:
    """Time since the run's start [ns] as a `time` signal (10 us, u32, wrapping)."""
    return port.ticks(t_ns)


class State(NamedTuple):
    """A trip, close, pilot or breaker status message: one bit for each pole (A 1, B 2, C 4)."""

    kind: Kind
    number: int  # of the relay, or of the breaker
    poles: int
    st_num: int
    sq_num: int
    counter: int
    time: int  # of sending, in ticks
    test: bool = False

    def encode(self) -> Frame:
        """The frame that carries it."""
        kind, number, poles, st_num, sq_num, counter, time, test = self
        identifier = _BASE[kind] + number
        payload = port.state_payload(identifier, counter, poles, test, st_num, sq_num, time)
        return Frame(identifier, payload.to_bytes(port.STATE_BYTES, "little", signed=True))

    @property
    def fields(self) -> tuple[int, ...]:
        """The first ones of a ``MESSAGE``."""
        kind, number, poles, st_num, sq_num, counter, time, test = self
        return kind, number, time, counter, poles, st_num, sq_num, test

    @classmethod
    def of(cls, message: Bytes) -> State:
        """Of a ``MESSAGE``."""
        kind, number, time, counter, poles, st_num, sq_num, test, *_ = message_fields(message)
        return cls(_KINDS[kind], number, poles, st_num, sq_num, counter, time, bool(test))


class SampledValues(NamedTuple):
    """One sample of va vb vc ia ib ic [V, A primary]; a NaN travels as "not valid" and comes back as NaN."""

    number: int
    sample_count: int
    values: tuple[float, ...]
    counter: int = 0
    synchronized: int = 2

    def encode(self) -> Frame:
        """The frame that carries it."""
        identifier = Kind.SAMPLED_VALUES + self.number
        va, vb, vc, ia, ib, ic = self.values
        invalid = 0
        try:
            raw = _SIX.pack(
                round(va / VOLTAGE_LSB), round(vb / VOLTAGE_LSB), round(vc / VOLTAGE_LSB),
                round(ia / CURRENT_LSB), round(ib / CURRENT_LSB), round(ic / CURRENT_LSB),
            )  # fmt: skip
        except (
            StructError,
            ValueError,
            OverflowError,
        ):  # a value out of range, NaN or infinite: the rare way
            invalid, raw = self._limited()
        body = _SAMPLE_HEAD.pack(
            0, self.counter & 0xFF, invalid | self.synchronized << 6, self.sample_count & 0xFFFFFFFF
        )
        data = bytearray(body + raw)
        data[:2] = crc16_p05(identifier, data).to_bytes(2, "little")
        return Frame(identifier, bytes(data), fd=True, brs=True)

    def _limited(self) -> tuple[int, bytes]:
        invalid, raw = 0, []
        for i, (value, lsb) in enumerate(zip(self.values, _LSB, strict=True)):
            count = 0 if math.isnan(value) else min(max(value / lsb, -(2**31)), 2**31 - 1)
            if math.isnan(value) or count != value / lsb:
                invalid |= 1 << i
            raw.append(round(count))
        return invalid, _SIX.pack(*raw)


class Differential(NamedTuple):
    """Currents of a line end at an instant: ia ib ic [A RMS, complex] by the sender's clock; a NaN travels as
    not valid and comes back as 0."""

    number: int
    time: int  # of the sender's clock [us], modulo 2^32
    currents: tuple[complex, complex, complex]
    agreement: int = 0
    valid: int = 7
    synchronized: int = 2
    external: bool = False
    transfer: bool = False
    bare: bool = False
    counter: int = 0
    test: bool = False
    heard: int = 0
    ago: int = 0  # [us]
    whom: int = 0  # which relay was heard

    def encode(self) -> Frame:
        """The frame that carries it."""
        frame = new_frame()
        alarms = self.external | self.transfer << 1 | self.bare << 2
        parts = [part for i in self.currents for part in (i.real, i.imag)]
        head = (
            Kind.DIFFERENTIAL,
            self.number,
            self.time,
            self.counter,
            self.valid,
            self.ago,
            self.whom,
            self.test,
        )
        differential.encode_set_bytes(
            new_message(*head, self.synchronized, alarms, self.agreement, self.heard, *parts), frame
        )
        return Frame(*taken(frame, 0))


class Page(Enum):
    """What a measurements frame carries."""

    VOLTAGE = 0  # va vb vc [V RMS]
    CURRENT = 1  # ia ib ic [A RMS]
    FREQUENCY = 2  # frequency [Hz], its rate of change [Hz/s], fault location [pu of the line] or NaN


class Measurements(NamedTuple):
    """One page of a relay's measurements; a value out of range is limited."""

    number: int
    page: Page
    values: tuple[float, float, float]
    counter: int = 0

    def encode(self) -> Frame:
        """The frame that carries it."""
        head = (Kind.MEASUREMENTS, self.number, 0, self.counter)
        return _encoded(*head, *(0,) * 7, self.page.value, *self.values)


class Heartbeat(NamedTuple):
    """A node's sign of life: state as CANopen has it (5 operational), alarms, frames rejected so far."""

    number: int
    state: int
    alarms: int
    rejected: int
    time: int

    def encode(self) -> Frame:
        """The frame that carries it."""
        head = (Kind.HEARTBEAT, self.number, self.time)
        return _encoded(*head, *(0,) * 5, self.state, self.alarms, self.rejected)


class TimeSync(NamedTuple):
    """A SYNC, or the follow-up that belongs to it."""

    follow_up: bool
    sequence: int
    time: int  # seconds of T0, or nanoseconds from there to T1
    overflow: int = 0  # seconds of a follow-up, and 4 where a gateway has lost the master
    domain: int = 0

    def encode(self) -> Frame:
        """The frame that carries it."""
        page = time_sync.FOLLOW_UP if self.follow_up else time_sync.SYNC
        head = (Kind.TIME_SYNC, 0, self.time, self.sequence, 0, self.domain)
        return _encoded(*head, 0, 0, 0, self.overflow, 0, page)


Message = State | SampledValues | Measurements | Heartbeat | Differential | TimeSync

_SAMPLE_HEAD = Struct("<HBBI")
_SIX = Struct("<6i")
_HEARTBEAT = Struct("<BBHI")
_LSB = (VOLTAGE_LSB,) * 3 + (CURRENT_LSB,) * 3
_PAGES = {Page.VOLTAGE: Struct("<BB3H"), Page.CURRENT: Struct("<BB3H"), Page.FREQUENCY: Struct("<BBHhh")}


def _encoded(*fields: float) -> Frame:
    frame = new_frame()
    port.encode_bytes(new_message(*fields), frame)
    return Frame(*taken(frame, 0))


def decode(frame: Frame) -> Message | Rejection:
    """The message in a frame, or why there is none.  Any bytes will do; nothing is raised."""
    found = BY_IDENTIFIER.get(frame.id)
    if found is None or frame.extended:
        return Rejection.FORMAT if found else Rejection.UNKNOWN_ID
    kind, number = found
    length, fd = _SHAPE[kind]
    if frame.fd != fd:
        return Rejection.FORMAT
    if len(frame.data) != length:
        return Rejection.LENGTH
    return _DECODERS[kind](kind, number, frame)


def _decode_state(kind: Kind, number: int, frame: Frame) -> State | Rejection:
    payload = int.from_bytes(frame.data, "little", signed=True)
    objection, counter, poles, test, st_num, sq_num, time = port.state_fields(frame.id, payload)
    if objection:
        return REJECTIONS[objection - 1]
    return State(kind, number, poles, st_num, sq_num, counter, time, test != 0)


def _decode_sampled_values(kind: Kind, number: int, frame: Frame) -> SampledValues | Rejection:
    data = frame.data
    crc, counter, bits, sample_count = _SAMPLE_HEAD.unpack_from(data)
    if crc != crc16_p05(frame.id, data):
        return Rejection.CRC
    va, vb, vc, ia, ib, ic = _SIX.unpack_from(data, 8)
    values = (
        va * VOLTAGE_LSB, vb * VOLTAGE_LSB, vc * VOLTAGE_LSB,
        ia * CURRENT_LSB, ib * CURRENT_LSB, ic * CURRENT_LSB,
    )  # fmt: skip
    if bits & 0x3F:
        values = tuple(math.nan if bits >> i & 1 else value for i, value in enumerate(values))
    return SampledValues(number, sample_count, values, counter, bits >> 6)


def _decode_measurements(kind: Kind, number: int, frame: Frame) -> Measurements | Rejection:
    if frame.data[0] > Page.FREQUENCY.value:
        return Rejection.VALUE
    page = Page(frame.data[0])
    _, counter, *raw = _PAGES[page].unpack(frame.data)
    scales = port.PAGE_SCALES[page.value].tolist()
    first, second, third = (
        count * lsb if count >= low else math.nan for count, (lsb, low, _, _) in zip(raw, scales, strict=True)
    )
    return Measurements(number, page, (first, second, third), counter)


def _decode_differential(kind: Kind, number: int, frame: Frame) -> Differential | Rejection:
    message = new_message()
    objection = differential.decode_set_bytes(new_frame(frame), message)
    if objection:
        return REJECTIONS[objection - 1]
    fields = message_fields(message)
    _, _, time, counter, valid, ago, whom, test, synchronized, alarms, agreement, heard, *parts = fields
    a, b, c = (complex(*parts[2 * k : 2 * k + 2]) for k in range(3))
    bits = (bool(alarms & 1), bool(alarms & 2), bool(alarms & 4))
    return Differential(
        number, time, (a, b, c), agreement, valid, synchronized, *bits, counter, bool(test), heard, ago, whom
    )


def _decode_time(kind: Kind, number: int, frame: Frame) -> TimeSync | Rejection:
    message = new_message()
    objection = time_sync.decode_time_bytes(new_frame(frame), message)
    if objection:
        return REJECTIONS[objection - 1]
    _, _, time, sequence, _, domain, _, _, _, overflow, _, page, *_ = message_fields(message)
    return TimeSync(page == time_sync.FOLLOW_UP, sequence, time, overflow, domain)


def _decode_heartbeat(kind: Kind, number: int, frame: Frame) -> Heartbeat:
    return Heartbeat(number, *_HEARTBEAT.unpack(frame.data))


_KINDS = {int(kind): kind for kind in Kind}
_BASE = {kind: int(kind) for kind in Kind}
"""First identifiers: an enumeration's arithmetic takes as long as the frame."""
_SHAPE = {kind: (message.length, message.fd) for kind, message in BY_KIND.items()}
_DECODERS = {
    Kind.TRIP: _decode_state,
    Kind.CLOSE: _decode_state,
    Kind.PILOT: _decode_state,
    Kind.DIFFERENTIAL: _decode_differential,
    Kind.TRANSFER: _decode_state,
    Kind.BREAKER_FAILURE: _decode_state,
    Kind.TIME_SYNC: _decode_time,
    Kind.BREAKER_STATUS: _decode_state,
    Kind.SAMPLED_VALUES: _decode_sampled_values,
    Kind.MEASUREMENTS: _decode_measurements,
    Kind.HEARTBEAT: _decode_heartbeat,
}
