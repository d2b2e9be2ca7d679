"""Frames bit by bit: worked by hand, CRCs against crccheck, and where error flags begin."""

from __future__ import annotations

import pytest
from crccheck.crc import Crc15, Crc17CanFd, Crc21CanFd
from hypothesis import given, settings
from hypothesis import strategies as st

from faultloop.io.can.bits import CRC15, CRC17, CRC21, Crc, receivers_late, wire_bits
from faultloop.io.can.frames import Frame
from faultloop.io.can.length import FD_LENGTHS, wire_length

reproducible = settings(derandomize=True, deadline=None)
TAIL = "1 0 1 1111111".replace(" ", "")  # CRC delimiter, ACK slot and delimiter, end of frame
FRAMES = st.builds(
    lambda identifier, extended, fill, length, fd, brs: Frame(
        identifier if extended else identifier >> 18,
        (fill * 64)[: FD_LENGTHS[length] if fd else min(length, 8)],
        extended,
        fd,
        fd and brs,
    ),
    st.integers(0, 2**29 - 1) | st.just(0),
    st.booleans(),
    st.binary(min_size=1, max_size=64) | st.sampled_from([b"\x00", b"\xff", b"\x1f", b"\x83"]),
    st.integers(0, 15),
    st.booleans(),
    st.booleans(),
)


def bits(text: str) -> str:
    return text.replace(" ", "").replace("|", "")


def destuffed(stuffed: str) -> str:
    """The receiver's side: the bit after five equal ones goes, and must differ."""
    out, run = "", ""
    for bit in stuffed:
        if len(run) == 5:
            assert bit != run[0]
            run = bit
            continue
        run = run + bit if bit == run[:1] else bit
        out += bit
    return out


@pytest.mark.parametrize(
    ("crc", "peer", "check"),
    [(CRC15, Crc15, 0x59E), (CRC17, Crc17CanFd, 0x4F03), (CRC21, Crc21CanFd, 0xED841)],
)
def test_crcs_as_catalogued(crc: Crc, peer, check: int) -> None:
    """Check values of "123456789" in the catalogue of CRC algorithms, where they begin with zero."""
    text = "".join(f"{byte:08b}" for byte in b"123456789")
    assert int(crc._replace(initial=0).of(text), 2) == check == peer.calc(b"123456789")


