"""Texts on their way to a terminal or a pipe; every command's go through here.

Names come from other people's files.  A character that the stream's encoding does not have is shown as an
escape, and so is a control character: a terminal would obey it.
"""

from __future__ import annotations

import io
import sys

# What a terminal obeys (C0 but tab and line feed, DEL, C1), and what turns the order of the text about.
_OBEYED = [*range(9), *range(11, 32), *range(127, 160)]
_TURNING = [0x200E, 0x200F, *range(0x2028, 0x202F), *range(0x2066, 0x206A), 0xFEFF]
_SHOWN = {c: f"\\x{c:02x}" for c in _OBEYED} | {c: f"\\u{c:04x}" for c in _TURNING}


def safe(text: str) -> str:
    """The text, with what a terminal would obey shown as escapes."""
    return text.translate(_SHOWN)


def prepare_streams() -> None:
    """What standard output and standard error cannot encode, they show as an escape."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper) and stream.errors in ("strict", "surrogateescape"):
            stream.reconfigure(errors="backslashreplace")


def say(text: str) -> None:
    """A line on standard output."""
    print(safe(text))


def warn(text: str) -> None:
    """A line on standard error."""
    print(safe(text), file=sys.stderr)
