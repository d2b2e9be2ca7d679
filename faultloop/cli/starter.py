"""The files that ``faultloop new`` gives: those of the repository, which a wheel carries along."""

from __future__ import annotations

import shutil
from pathlib import Path

from faultloop.errors import InputError

PACKAGE = Path(__file__).resolve().parents[1]
FILES = ("scenarios/*.toml", "scenarios/settings/*.toml", "campaigns/*.toml", "examples/*.py")


def starter_files() -> dict[str, Path]:
    """Where each file comes from, by its place in the new folder."""
    carried = PACKAGE / "starter"
    base = carried if carried.is_dir() else PACKAGE.parent
    return {
        path.relative_to(base).as_posix(): path for pattern in FILES for path in sorted(base.glob(pattern))
    }


def make_starter(folder: Path) -> list[Path]:
    """Copy them into a folder that is empty or not there yet.  Raises InputError for any other."""
    files = starter_files()
    try:
        if folder.exists() and not folder.is_dir():
            raise InputError("is a file; a new or an empty folder is needed", file=folder)
        if folder.is_dir() and any(folder.iterdir()):
            raise InputError("is not empty; a new or an empty folder is needed", file=folder)
        for name, source in files.items():
            target = folder / name
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(source, target)
    except OSError as error:
        raise InputError(f"cannot be written ({error.strerror or error})", file=folder) from None
    return [folder / name for name in files]