@reproducible
@given(FRAMES)
def test_every_frame_is_whole(frame: Frame) -> None:
    """Taken apart as a receiver does it: stuffing, stuff count, CRC by crccheck, lengths."""
    wire, length = wire_bits(frame), wire_length(frame)
    assert (len(wire.bits) - len(wire.data_phase), len(wire.data_phase)) == length
    body, rest = wire.bits[: wire.stuffed], wire.bits[wire.stuffed :]
    content = destuffed(body)
    if not frame.fd:
        assert rest == TAIL
        # leading zeros change nothing in a CRC that begins with zero
        padded = int(content[:-15], 2).to_bytes((len(content) + 7) // 8, "big")
        assert Crc15.calc(padded) == int(content[-15:], 2)
        return
    assert rest.endswith(TAIL)
    field, plain = rest[: -len(TAIL)], ""
    for i in range(0, len(field), 5):
        assert field[i] != (body + field)[wire.stuffed + i - 1]
        plain += field[i + 1 : i + 5]
    count, parity, sequence = plain[:3], plain[3], plain[4:]
    # As ISO 11898-1 lists them: number of stuff bits modulo 8, Gray-coded, then even parity.
    listed = ["0000", "0011", "0110", "0101", "1100", "1111", "1010", "1001"]
    assert count + parity == listed[(len(body) - len(content)) % 8]
    peer, width = (Crc17CanFd, 17) if len(frame.data) <= 16 else (Crc21CanFd, 21)
    covered = int(body + plain[:4], 2)
    covered ^= 1 << (len(body) + 4 - 1)  # the initial value, a one at the top, turns the first bit over
    assert peer.calc(covered.to_bytes((len(body) + 11) // 8, "big")) == int(sequence, 2)
    assert len(sequence) == width


def test_base_frame_by_hand() -> None:
    """Identifier 1, no data.  CRC: x^22 modulo the generator, 2213 (worked in test_can_bus.py)."""
    wire = wire_bits(Frame(0x001, b""))
    # SOF and ID with stuff bits after 5 and 10 zeros | RTR, IDE, r0, DLC | CRC 010 0010 0001 0011
    assert wire.bits == bits("000001 000001 01 | 000001 00 | 010001000010011") + TAIL


def test_extended_frame_by_hand() -> None:
    """Identifier 0, no data: of the 39 bits only SRR and IDE are ones, 26 and 25 bits before the end.

    So the CRC is x^41 + x^40 modulo the generator.  From x^22 = 2213 on, doubled and reduced by C599 where it
    overflows: 4426 4DD5 5E33 79FF 3667 6CCE 1C05 380A 7014 25B1 4B62 535D 6323 03DF 07BE 0F7C 1EF8, then
    x^40 = 3DF0 and x^41 = 7BE0; their sum is 4610.
    """
    wire = wire_bits(Frame(0, b"", extended=True))
    head = bits("000001 000001 00 | 11 | 000001 000001 000001 000001 000001")
    assert wire.bits == head + bits("100 0110 0001 0000") + TAIL


def test_fd_frame_by_hand() -> None:
    """Identifier 0, FD with bit rate switch, one byte 0x00: three dynamic stuff bits.

    Stuff count 3: Gray 010, two ones with its parity.  The CRC field begins with a fixed stuff bit, opposite
    to the last data bit, and has one after each four bits.
    """
    wire = wire_bits(Frame(0, b"\x00", fd=True, brs=True))
    assert wire.bits.startswith(bits("000001 000001 0000 | 1 0 1 | 0 0001 | 000001 000 | 1 010 1 0"))
    assert wire.data_phase == range(19, 19 + 14 + 28)
    assert wire.fixed == (33, 38, 43, 48, 53, 58)
    slow = wire_bits(Frame(0, b"\x00", fd=True))
    assert slow.data_phase == range(0)
    assert slow.bits[:18] == wire.bits[:18]
    assert (wire.bits[18], slow.bits[18]) == ("1", "0")  # BRS


def test_flags_begin_where_a_rule_is_broken() -> None:
    """Identifier 1, no data: 000001 000001 01 000001 00 010001000010011 1 0 1 1111111."""
    wire = wire_bits(Frame(0x001, b""))
    # The stuff bit at 5 made dominant: the sixth zero, everybody sees it at once.
    assert receivers_late(wire, 5) == 0
    # The identifier's last bit, at 13, after a single zero, made dominant: two zeros, four of the flag.
    assert wire.bits[11:14] == "101"
    assert receivers_late(wire, 13) == 4
    # The zero before it made recessive: the flag must bring all six.
    assert receivers_late(wire, 12) == 6
    # An error-passive sender's flag is recessive: after 1, 1 it brings four more.
    assert receivers_late(wire, 12, passive=True) == 4
    # Delimiters and end of frame are recessive: dominant breaks the form.
    length = len(wire.bits)
    assert [receivers_late(wire, length - n) for n in (1, 2, 7, 8, 10)] == [0] * 5
    # Nobody acknowledges what somebody has acknowledged.
    assert receivers_late(wire, length - 9) == 0
    # The last bit of the CRC: a dominant flag breaks the delimiter after it, a recessive one keeps to the
    # form; the CRC is wrong and flagged after the ACK delimiter, three bits on.
    assert receivers_late(wire, length - 11) == 1
    assert receivers_late(wire, length - 11, passive=True) == 3


@reproducible
@given(FRAMES, st.integers(0, 10**6))
def test_flags_of_an_active_sender_take_6_to_12_bits(frame: Frame, number: int) -> None:
    wire = wire_bits(frame)
    assert 0 <= receivers_late(wire, number % len(wire.bits)) <= 6
    assert 0 <= receivers_late(wire, number % len(wire.bits), passive=True) <= 8
