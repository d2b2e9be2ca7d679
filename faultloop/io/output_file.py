"""A file that is whole or not there."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from faultloop.errors import InputError


@contextmanager
def write_aside(path: str | Path, suffix: str) -> Iterator[Path]:
    """Gives a path beside ``path`` to write to; it gets its name when the block ends without an exception.

    Raises InputError where ``path`` does not end in ``suffix`` or cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() != suffix:
        raise InputError(
            f"must end in {suffix}, as in {path.with_suffix(suffix).name or 'review' + suffix}", file=path
        )
    if path.is_dir():  # else only the last step, after the work, would find it out
        raise InputError("cannot be written: it is a folder", file=path)
    aside = path.with_name(path.name + ".part")
    try:
        aside.touch()  # what is wrong with the path shows before the work
        yield aside
        aside.replace(path)
    except OSError as error:
        raise InputError(f"cannot be written: {error.strerror or error}", file=path) from error
    finally:
        aside.unlink(missing_ok=True)
