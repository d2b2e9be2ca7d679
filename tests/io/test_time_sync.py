"""SYNC and follow-up on the wire: by the definition of the CRC, by cantools, and what is refused."""

from __future__ import annotations

import cantools
import numpy as np
import pytest

from faultloop.io.can.dbc import DBC_PATH
from faultloop.io.can.frames import Frame, Rejection, TimeSync, decode
from faultloop.io.can.time_sync import crc8h2f


def crc_by_bits(data: bytes) -> int:
    """CRC-8H2F as AUTOSAR's CRC library has it, bit by bit."""
    crc = 0xFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc << 1 ^ 0x2F if crc & 0x80 else crc << 1) & 0xFF
    return crc ^ 0xFF


def test_the_crc_has_its_check_value() -> None:
    assert crc_by_bits(b"123456789") == 0xDF
    assert crc8h2f(np.frombuffer(b"12345678", np.uint8), 0, 8, ord("9")) == 0xDF


@pytest.mark.parametrize(
    "message",
    [
        TimeSync(False, 0, 0),
        TimeSync(False, 15, 0xFFFFFFFF, domain=15),
        TimeSync(True, 3, 999_999_999, overflow=2, domain=4),
        TimeSync(True, 7, 123_456_789),
    ],
)
def test_there_and_back_and_by_cantools(message: TimeSync) -> None:
    frame = message.encode()
    assert (frame.id, len(frame.data), frame.fd) == (0x0F0, 8, False)
    assert decode(frame) == message
    signals = cantools.database.load_file(DBC_PATH).decode_message(0x0F0, frame.data)
    key = "nanoseconds" if message.follow_up else "seconds"
    assert signals["page"] == ("FOLLOW_UP" if message.follow_up else "SYNC")
    assert (signals[key], signals["sequence"], signals["domain"]) == (
        message.time,
        message.sequence,
        message.domain,
    )
    assert signals.get("overflow", 0) == message.overflow
    last = message.sequence + (0x10 if message.follow_up else 0)
    assert frame.data[1] == crc_by_bits(bytes([*frame.data[2:], last]))
    assert frame.data[4:] == message.time.to_bytes(4, "big")


def test_what_is_refused() -> None:
    good = TimeSync(True, 3, 1234).encode()
    for bit in range(8 * 8):
        data = bytearray(good.data)
        data[bit // 8] ^= 1 << bit % 8
        assert decode(good._replace(data=bytes(data))) in (Rejection.CRC, Rejection.VALUE), bit
    plain = bytes((0x10, *good.data[1:]))  # SYNC without CRC
    assert decode(good._replace(data=plain)) is Rejection.VALUE
    assert decode(good._replace(fd=True)) is Rejection.FORMAT
    assert decode(Frame(0x0F0, good.data[:7])) is Rejection.LENGTH
