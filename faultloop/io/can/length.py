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

from typing import NamedTuple

import numpy as np

from faultloop.errors import InputError
from faultloop.io.can.frames import Frame
from faultloop.io.can.record import FRAME, Bytes, Record, new_frame
from faultloop.jit import njit

FD_LENGTHS = (0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64)
_DLC = np.array([FD_LENGTHS.index(n) if n in FD_LENGTHS else -1 for n in range(FD_LENGTHS[-1] + 1)])

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


def wire_length(frame: Frame) -> WireLength:
    """Length of a data frame on the wire, without the intermission (3 nominal bits) that follows.

    Raises InputError where no such frame exists: an identifier or a length that the format does not have.
    """
    check(frame)
    return WireLength(*_lengths_of_bytes(new_frame(frame)))


def check(frame: Frame) -> None:
    """InputError where no such frame exists."""
    identifier, length = frame.id, len(frame.data)
    if not 0 <= identifier < (1 << 29 if frame.extended else 1 << 11):
        bits = 29 if frame.extended else 11
        raise InputError(f"CAN identifier {identifier:#x} does not fit in {bits} bits")
    if length not in FD_LENGTHS or (length > 8 and not frame.fd):
        allowed = "0 to 8, 12, 16, 20, 24, 32, 48 or 64" if frame.fd else "0 to 8"
        raise InputError(
            f"a CAN{' FD' if frame.fd else ''} frame of {length} bytes: its length must be {allowed}"
        )
    if frame.brs and not frame.fd:
        raise InputError("a classic CAN frame has no bit rate switch: only an FD frame has")


_IDLE = 5  # a recessive bit before the start of frame: ends no run


@njit
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


@njit
def _crc15(crc: int, bits: int, count: int) -> int:
    for shift in range(count - 1, -1, -1):
        feedback = (crc >> 14 ^ bits >> shift) & 1
        crc = (crc << 1 & 0x7FFF) ^ (_CRC15_POLYNOMIAL if feedback else 0)
    return crc


def _stuffed_at_end(state: int, bits: int) -> int:
    """Stuff bits in the last 7 bits of the CRC sequence, and after them if they end in a run of five."""
    step = _stuff.py_func(state, bits, 7)
    return (step >> 4) + ((step & 15) % 5 == 4)


_STUFF_BYTE = np.array([[_stuff.py_func(state, byte, 8) for byte in range(256)] for state in range(10)])
_STUFF_7 = np.array([[_stuffed_at_end(state, bits) for bits in range(128)] for state in range(10)])
_CRC15_BYTE = np.array([_crc15.py_func(0, byte, 8) for byte in range(256)])


@njit
def lengths(frame: Record) -> tuple[int, int]:
    """`WireLength` of a ``FRAME`` that exists."""
    bits, count = _to_switch(frame)
    rest, more = _after_switch(frame)
    nominal_step = _stuff(_IDLE, bits, count)
    data_step = _stuff(nominal_step & 15, rest, more)
    nominal, data = count + (nominal_step >> 4), more + (data_step >> 4)
    state, stuffed = data_step & 15, 0
    crc = _crc15(0, bits << more | rest, count + more)
    for i in range(frame.length):
        byte = np.int64(frame.data[i])
        crc = (crc << 8 & 0x7FFF) ^ _CRC15_BYTE[crc >> 7 ^ byte]
        step = _STUFF_BYTE[state, byte]
        stuffed += step >> 4
        state = step & 15
    content = 8 * frame.length + stuffed
    if not frame.fd:
        step = _STUFF_BYTE[state, crc >> 7]
        content += 15 + (step >> 4) + _STUFF_7[step & 15, crc & 0x7F]
        return nominal + data + content + 1 + _FOOTER, int(np.int64(0))
    content += 4 + (17 + 6 if frame.length <= 16 else 21 + 7) + 1  # stuff count, CRC, fixed stuff bits
    if frame.brs:
        return nominal + _FOOTER, data + content
    return nominal + data + content + _FOOTER, int(np.int64(0))


@njit
def _lengths_of_bytes(frame: Bytes) -> tuple[int, int]:
    return lengths(frame.view(FRAME)[0])


@njit
def _to_switch(frame: Record) -> tuple[int, int]:
    """From the start of frame to where the bit rate may switch: the bits as a number, and their count."""
    if frame.extended:  # SOF, 11 bits, SRR, IDE, 18 bits, RTR or RRS
        bits, count = (frame.id >> 18) << 21 | 0b11 << 19 | (frame.id & 0x3FFFF) << 1, 33
    else:  # SOF, 11 bits, RTR or RRS, IDE
        bits, count = frame.id << 2, 14
    if frame.fd:  # FDF, res, BRS
        return bits << 3 | 0b100 | frame.brs, count + 3
    return (bits << 2, count + 2) if frame.extended else (bits << 1, count + 1)  # r1, r0; or r0 alone


@njit
def _after_switch(frame: Record) -> tuple[int, int]:
    """ESI where there is one, and DLC."""
    return int(_DLC[frame.length]), (5 if frame.fd else 4)
