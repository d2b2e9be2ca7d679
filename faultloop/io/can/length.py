"""How many bits a frame takes on the wire, from its very bits (ISO 11898-1:2015, 10.4 and 10.5).

Classic frame: a stuff bit follows every five equal bits (stuff bits included) from the start of frame through
the CRC sequence; the CRC-15 is over the unstuffed bits.  FD frame: so from the start of frame through the
data field, then the CRC field with stuff bits at fixed places: one before the stuff count, which stands for
the dynamic one that may be due there, and one after every fourth bit.  Its length does not depend on the
CRC's value, so no CRC is computed.

Stuffing and CRC go by tables, a byte at a time.  A state of the stuffing is the run of equal bits that the
wire ends with, ``5 * bit + length - 1``; after a run of five the stuff bit is due before the next bit.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

from faultloop.errors import InputError
from faultloop.io.can.frames import Frame

FD_LENGTHS = (0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64)
_DLC = {length: code for code, length in enumerate(FD_LENGTHS)}

INTERMISSION = 3
_FOOTER = 1 + 1 + 7  # ACK slot, ACK delimiter, end of frame
_CRC15_POLYNOMIAL = 0x4599


class WireLength(NamedTuple):
    """Bits at the nominal and at the data bit rate, from the start of frame through the end of frame.

    A bit rate switch happens within a bit, at the sample point of BRS and of the CRC delimiter.  With the
    same sample point in both phases the two take one nominal and one data bit time together: counted so.
    """

    nominal: int
    data: int


class _Header(NamedTuple):
    nominal: int  # bits on the wire, stuff bits included
    data: int
    stuffing: int
    crc: int


def wire_length(frame: Frame) -> WireLength:
    """Length of a data frame on the wire, without the intermission (3 nominal bits) that follows.

    Raises InputError where no such frame exists: an identifier or a length that the format does not have.
    """
    header = _header(frame.id, len(frame.data), frame.extended, frame.fd, frame.brs)
    state, crc, stuffed = header.stuffing, header.crc, 0
    for byte in frame.data:
        crc = (crc << 8 & 0x7FFF) ^ _CRC15_BYTE[crc >> 7 ^ byte]
        step = _STUFF_BYTE[state][byte]
        stuffed += step >> 4
        state = step & 15
    bits = 8 * len(frame.data) + stuffed
    if not frame.fd:
        step = _STUFF_BYTE[state][crc >> 7]
        bits += 15 + (step >> 4) + _STUFF_7[step & 15][crc & 0x7F]
        return WireLength(header.nominal + bits + 1 + _FOOTER, 0)
    crc_field = 4 + 17 + 6 if len(frame.data) <= 16 else 4 + 21 + 7  # stuff count, CRC, fixed stuff bits
    bits += crc_field + 1
    if frame.brs:
        return WireLength(header.nominal + _FOOTER, header.data + bits)
    return WireLength(header.nominal + header.data + bits + _FOOTER, 0)


@lru_cache(maxsize=1024)
def _header(identifier: int, length: int, extended: bool, fd: bool, brs: bool) -> _Header:
    """Start of frame to DLC: the same for all frames of one identifier and length."""
    if not 0 <= identifier < (1 << 29 if extended else 1 << 11):
        raise InputError(f"CAN identifier {identifier:#x} does not fit in {29 if extended else 11} bits")
    if length not in _DLC or (length > 8 and not fd):
        allowed = "0 to 8, 12, 16, 20, 24, 32, 48 or 64" if fd else "0 to 8"
        raise InputError(f"a CAN{' FD' if fd else ''} frame of {length} bytes: its length must be {allowed}")
    if brs and not fd:
        raise InputError("a classic CAN frame has no bit rate switch: only an FD frame has")
    bits = "0"  # start of frame
    if extended:
        bits += f"{identifier >> 18:011b}11{identifier & 0x3FFFF:018b}0"  # SRR, IDE; RTR or RRS
    else:
        bits += f"{identifier:011b}00"  # RTR or RRS, IDE
    # Classic: r1 and r0, or r0 alone.  FD: FDF, res, BRS; then ESI.
    first, second = (f"10{brs:b}", "0") if fd else ("00" if extended else "0", "")
    bits += first
    rest = second + f"{_DLC[length]:04b}"
    nominal_stuffed, state = divmod(_stuff(_IDLE, int(bits, 2), len(bits)), 16)
    data_stuffed, state = divmod(_stuff(state, int(rest, 2), len(rest)), 16)
    whole = bits + rest
    nominal, data = len(bits) + nominal_stuffed, len(rest) + data_stuffed
    crc = _crc15(0, int(whole, 2), len(whole))
    return _Header(nominal, data, state, crc) if fd else _Header(nominal + data, 0, state, crc)


_IDLE = 5  # a recessive bit before the start of frame: ends no run


def _stuff(state: int, bits: int, count: int) -> int:
    """Send the `count` low bits of `bits`, first the highest: 16 * (stuff bits sent) + new state."""
    stuffed = 0
    for shift in range(count - 1, -1, -1):
        if state % 5 == 4:
            stuffed += 1
            state = 0 if state > 4 else 5
        bit = bits >> shift & 1
        state = state + 1 if state // 5 == bit else 5 * bit
    return stuffed << 4 | state


def _crc15(crc: int, bits: int, count: int) -> int:
    for shift in range(count - 1, -1, -1):
        feedback = (crc >> 14 ^ bits >> shift) & 1
        crc = (crc << 1 & 0x7FFF) ^ (_CRC15_POLYNOMIAL if feedback else 0)
    return crc


def _stuffed_at_end(state: int, bits: int) -> int:
    """Stuff bits in the last 7 bits of the CRC sequence, and after them if they end in a run of five."""
    step = _stuff(state, bits, 7)
    return (step >> 4) + ((step & 15) % 5 == 4)


_STUFF_BYTE = [[_stuff(state, byte, 8) for byte in range(256)] for state in range(10)]
_STUFF_7 = [[_stuffed_at_end(state, bits) for bits in range(128)] for state in range(10)]
_CRC15_BYTE = [_crc15(0, byte, 8) for byte in range(256)]
