"""Frames as python-can has them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from faultloop.io.can.bus import SECOND_NS
from faultloop.io.can.frames import Frame

if TYPE_CHECKING:
    from can import Message


def to_message(frame: Frame, t_ns: int, *, is_rx: bool = False, channel: str | None = None) -> Message:
    """A frame as a python-can message with the time stamp `t_ns`."""
    import can

    return can.Message(
        timestamp=t_ns / SECOND_NS,
        arbitration_id=frame.id,
        is_extended_id=frame.extended,
        is_fd=frame.fd,
        bitrate_switch=frame.brs,
        data=frame.data,
        is_rx=is_rx,
        channel=channel,
    )


def from_message(message: Message) -> Frame:
    """A python-can data frame as a frame."""
    return Frame(
        message.arbitration_id,
        bytes(message.data),
        message.is_extended_id,
        message.is_fd,
        message.is_fd and message.bitrate_switch,
    )
