"""What a file must be before anything is read from it: a regular one, of a size that makes sense."""

from __future__ import annotations

import stat
from pathlib import Path

from faultloop.errors import InputError

_KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a pipe",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFSOCK: "a socket",
}


def check_input(path: Path | str, what: str, most_bytes: int | None = None) -> int:
    """The file's size.  ``what`` names what is needed, as in ``a TOML file``.

    Raises InputError where it is missing, no regular file (a pipe would be waited for, a device never ends),
    larger than ``most_bytes``, or not this user's to read.
    """
    path = Path(path)
    try:
        found = path.stat()
        if stat.S_ISREG(found.st_mode):
            path.open("rb").close()
    except FileNotFoundError:
        raise InputError("no such file", file=path) from None
    except (OSError, ValueError) as error:  # a path with a NUL is a ValueError
        raise InputError(f"cannot be read ({getattr(error, 'strerror', None) or error})", file=path) from None
    if not stat.S_ISREG(found.st_mode):
        kind = _KINDS.get(stat.S_IFMT(found.st_mode), "no regular file")
        raise InputError(f"is {kind}; {what} is needed", file=path)
    if most_bytes is not None and found.st_size > most_bytes:
        raise InputError(
            f"has {found.st_size / 2**20:.0f} MiB; {what} of at most {most_bytes // 2**20} is read", file=path
        )
    return found.st_size
