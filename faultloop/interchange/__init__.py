"""Settings of other makers' tools, to and from faultloop's: RIO, XRIO, SEL text.

Facts on the formats: OMICRON's published RIO and XRIO reference manuals (VESD5000, VESD5015), SEL instruction
manuals (settings files SET_n.TXT).  What a file says and is not understood is listed, and nothing is guessed.
"""

from __future__ import annotations

from pathlib import Path

from faultloop.config.input_file import check_input
from faultloop.errors import InputError
from faultloop.interchange.model import Given, Taken
from faultloop.interchange.rio import read_rio
from faultloop.interchange.sel import read_sel
from faultloop.interchange.xrio import read_xrio

MOST_BYTES = 32 << 20


def read_settings(path: Path, given: Given) -> Taken:
    """A settings file of another tool.

    Parameters
    ----------
    path : told apart by its content.
    given : what the file may not say.

    Raises
    ------
    InputError : it cannot be read, is none of these formats, or has no zone that could be taken.
    """
    check_input(path, "a settings file", MOST_BYTES)
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", file=path) from error
    text = _decoded(raw)
    head = text.lstrip("\ufeff \t\r\n")
    if head[:1] == "<":
        reader = read_xrio
    elif head[:5].upper() == "BEGIN":
        reader = read_rio
    elif head[:1] == "[":
        reader = read_sel
    else:
        raise InputError(
            "is no RIO (begins with BEGIN), XRIO (XML) or SEL text ([INFO]) settings file", file=path
        )
    try:
        return reader(head, given)
    except InputError as error:
        raise InputError(str(error), file=path) from error


def _decoded(raw: bytes) -> str:
    for encoding in ("utf-8-sig", "utf-16") if raw[:2] in (b"\xff\xfe", b"\xfe\xff") else ("utf-8-sig",):
        try:
            return raw.decode(encoding)
        except UnicodeDecodeError:
            continue
    return raw.decode("latin-1")
