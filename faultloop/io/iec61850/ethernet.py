"""A raw socket on an Ethernet interface (Linux, AF_PACKET) that hears what has one of some APPIDs."""

from __future__ import annotations

import ctypes
import errno
import select
import socket
import struct
import time
from collections.abc import Sequence
from pathlib import Path

from faultloop.errors import InputError, nearest

BUFFER = 64 << 20
BATCH = 512
LONGEST = 2048
SEND_WITHIN_S = 1.0
TAGGED, ANY_PROTOCOL = 0x8100, 0x0003
_SO_RCVBUFFORCE, _SO_ATTACH_FILTER, _SOL_PACKET, _PACKET_STATISTICS, _PACKET_ADD_MEMBERSHIP = (
    33,
    26,
    263,
    6,
    1,
)
_ALL_MULTICAST = 2
_LOAD, _EQUAL, _RETURN, _JUMP = 0x28, 0x15, 0x06, 0x05  # of classic BPF: ldh [k], jeq #k, ret #k, ja
_INSTRUCTION = struct.Struct("HBBI")


class EthernetSocket:
    """Sends and takes whole frames.

    Parameters
    ----------
    interface : as in ``eth0``.
    ether_types : of the frames that are heard, tagged or not.
    app_ids : which are behind the EtherType: of the frames that are heard.

    Raises
    ------
    InputError : there is no such interface, it is down, or it may not be opened.
    """

    def __init__(self, interface: str, ether_types: Sequence[int], app_ids: Sequence[int]) -> None:
        check_interface(interface)
        self.interface = interface
        self.retries = 0
        self._dropped = 0
        self._loopback = interface == "lo"
        try:
            self._socket = s = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, 0)
        except PermissionError:
            raise InputError("raw frames need root (CAP_NET_RAW)", key=interface) from None
        self._attach(filter_of(ether_types, app_ids))
        try:
            s.setsockopt(socket.SOL_SOCKET, _SO_RCVBUFFORCE, BUFFER)
        except OSError:  # not root: as much as the system allows
            s.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER)
        s.setblocking(False)
        s.bind((interface, ANY_PROTOCOL))  # so that other processes on this interface are heard, too
        index = socket.if_nametoindex(interface)
        s.setsockopt(_SOL_PACKET, _PACKET_ADD_MEMBERSHIP, struct.pack("iHH8x", index, _ALL_MULTICAST, 0))
        self._poll = select.poll()
        self._poll.register(s, select.POLLIN)

    def _attach(self, program: list[tuple[int, int, int, int]]) -> None:
        code = ctypes.create_string_buffer(b"".join(_INSTRUCTION.pack(*step) for step in program))
        self._socket.setsockopt(
            socket.SOL_SOCKET, _SO_ATTACH_FILTER, struct.pack("HL", len(program), ctypes.addressof(code))
        )

    def send(self, data: bytes) -> None:
        """Send a frame; wait, with a bound, where the transmit queue is full."""
        deadline = time.monotonic() + SEND_WITHIN_S
        while True:
            try:
                self._socket.send(data)
                return
            except OSError as error:
                full = error.errno in (errno.ENOBUFS, errno.EAGAIN)
                if not full or time.monotonic() > deadline:
                    raise self._broken("send", error) from error
                self.retries += 1
                time.sleep(0.0002)

    def receive(self, timeout_s: float) -> list[tuple[int, bytes]]:
        """Frames that have come, each with the monotonic time of its taking [ns]; waits for the first one."""
        frames: list[tuple[int, bytes]] = []
        if not self._poll.poll(max(0.0, timeout_s) * 1000):
            return frames
        try:
            for _ in range(BATCH):
                data, address = self._socket.recvfrom(LONGEST)
                # What leaves by the loopback interface comes in by it again.
                if not (self._loopback and address[2] == socket.PACKET_OUTGOING):
                    frames.append((time.monotonic_ns(), data))
        except BlockingIOError:
            pass
        except OSError as error:
            raise self._broken("receive", error) from error
        return frames

    def _broken(self, what: str, error: OSError) -> InputError:
        down = error.errno == errno.ENETDOWN
        why = (
            f"the interface is down: ip link set {self.interface} up"
            if down
            else error.strerror or str(error)
        )
        return InputError(f"cannot {what}: {why}", key=self.interface)

    @property
    def dropped(self) -> int:
        """Frames that the kernel could not keep for us."""
        _, drops = struct.unpack("II", self._socket.getsockopt(_SOL_PACKET, _PACKET_STATISTICS, 8))
        self._dropped += drops  # the kernel counts from zero again
        return self._dropped

    def close(self) -> None:
        self._socket.close()


def filter_of(ether_types: Sequence[int], app_ids: Sequence[int]) -> list[tuple[int, int, int, int]]:
    """A program of classic BPF (code, jump if true, jump if false, value) that passes frames of those types
    and APPIDs.

    The kernel takes the tag of IEEE 802.1Q off what comes in, and leaves it on what goes out: both are looked
    at.
    """
    behind = [_passes(ether_types, app_ids, shift) for shift in (0, 4)]
    # A jump that depends on a value reaches 255 steps, ja any number.
    head = [(_LOAD, 0, 0, 12), (_EQUAL, 0, 1, TAGGED), (_JUMP, 0, 0, len(behind[0]))]
    return [*head, *behind[0], *behind[1]]


def _passes(
    ether_types: Sequence[int], app_ids: Sequence[int], shift: int
) -> list[tuple[int, int, int, int]]:
    program = [(_LOAD, 0, 0, 12 + shift)]
    for place, wanted in enumerate(ether_types):  # any of them jumps over the refusal
        program.append((_EQUAL, len(ether_types) - place, 0, wanted))
    program.append((_RETURN, 0, 0, 0))
    program.append((_LOAD, 0, 0, 14 + shift))
    for wanted in app_ids:
        program += [(_EQUAL, 0, 1, wanted), (_RETURN, 0, 0, 0xFFFF)]
    return [*program, (_RETURN, 0, 0, 0)]


def check_interface(name: str) -> None:
    """InputError where there are no raw sockets, or no such Ethernet interface, or it is down."""
    if not hasattr(socket, "AF_PACKET"):
        raise InputError("raw frames need Linux (AF_PACKET)", key=name)
    device = Path("/sys/class/net") / name
    if not name or "/" in name or not device.is_dir():
        names = sorted(path.name for path in device.parent.glob("*")) if device.parent.is_dir() else []
        raise InputError(f"no network interface of this name: {nearest(name, names)}", key=name)
    if int((device / "type").read_text(encoding="ascii")) not in (1, 772):  # Ethernet, loopback
        raise InputError("is no Ethernet interface", key=name)
    if not int((device / "flags").read_text(encoding="ascii"), 16) & 1:  # IFF_UP
        raise InputError(f"the interface is down: ip link set {name} up", key=name)
