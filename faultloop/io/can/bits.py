"""A frame's very bits on the wire, and who sees an error in one of them (ISO 11898-1:2015).

`length.py` counts the bits, fast and for each frame; this writes them down, for the frames that are hit by an
error, and for whoever wants to see them.  "0" is dominant, "1" recessive.
"""

from __future__ import annotations

from typing import NamedTuple

from faultloop.io.can.frames import Frame
from faultloop.io.can.length import FD_LENGTHS, wire_length

ACK_AND_END = "0" + "1" + "1" * 7  # ACK slot as a receiver drives it, ACK delimiter, end of frame
FLAG = 6
"""Bits of an error flag."""


class Crc(NamedTuple):
    """Width [bit], polynomial without its highest term, and initial value of a CRC."""

    width: int
    polynomial: int
    initial: int

    def of(self, bits: str) -> str:
        """The CRC sequence of some bits."""
        crc, top = self.initial, 1 << (self.width - 1)
        for bit in bits:
            feedback = bool(crc & top) != (bit == "1")
            crc = (crc << 1 & 2 * top - 1) ^ (self.polynomial if feedback else 0)
        return f"{crc:0{self.width}b}"


CRC15 = Crc(15, 0x4599, 0)  # classic
CRC17 = Crc(17, 0x1685B, 1 << 16)  # FD, to 16 bytes
CRC21 = Crc(21, 0x102899, 1 << 20)  # FD, more


class WireBits(NamedTuple):
    """Bits from the start of frame through the end of frame."""

    bits: str
    stuffed: int
    """How many of them come before the dynamic stuffing ends."""
    fixed: tuple[int, ...]
    """Places of the fixed stuff bits."""
    data_phase: range
    """Places of the bits at the data bit rate, as `wire_length` counts them."""


def wire_bits(frame: Frame) -> WireBits:
    """All bits of a data frame of an error-active sender; raises InputError where no such frame exists."""
    length = wire_length(frame)  # refuses what cannot be
    content = _head(frame) + "".join(f"{byte:08b}" for byte in frame.data)
    if not frame.fd:
        stuffed, due = _stuffed(content + CRC15.of(content))
        return WireBits(stuffed + due + "1" + ACK_AND_END, len(stuffed + due), (), range(0))
    stuffed, _ = _stuffed(content)  # for one that is due now stands the first fixed one
    field = _stuff_count(len(stuffed) - len(content))
    field += (CRC17 if len(frame.data) <= 16 else CRC21).of(stuffed + field)
    bits, fixed = stuffed, []
    for i in range(0, len(field), 4):
        fixed.append(len(bits))
        bits += _opposite(bits[-1]) + field[i : i + 4]
    bits += "1"  # CRC delimiter
    data_phase = range(len(bits) - length.data, len(bits))
    return WireBits(bits + ACK_AND_END, len(stuffed), tuple(fixed), data_phase)


def receivers_late(wire: WireBits, place: int, *, passive: bool = False) -> int:
    """How many bits after the sender the receivers begin their error flags, where one bit is disturbed.

    The sender sees the bit at `place` turned over and flags from the next one on: six dominant bits, or
    recessive ones if it is error-passive.  The receivers flag after the bit that breaks a rule for them: that
    bit itself, or one of the sender's flag, the sixth equal one at the latest where bits are stuffed.  So the
    flags take 6 bits and this together.

    Parameters
    ----------
    wire : the frame.
    place : of the bit that everybody sees wrong.
    passive : the sender is error-passive.
    """
    level = "1" if passive else "0"
    seen = wire.bits[:place] + _opposite(wire.bits[place])
    while not _violates(wire, seen):
        seen += level
    return len(seen) - 1 - place


def _violates(wire: WireBits, seen: str) -> bool:
    """Does a receiver see an error in the newest of these bits?"""
    place, bit = len(seen) - 1, seen[-1]
    slot = len(wire.bits) - len(ACK_AND_END)
    if place < wire.stuffed:
        return len(seen) >= 6 and len(set(seen[-6:])) == 1
    if place in wire.fixed:
        return bit == seen[-2]
    if place == slot:  # whoever acknowledged sees that nobody did; whoever found the CRC wrong kept silent
        return bit == "1" and seen[:place] == wire.bits[:place]
    if place == slot + 1:
        return True  # a delimiter that is dominant, or the place to flag a wrong CRC
    return place >= slot - 1 and bit == "0"


def _stuffed(bits: str) -> tuple[str, str]:
    """With a stuff bit between five equal bits, stuff bits included, and the next; and one due at the end."""
    out, due = "", ""
    for bit in bits:
        out += due + bit
        due = _opposite(bit) if out[-5:] == 5 * bit else ""
    return out, due


def _opposite(bit: str) -> str:
    return "0" if bit == "1" else "1"


def _head(frame: Frame) -> str:
    """Start of frame to DLC, unstuffed."""
    if frame.extended:
        bits = f"0{frame.id >> 18:011b}11{frame.id & 0x3FFFF:018b}0"  # SOF, SRR, IDE, RTR or RRS
    else:
        bits = f"0{frame.id:011b}00"  # SOF, RTR or RRS, IDE
    if frame.fd:
        bits += f"10{frame.brs:b}0"  # FDF, res, BRS, ESI: dominant, the sender is error-active
    else:
        bits += "00" if frame.extended else "0"  # r1, r0
    return bits + f"{FD_LENGTHS.index(len(frame.data)):04b}"


def _stuff_count(count: int) -> str:
    """Number of stuff bits modulo 8 in Gray's code, and its even parity."""
    gray = (count & 7) ^ (count & 7) >> 1
    return f"{gray:03b}{gray.bit_count() & 1}"
