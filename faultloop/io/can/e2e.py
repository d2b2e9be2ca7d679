"""End-to-end protection of a frame's content (AUTOSAR E2E profiles 1 and 5).

Profile 1, data-id mode "both" (variant 1A): in byte 0 a CRC-8 over the data id (low, then high byte) and
bytes 1 to the end, with the polynomial of SAE J1850, 0x1D, but zero to start and as final XOR, where SAE
has 0xFF; the counter, 0 to 14, is the low nibble of byte 1. Profile 5: CRC-16 CCITT-FALSE, least
significant byte first, in bytes 0 and 1, over bytes 2 to the end and then the data id; the counter, 0 to
255, is byte 2.
Source: AUTOSAR Foundation, "E2E Protocol Specification" (PRS_E2EProtocol), profiles 1 and 5.  The data id is
the frame's identifier, so that a frame that comes under another's name fails its check.
"""

from __future__ import annotations

from binascii import crc_hqx

import numpy as np
from numpy.typing import NDArray

from faultloop.jit import njit

P01_COUNTERS = 15  # 15 is the value for "invalid": the counter goes 0 ... 14, 0


def table_of_one_byte(polynomial: int) -> NDArray[np.uint8]:
    """CRC-8 of every byte, most significant bit first."""
    table = np.empty(256, np.uint8)
    for byte in range(256):
        crc = byte
        for _ in range(8):
            crc = (crc << 1) ^ (polynomial if crc & 0x80 else 0)
        table[byte] = crc & 0xFF
    return table


_STEP = table_of_one_byte(0x1D)


def _table_of_two_bytes(polynomial: int) -> NDArray[np.uint16]:
    table = np.empty(256, np.uint16)
    for byte in range(256):
        crc = byte << 8
        for _ in range(8):
            crc = (crc << 1) ^ (polynomial if crc & 0x8000 else 0)
        table[byte] = crc & 0xFFFF
    return table


@njit
def crc8(data_id: int, data: NDArray[np.uint8], length: int) -> int:
    """CRC of the first ``length`` bytes under profile 1; byte 0, where it goes, is not read."""
    crc = _STEP[_STEP[data_id & 0xFF] ^ data_id >> 8]
    for i in range(1, length):
        crc = _STEP[crc ^ data[i]]
    return int(np.int64(crc))


def crc8_p01(data_id: int, data: bytes | bytearray) -> int:
    """CRC of a frame under profile 1; byte 0, where it goes, is not read."""
    return crc8(data_id, np.frombuffer(data, np.uint8), len(data))


_STEP16 = _table_of_two_bytes(0x1021)


@njit
def crc16(data_id: int, data: NDArray[np.uint8], length: int) -> int:
    """`crc16_p05` for kernels, of the first ``length`` bytes."""
    crc = np.int64(0xFFFF)
    for i in range(2, length):
        crc = crc << 8 & 0xFFFF ^ np.int64(_STEP16[crc >> 8 ^ np.int64(data[i])])
    crc = crc << 8 & 0xFFFF ^ np.int64(_STEP16[crc >> 8 ^ (data_id & 0xFF)])
    return int(crc << 8 & 0xFFFF ^ np.int64(_STEP16[crc >> 8 ^ data_id >> 8]))


def crc16_p05(data_id: int, data: bytes | bytearray) -> int:
    """CRC of a frame of any length under profile 5; bytes 0 and 1, where it goes, are not read."""
    return crc_hqx(bytes((data_id & 0xFF, data_id >> 8)), crc_hqx(data[2:], 0xFFFF))
