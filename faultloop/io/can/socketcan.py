"""One process's place on a bus: send, receive, and count what was lost.

SocketCAN goes by a raw socket of the kernel: a frame costs 3 us so and 25 us by python-can, and the kernel
itself drops what is not in `identifiers`, so that a relay never wakes for another one's samples.  Any other
interface goes by python-can.
"""

from __future__ import annotations

import errno
import select
import socket
import struct
import time
from collections.abc import Iterable
from typing import Any

from faultloop.errors import InputError
from faultloop.io.can.frames import Frame
from faultloop.io.can.link import Link, transport_named
from faultloop.io.can.transport import (
    SEND_WITHIN_S,
    check_socketcan,
    from_message,
    open_bus,
    send,
    to_message,
)

RECEIVE_BUFFER = 8 << 20  # bytes: some seconds of samples, for the time in which a process cannot run
LISTENER_BUFFER = 128 << 20  # the same for who hears everything and writes it down
BATCH = 512  # frames taken at once: a node must get to its own work

_CLASSIC = struct.Struct("=IB3x8s")
_FD = struct.Struct("=IBBxx64s")
_EXTENDED, _REMOTE, _ERROR = 0x8000_0000, 0x4000_0000, 0x2000_0000
_BRS = 0x01
_ERROR_FILTER = 2  # CAN_RAW_ERR_FILTER
_SO_RCVBUFFORCE, _SO_TIMESTAMPNS, _SO_MEMINFO, _DROPS = 33, 35, 55, 8
_TIMESPEC = struct.Struct("=qq")
_FULL = (errno.ENOBUFS, errno.EAGAIN)


def open_link(channel: str, fd: bool, identifiers: Iterable[int] | None = None, scenario: Any = None) -> Link:
    """The bus ``INTERFACE:CHANNEL``: SocketCAN, what an installed package brings, or python-can's.

    Parameters
    ----------
    fd : CAN FD frames, too.
    identifiers : of the frames that are wanted; all where not given, each then with the time at which the
        kernel got it, where that is known.
    scenario : of the run, for a transport that has use for it.

    Raises
    ------
    InputError : there is no such bus, it is down, or it does not carry CAN FD.
    """
    interface, colon, name = channel.partition(":")
    if not (interface and colon and name):
        raise InputError(f"'{channel}' is not INTERFACE:CHANNEL, as in socketcan:vcan0", key="--can")
    wanted = None if identifiers is None else frozenset(identifiers)
    if (brought := transport_named(interface, scenario)) is not None:
        return brought(name, wanted)
    if interface == "virtual":
        raise InputError(
            "the virtual bus ends where its process does: processes need socketcan:vcan0 or the like",
            key="--can",
        )
    if interface == "socketcan":
        return SocketListener(name, fd) if wanted is None else SocketLink(name, fd, wanted)
    return PythonCanLink(interface, name, fd, wanted)


