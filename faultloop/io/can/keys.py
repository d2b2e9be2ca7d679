"""The key file: who may read it, and what is in it.

default = "000102030405060708090a0b0c0d0e0f"

[senders]                     # for a relay or breaker that has its own
QA = "00112233445566778899aabbccddeeff"
"""

from __future__ import annotations

import os
import stat
from collections.abc import Iterable
from pathlib import Path

from faultloop.config.tables import read_toml
from faultloop.errors import InputError, nearest
from faultloop.io.can.authentication import KEY_BYTES


def load_keys(path: Path, senders: Iterable[str]) -> dict[str, bytes]:
    """The key of each sender.

    Raises
    ------
    InputError : the file is missing, others may read it, or a key, a sender's name or the whole is wrong.
    """
    senders = list(senders)
    _check_private(path)
    data, _ = read_toml(path)
    known = ("default", "senders")
    for key in data:
        if key not in known:
            raise InputError(f"unknown key; {nearest(key, known)}", file=path, key=key)
    own = data.get("senders", {})
    if not isinstance(own, dict):
        raise InputError('must be a table: [senders], then NAME = "KEY"', file=path, key="senders")
    for name in own:
        if name not in senders:
            raise InputError(
                f"no relay or breaker has this name; {nearest(name, senders)}",
                file=path,
                key=f"senders.{name}",
            )
    keys = {name: _key(text, path, f"senders.{name}") for name, text in own.items()}
    if "default" in data:
        default = _key(data["default"], path, "default")
        return {name: keys.get(name, default) for name in senders}
    for name in senders:
        if name not in keys:
            raise InputError(
                f"there is no key for '{name}': give it here, or a default", file=path, key="senders"
            )
    return keys


def _check_private(path: Path) -> None:
    """POSIX only: Windows has no mode bits that would say it."""
    try:
        found = path.stat()
    except (OSError, ValueError) as error:  # a path with a NUL is a ValueError
        why = getattr(error, "strerror", None) or error
        raise InputError(f"cannot be read: {why}; [can] keys names it", file=path) from None
    if os.name != "posix" or not stat.S_ISREG(found.st_mode):
        return
    mode = found.st_mode
    # who owns it may change its mode, and what is in it
    if found.st_uid not in (os.geteuid(), 0):
        raise InputError(
            f"belongs to another user (uid {found.st_uid}, this is {os.geteuid()}): its keys are not yours to"
            " trust; copy it",
            file=path,
        )
    if mode & 0o077:
        raise InputError(
            f"others than its owner may use it (mode {stat.S_IMODE(mode):04o}); `chmod 600` it", file=path
        )


def _key(text: object, path: Path, where: str) -> bytes:
    digits = 2 * KEY_BYTES
    if not isinstance(text, str):
        raise InputError(f"must be a string of {digits} hexadecimal digits", file=path, key=where)
    # The text of a wrong key is not shown: it may be a right one with a slip in it.
    if any(c not in "0123456789abcdefABCDEF" for c in text):
        raise InputError(f"must have hexadecimal digits only, {digits} of them", file=path, key=where)
    if len(text) != digits:
        raise InputError(
            f"must have {digits} hexadecimal digits ({KEY_BYTES} bytes), not {len(text)}",
            file=path,
            key=where,
        )
    return bytes.fromhex(text)
