"""Files that are whole or not there: everything that this program writes goes aside first, and is renamed.

A file aside has a name of its own, made exclusively: whatever stands there already (another run's, a FIFO, a
link) is neither followed nor written to.
"""

from __future__ import annotations

import contextlib
import os
import re
import secrets
import stat
import time
from collections.abc import Iterator
from contextlib import contextmanager
from io import BufferedWriter
from pathlib import Path

from faultloop.errors import InputError

try:
    import fcntl
except ImportError:  # Windows: there two runs to one log keep apart by their names only
    fcntl = None

_EXCLUSIVE = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)
_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISLNK, "a link"),
    (stat.S_ISFIFO, "a FIFO"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
    (stat.S_ISSOCK, "a socket"),
)


def check_target(path: Path, suffix: str | None = None) -> None:
    """Raises InputError where no file of this name can be made: another suffix, a folder, a FIFO, a link."""
    if suffix is not None and path.suffix.lower() != suffix:
        better = path.with_suffix(suffix).name if path.name else f"output{suffix}"
        raise InputError(f"must end in {suffix}, as in {better}", file=path)
    try:
        mode = path.lstat().st_mode
    except (FileNotFoundError, NotADirectoryError):
        return  # free, or its folder is missing: opening it tells
    except (OSError, ValueError) as error:
        raise InputError(f"cannot be written: {_reason(error)}", file=path) from error
    if not stat.S_ISREG(mode):
        kind = next((name for is_kind, name in _KINDS if is_kind(mode)), "no regular file")
        raise InputError(f"cannot be written: it is {kind}; give the name of a file", file=path)


def _reason(error: Exception) -> str:
    return getattr(error, "strerror", None) or str(error)


class OutputFiles:
    """Files that get their names together, when the block ends without an exception; else none is left.

    Raises InputError where one cannot be written; ``path`` is the one that the user named.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self._aside: dict[Path, Path] = {}  # in order of their making: the last gets its name last

    def new(self, path: Path) -> Path:
        """An empty file beside ``path`` to write to."""
        check_target(path)
        aside = path.with_name(f"{path.name}.{secrets.token_hex(4)}.tmp")
        self._aside[aside] = path
        os.close(os.open(aside, _EXCLUSIVE, 0o666))
        return aside

    def __enter__(self) -> OutputFiles:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: object) -> None:
        try:
            if kind is None:
                for aside, path in self._aside.items():
                    aside.replace(path)
        except OSError as failure:
            raise InputError(f"cannot be written: {_reason(failure)}", file=self.path) from failure
        finally:
            for aside in self._aside:
                aside.unlink(missing_ok=True)
        if isinstance(error, OSError) and not isinstance(error, BrokenPipeError):
            raise InputError(f"cannot be written: {_reason(error)}", file=self.path) from error


@contextmanager
def missing_folders(folder: Path) -> Iterator[None]:
    """Makes ``folder`` and those above it that are missing; without them again where the block fails."""
    made = []
    try:
        for one in [*reversed(folder.parents), folder]:
            if not one.exists():
                one.mkdir()
                made.append(one)
        yield
    except BaseException as error:
        for one in reversed(made):
            with contextlib.suppress(OSError):  # something else has come into it
                one.rmdir()
        if isinstance(error, OSError):
            raise InputError(f"cannot be written: {_reason(error)}", file=folder) from error
        raise


@contextmanager
def write_aside(path: str | Path, suffix: str | None = None) -> Iterator[Path]:
    """Gives a file beside ``path`` to write to; it gets its name when the block ends without an exception.

    Raises InputError where ``path`` does not end in ``suffix`` or cannot be written.
    """
    path = Path(path)
    check_target(path, suffix)
    with OutputFiles(path) as files:
        yield files.new(path)


# -- a log in the making ---------------------------------------------------------------------------------


def parts_of(path: Path) -> list[Path]:
    """What runs that were cut off have left of the log ``path``, the newest first."""
    ours = re.compile(re.escape(path.name) + r"(\.\d+)?\.part")
    found: list[tuple[int, Path]] = []
    with contextlib.suppress(OSError):  # no such folder
        for other in path.parent.iterdir():
            if ours.fullmatch(other.name) and other.is_file() and other.stat().st_size:
                found.append((-other.stat().st_mtime_ns, other))
    return [part for _, part in sorted(found)]


def open_part(path: Path) -> tuple[Path, BufferedWriter]:
    """A new ``path.part``, opened for writing; ``path.2.part`` beside what a killed run has left.

    Raises InputError where another run is writing this log at the moment: each would give its own the name.
    """
    check_target(path)
    for number in range(1, 10_000):
        part = path.with_name(path.name + (".part" if number == 1 else f".{number}.part"))
        try:
            descriptor = os.open(part, _EXCLUSIVE, 0o666)
        except FileExistsError:
            if _is_being_written(part):
                raise InputError(
                    f"another run is writing this log ({part.name}); give this run a --log of its own",
                    file=path,
                ) from None
            continue
        except (OSError, ValueError) as error:
            raise InputError(f"cannot be written: {_reason(error)}", file=path) from error
        if fcntl is not None:
            with contextlib.suppress(OSError):  # a file system without locks
                fcntl.flock(descriptor, fcntl.LOCK_EX)
        return part, BufferedWriter(os.fdopen(descriptor, "wb", buffering=0))
    raise InputError("thousands of .part files of this log are there; remove or recover them", file=path)


@contextmanager
def reserved(path: Path) -> Iterator[None]:
    """Keeps other runs off the log ``path`` until its file is put there; raises InputError as `open_part`."""
    part, stream = open_part(path)
    try:
        yield
    finally:
        stream.close()
        part.unlink(missing_ok=True)


def new_folder(path: Path) -> Path:
    """Makes the folder ``path``, or where that is there one with a number before its suffix."""
    for number in range(1, 10_000):
        folder = path if number == 1 else path.with_name(f"{path.stem}.{number}{path.suffix}")
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            continue
        except OSError as error:
            raise InputError(f"cannot be made: {_reason(error)}", file=folder) from error
        return folder
    raise InputError("thousands of folders of this name are there; remove them", file=path)


def _is_being_written(part: Path) -> bool:
    """Whether somebody holds the lock of a part.  An empty one may be about to be locked: looked at again."""
    if fcntl is None:
        return False
    for _ in range(20):
        try:
            descriptor = os.open(part, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
        except OSError:  # gone, or a link
            return False
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if os.fstat(descriptor).st_size or not stat.S_ISREG(os.fstat(descriptor).st_mode):
                return False
        except BlockingIOError:
            return True
        except OSError:
            return False
        finally:
            os.close(descriptor)
        time.sleep(0.01)
    return False