class SocketLink:
    """A raw socket of Linux's SocketCAN."""

    def __init__(self, name: str, fd: bool, identifiers: frozenset[int] | None) -> None:
        check_socketcan(name, fd)
        self.name = name
        self.sent = self.received = self.retries = self.errors = 0
        self._socket = s = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        self._size(RECEIVE_BUFFER)
        if fd:
            s.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FD_FRAMES, 1)
        s.setsockopt(socket.SOL_CAN_RAW, _ERROR_FILTER, 0x1FFFFFFF)
        if identifiers is not None:
            filters = b"".join(
                struct.pack("=II", i, _EXTENDED | _REMOTE | 0x7FF) for i in sorted(identifiers)
            )
            s.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, filters)
        try:
            s.bind((name,))  # last: nothing comes unfiltered
        except OSError as error:
            raise InputError(f"cannot open: {error.strerror or error}", key=name) from error
        s.setblocking(False)
        self._poll = select.poll()
        self._poll.register(s, select.POLLIN)

    def _size(self, buffer: int) -> None:
        try:
            self._socket.setsockopt(socket.SOL_SOCKET, _SO_RCVBUFFORCE, buffer)
        except OSError:  # not root: as much as the system allows
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, buffer)

    def send(self, frame: Frame) -> None:
        """Send; wait, with a bound, where the transmit queue is full."""
        identifier = frame.id | (_EXTENDED if frame.extended else 0)
        if frame.fd:
            data = _FD.pack(identifier, len(frame.data), _BRS if frame.brs else 0, frame.data)
        else:
            data = _CLASSIC.pack(identifier, len(frame.data), frame.data)
        deadline = None
        while True:
            try:
                self._socket.send(data)
                break
            except OSError as error:
                now = time.monotonic()
                deadline = now + SEND_WITHIN_S if deadline is None else deadline
                if error.errno not in _FULL or now > deadline:
                    raise self._broken("send", error) from error
                self.retries += 1
                time.sleep(0.0002)
        self.sent += 1

    def receive(self, timeout_s: float) -> list[tuple[int, Frame]]:
        if not self._poll.poll(max(0.0, timeout_s) * 1000):
            return []
        frames: list[tuple[int, Frame]] = []
        take = self._take
        try:
            for _ in range(BATCH):
                at_ns, data = take()
                frame = self._frame(data)
                if frame is not None:
                    frames.append((at_ns, frame))
        except BlockingIOError:
            pass
        except OSError as error:
            raise self._broken("receive", error) from error
        self.received += len(frames)
        return frames

    def _take(self) -> tuple[int, bytes]:
        data = self._socket.recv(_FD.size)
        return time.monotonic_ns(), data

    def _frame(self, data: bytes) -> Frame | None:
        fd = len(data) == _FD.size
        identifier, length, *rest = _FD.unpack(data) if fd else _CLASSIC.unpack(data)
        if identifier & _ERROR:
            self.errors += 1
            return None
        if identifier & _REMOTE:
            return None
        extended = bool(identifier & _EXTENDED)
        content = rest[-1][:length]
        return Frame(identifier & 0x1FFFFFFF, content, extended, fd, fd and bool(rest[0] & _BRS))

    def _broken(self, what: str, error: OSError) -> InputError:
        if error.errno == errno.ENETDOWN:
            why = f"the interface is down: ip link set {self.name} up"
        elif error.errno in _FULL:
            why = f"the transmit queue was full for {SEND_WITHIN_S:g} s: raise its txqueuelen, or run slower"
        else:
            why = error.strerror or str(error)
        return InputError(f"cannot {what}: {why}", key=self.name)

    @property
    def dropped(self) -> int:
        info = self._socket.getsockopt(socket.SOL_SOCKET, _SO_MEMINFO, 36)
        return struct.unpack_from("=9I", info)[_DROPS] if len(info) >= 36 else 0

    def close(self) -> None:
        self._socket.close()


class SocketListener(SocketLink):
    """Hears everything, with the time at which the kernel got it; and may be late without losing anything."""

    def __init__(self, name: str, fd: bool) -> None:
        super().__init__(name, fd, None)
        self._size(LISTENER_BUFFER)
        self._socket.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
        self._ahead_ns = _wall_clock_ahead_ns()

    def _take(self) -> tuple[int, bytes]:
        data, ancillary, _, _ = self._socket.recvmsg(_FD.size, 64)
        for level, kind, content in ancillary:
            if level == socket.SOL_SOCKET and kind == _SO_TIMESTAMPNS:
                seconds, nanoseconds = _TIMESPEC.unpack_from(content)
                return seconds * 1_000_000_000 + nanoseconds - self._ahead_ns, data
        return time.monotonic_ns(), data


def _wall_clock_ahead_ns() -> int:
    """By how much the wall clock, of the kernel's stamps, is ahead of the monotonic one."""
    readings = []
    for _ in range(10):  # the one of them in which nobody came between
        before, wall, after = time.monotonic_ns(), time.time_ns(), time.monotonic_ns()
        readings.append((after - before, wall - (before + after) // 2))
    return min(readings)[1]


class PythonCanLink:
    """Any other interface of python-can; it tells nothing of frames that were dropped."""

    dropped = 0

    def __init__(self, interface: str, name: str, fd: bool, identifiers: frozenset[int] | None) -> None:
        self.sent = self.received = self.retries = self.errors = 0
        self._bus = open_bus(interface, name, fd=fd)
        self._wanted = identifiers

    def send(self, frame: Frame) -> None:
        send(self._bus, to_message(frame, time.time_ns()))
        self.sent += 1

    def receive(self, timeout_s: float) -> list[tuple[int, Frame]]:
        frames: list[tuple[int, Frame]] = []
        message = self._bus.recv(max(0.0, timeout_s))
        while message is not None:
            if message.is_error_frame:
                self.errors += 1
            elif not message.is_remote_frame and (
                self._wanted is None or message.arbitration_id in self._wanted
            ):
                frames.append((time.monotonic_ns(), from_message(message)))
            if len(frames) >= BATCH:
                break
            message = self._bus.recv(0)
        self.received += len(frames)
        return frames

    def close(self) -> None:
        self._bus.shutdown()
