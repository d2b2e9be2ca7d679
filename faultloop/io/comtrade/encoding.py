"""Which encoding the names in a .cfg have: the standard long said ASCII, and devices wrote what they had."""

from __future__ import annotations

import re

_HIGH_RUN = re.compile(rb"[\x80-\xff]+")
_COMMON_HANZI = range(0xB0, 0xD8)  # lead bytes of GB 2312's first level, the common characters
_CYRILLIC = frozenset((*range(0xC0, 0x100), 0xA8, 0xB8, 0xB9))  # cp1251: letters, yo, numero sign


def decode(data: bytes, encoding: str | None = None) -> tuple[str, str]:
    """Text and the encoding it was decoded with.

    UTF-16 if it begins with its mark; UTF-8 if it is that; GB 18030 if every run of bytes above 0x7F is valid
    there and most characters are common ones; cp1251 if most such bytes are Cyrillic letters and stand in
    words of their own; else cp1252 (Latin), whose letters stand among ASCII ones.  A given `encoding` is used
    as it is.
    """
    if encoding is not None:
        return data.decode(encoding, errors="replace"), encoding
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return data.decode("utf-16", errors="replace"), "utf-16"
    try:
        return data.decode("utf-8-sig"), "utf-8"
    except UnicodeDecodeError:
        pass
    for name, fits in (("gb18030", _is_chinese), ("cp1251", _is_cyrillic)):
        if fits(data):
            return data.decode(name, errors="replace"), name
    return data.decode("cp1252", errors="replace"), "cp1252"


def _is_chinese(data: bytes) -> bool:
    try:
        text = data.decode("gb18030")
    except UnicodeDecodeError:
        return False
    high = [character for character in text if ord(character) > 0x7F]
    common = sum(_is_common(character) for character in high)
    return common >= 0.6 * len(high)


def _is_common(character: str) -> bool:
    code = character.encode("gb18030")
    return len(code) == 2 and code[0] in _COMMON_HANZI and code[1] >= 0xA1


def _is_cyrillic(data: bytes) -> bool:
    runs = [match.span() for match in _HIGH_RUN.finditer(data)]
    high = [byte for start, stop in runs for byte in data[start:stop]]
    letters = sum(byte in _CYRILLIC for byte in high)
    among_ascii = sum(
        data[start - 1 : start].isalpha() or data[stop : stop + 1].isalpha() for start, stop in runs
    )
    return letters >= 0.8 * len(high) and among_ascii < 0.5 * len(runs)
