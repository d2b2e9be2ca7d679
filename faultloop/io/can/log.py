"""Frames into the logs that people's tools read: Vector BLF and ASC, candump's .log.

All three keep the direction and CAN FD; times are whole microseconds (nanoseconds in BLF).  python-can writes
them; two habits of its ASC writer are mended here: it puts the wall clock's date at the top, so that the same
frames give another file each time, and it writes the start's milliseconds without leading zeros, so that a
reader is wrong by up to 0.9 s unless the log begins at a whole second.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from datetime import datetime
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from faultloop.errors import InputError
from faultloop.io.can.frames import Frame
from faultloop.io.can.transport import to_message
from faultloop.io.output_file import write_aside

if TYPE_CHECKING:
    from can import Message


class LoggedFrame(NamedTuple):
    """A frame, when it was received [ns since 1970], and whether this program sent it."""

    t_ns: int
    frame: Frame
    sent: bool


def write_can_log(path: Path | str, frames: Iterable[LoggedFrame], channel: str = "can0") -> Path:
    """Write frames, in order of time, to a ``.blf``, ``.asc`` or ``.log`` file.

    Written aside and renamed: the file is whole or not there.  The same frames give the same bytes (an ASC
    file has local time, as Vector's has: the same bytes in the same time zone).

    Raises
    ------
    InputError : another suffix, or the file cannot be written.
    """
    path = Path(path)
    writer = _WRITERS.get(path.suffix.lower())
    if writer is None:
        raise InputError(
            f"no CAN log has the suffix '{path.suffix}': it must be {', '.join(_WRITERS)}", file=path
        )
    messages = (to_message(f.frame, f.t_ns, is_rx=not f.sent, channel=channel) for f in frames)
    with write_aside(path) as aside:
        writer(aside, messages)
    return path


def _write_blf(path: Path, messages: Iterable[Message]) -> None:
    from can.io.blf import BLFWriter

    with path.open("wb+") as file, BLFWriter(file) as writer:
        for message in messages:
            writer.on_message_received(message)


def _write_candump(path: Path, messages: Iterable[Message]) -> None:
    from can.io.canutils import CanutilsLogWriter

    with path.open("w", encoding="ascii", newline="\n") as file, CanutilsLogWriter(file) as writer:
        for message in messages:
            writer.on_message_received(message)


def _write_asc(path: Path, messages: Iterable[Message]) -> None:
    from can.io.asc import ASCWriter

    messages = iter(messages)
    first = next(messages, None)
    start_s = 0 if first is None else int(first.timestamp)
    date = datetime.fromtimestamp(start_s).strftime("%a %b %d %H:%M:%S.000 %Y")
    with path.open("w", encoding="ascii", newline="\r\n") as file, ASCWriter(file) as writer:
        file.seek(0)
        file.truncate()  # takes away the header with the date of now
        file.write(f"date {date}\nbase hex  timestamps absolute\ninternal events logged\n")
        file.write(f"Begin Triggerblock {date}\n{0.0: 9.6f} Start of measurement\n")
        writer.header_written = True
        writer.started = start_s
        for message in chain(() if first is None else (first,), messages):
            writer.on_message_received(message)


_WRITERS: dict[str, Callable[[Path, Iterable[Message]], None]] = {
    ".blf": _write_blf,
    ".asc": _write_asc,
    ".log": _write_candump,
}
