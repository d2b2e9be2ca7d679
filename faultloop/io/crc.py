"""CRC-32 (ISO 3309) of chunks and summaries: ISA-L's, by carry-less multiplication, takes a quarter of zlib's
time, of a logged run's 6 %.  Where no wheel of it is made (``pyproject.toml`` names the machines), zlib's."""

from __future__ import annotations

try:
    from isal.isal_zlib import crc32
except ImportError:
    from zlib import crc32

__all__ = ["crc32"]
