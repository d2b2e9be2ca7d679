"""A transport of one's own: the messages of a run in Ethernet frames.

    pip install examples/ethernet_transport
    faultloop run scenarios/ag-zone1.toml --processes --can ethernet:eth0      # Linux, as root

Each message is a multicast frame of EtherType 0x88B5 (IEEE 802, for local experiments): identifier (u32),
flags (u8: 1 CAN FD, 2 bit rate switch, 4 extended), length (u8), data.
"""

from __future__ import annotations

import os
import select
import socket
import struct
import time
from collections.abc import Collection

from faultloop.errors import InputError
from faultloop.io.can.frames import Frame

ETHER_TYPE = 0x88B5
EVERYBODY = bytes.fromhex("030000000001")  # a multicast address of local administration
HEAD = struct.Struct("!6s6sHIBB")
FD, BRS, EXTENDED = 1, 2, 4
AT_ONCE = 512
BUFFER = 64 << 20
SOL_PACKET, PACKET_STATISTICS, SO_RCVBUFFORCE = 263, 6, 33


class EthernetLink:
    """One node's place on an Ethernet segment."""

    def __init__(self, interface: str, identifiers: Collection[int] | None) -> None:
        self.sent = self.received = self.retries = self.errors = 0
        self._dropped = 0
        self._wanted = identifiers
        self._address = b"\x02" + os.urandom(5)  # of local administration: whose frames these are
        self._loopback = interface == "lo"
        self._socket = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, 0)
        self._socket.setsockopt(socket.SOL_SOCKET, SO_RCVBUFFORCE, BUFFER)
        self._socket.setblocking(False)
        self._socket.bind((interface, ETHER_TYPE))
        self._poll = select.poll()
        self._poll.register(self._socket, select.POLLIN)

    def send(self, frame: Frame) -> None:
        flags = FD * frame.fd | BRS * frame.brs | EXTENDED * frame.extended
        head = HEAD.pack(EVERYBODY, self._address, ETHER_TYPE, frame.id, flags, len(frame.data))
        self._socket.send(head + frame.data)
        self.sent += 1

    def receive(self, timeout_s: float) -> list[tuple[int, Frame]]:
        frames: list[tuple[int, Frame]] = []
        if not self._poll.poll(max(0.0, timeout_s) * 1000):
            return frames
        try:
            for _ in range(AT_ONCE):
                data, (_, _, direction, *_) = self._socket.recvfrom(256)
                # A frame that leaves by the loopback interface comes in by it again.
                twice = self._loopback and direction == socket.PACKET_OUTGOING
                frame = None if twice else self._frame(data)
                if frame is not None:
                    frames.append((time.monotonic_ns(), frame))
        except BlockingIOError:
            pass
        self.received += len(frames)
        return frames

    def _frame(self, data: bytes) -> Frame | None:
        if len(data) < HEAD.size:
            self.errors += 1
            return None
        _, sender, _, identifier, flags, length = HEAD.unpack_from(data)
        if sender == self._address or (self._wanted is not None and identifier not in self._wanted):
            return None
        content = data[HEAD.size : HEAD.size + length]  # a short frame is padded
        if len(content) != length:
            self.errors += 1
            return None
        return Frame(identifier, content, bool(flags & EXTENDED), bool(flags & FD), bool(flags & BRS))

    @property
    def dropped(self) -> int:
        _, drops = struct.unpack("II", self._socket.getsockopt(SOL_PACKET, PACKET_STATISTICS, 8))
        self._dropped += drops  # the kernel counts from zero again
        return self._dropped

    def close(self) -> None:
        self._socket.close()


def open_link(channel: str, identifiers: Collection[int] | None) -> EthernetLink:
    """The Ethernet interface `channel`, as in ``eth0``."""
    try:
        return EthernetLink(channel, identifiers)
    except OSError as error:
        why = "needs root (CAP_NET_RAW)" if isinstance(error, PermissionError) else error.strerror
        raise InputError(f"cannot be opened: {why}", key=channel) from error
