"""The one compiler decorator.

numba's file cache keys on the file that holds a function, so a caller keeps the stale machine code of a
callee that changed in another file (numba issue 1833).  The cache directory is therefore keyed by a digest
of the kernel-bearing sources that a kernel may call: ``plant`` and ``relay`` share no code, so each has a
digest of its own; every other subpackage may call any kernel, so its digest covers the whole package.
``fastmath`` stays off: a trip decision must be the same bits everywhere.
"""

from __future__ import annotations

import hashlib
import os
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import numba
from numba.core import config as numba_config

config: Any = numba_config
PACKAGE = Path(__file__).parent
CLOSED = ("plant", "relay")
"""Subpackages whose kernels call only each other."""


@cache
def source_digest(area: str) -> str:
    """Hex digest of the sources whose kernels those of ``faultloop/<area>`` may call, and of this file."""
    digest = hashlib.sha256(Path(__file__).read_bytes())
    covered = PACKAGE / area if area in CLOSED else PACKAGE
    for path in sorted(covered.rglob("*.py")):
        source = path.read_bytes()
        if b"njit" in source:
            digest.update(path.relative_to(PACKAGE).as_posix().encode())
            digest.update(source)
    return digest.hexdigest()[:16]


def cache_root() -> Path:
    """Where compiled kernels are kept: ``$FAULTLOOP_CACHE``, else the platform's cache folder."""
    if given := os.environ.get("FAULTLOOP_CACHE"):
        return Path(given)
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or tempfile.gettempdir()) / "faultloop" / "cache"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "faultloop"


def is_warm() -> bool:
    """Whether the kernels of this version have been compiled on this machine before."""
    return all((cache_root() / f"{area}-{source_digest(area)}").is_dir() for area in CLOSED)


@contextmanager
def cache_folder(name: str) -> Iterator[None]:
    """What is decorated within is kept in this folder of the cache (numba chooses as it decorates)."""
    before = config.CACHE_DIR
    config.CACHE_DIR = str(cache_root() / name)
    try:
        yield
    finally:
        config.CACHE_DIR = before


def njit(function: Callable[..., Any] | None = None, **options: Any) -> Any:
    """``numba.njit`` with a file cache and IEEE arithmetic; ``@njit`` or ``@njit(inline="always")``."""
    options = {"cache": True, "fastmath": False, "error_model": "numpy"} | options

    def decorate(function: Callable[..., Any]) -> Any:
        package, _, rest = function.__module__.partition(".")
        if not options["cache"] or package != "faultloop":  # a user's own kernel: numba's own place
            return numba.njit(**options)(function)
        area = rest.partition(".")[0]
        with cache_folder(f"{area}-{source_digest(area)}"):
            return numba.njit(**options)(function)

    return decorate if function is None else decorate(function)
