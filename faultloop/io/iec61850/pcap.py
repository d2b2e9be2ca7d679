"""A run's messages as a capture file of Ethernet frames (pcap with nanoseconds), for Wireshark and its
like."""

from __future__ import annotations

import struct
from collections.abc import Iterable
from pathlib import Path

from faultloop.io.output_file import write_aside

SECOND_NS = 1_000_000_000
MAGIC_NS, ETHERNET, LONGEST = 0xA1B23C4D, 1, 65535


def write_pcap(path: Path | str, frames: Iterable[tuple[int, bytes]]) -> Path:
    """Write frames, each with its time [ns since 1970], in order of time; the file is whole or not there.

    The same frames give the same bytes.

    Raises
    ------
    InputError : the name does not end in ``.pcap``, or the file cannot be written.
    """
    path = Path(path)
    with write_aside(path, ".pcap") as aside, aside.open("wb") as file:
        file.write(struct.pack("<IHHiIII", MAGIC_NS, 2, 4, 0, 0, LONGEST, ETHERNET))
        for t_ns, data in frames:
            file.write(struct.pack("<IIII", *divmod(t_ns, SECOND_NS), len(data), len(data)) + data)
    return path
