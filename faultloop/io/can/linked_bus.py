"""A transport that an installed package brings, as a python-can bus: for one-process runs, and for tools."""

from __future__ import annotations

import time
from collections import deque

import can

from faultloop.io.can.link import Clock, Link, TimedLink
from faultloop.io.can.message import from_message, to_message


class LinkedBus(can.BusABC):
    """Frames go out and come in over a `Link`; a time stamp is the wall clock's when a frame is taken.

    Parameters
    ----------
    channel : its name, for messages.
    link : carries the frames; it is closed with the bus.
    fd : CAN FD frames, too.
    """

    def __init__(self, channel: str, link: Link, fd: bool) -> None:
        super().__init__(channel)
        self.channel_info = channel
        self._can_protocol = can.CanProtocol.CAN_FD if fd else can.CanProtocol.CAN_20
        self._link, self._received = link, deque[can.Message]()

    def attend(self, clock: Clock) -> None:
        """The run's time, for a link that has use for it."""
        if isinstance(self._link, TimedLink):
            self._link.attend(clock)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send it; how long that may take is the link's affair."""
        self._link.send(from_message(msg))

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        if not self._received:
            frames = self._link.receive(3600.0 if timeout is None else timeout)
            now_ns, wall_ns = time.monotonic_ns(), time.time_ns()
            self._received.extend(
                to_message(frame, wall_ns - now_ns + at, is_rx=True) for at, frame in frames
            )
        return (self._received.popleft() if self._received else None), False

    def shutdown(self) -> None:
        """Leave the bus."""
        super().shutdown()
        self._link.close()
