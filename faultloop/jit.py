"""The one compiler decorator.

numba's file cache keys on the file that holds a function, so a caller keeps the stale machine code of a
callee that changed in another file (numba issue 1833).  The cache directory is therefore keyed by a digest
of the kernel-bearing sources that a kernel may call (`CALLS`): ``plant`` and ``relay`` share no code, so each
has a digest of its own; what is called by its `Address` need not be covered.
``fastmath`` stays off: a trip decision must be the same bits everywhere.

Without a place to keep machine code (no home, a read-only one) a folder of this user's in the temporary one
is taken; without that, nothing is kept.  `cache_note` says so.
"""

from __future__ import annotations

import hashlib
import os
import stat
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numba
from llvmlite import ir
from numba.core import config as numba_config
from numba.core import event, types
from numba.core.caching import FunctionCache
from numba.extending import intrinsic

config: Any = numba_config
PACKAGE = Path(__file__).parent
CALLS = {
    "plant": ("plant",),
    "relay": ("relay",),
    "io": ("io",),
    "nodes": ("nodes", "io"),
    "loop": ("loop", "nodes", "io"),  # plant and relay it calls by address
}
"""Subpackages whose kernels those of a subpackage may call; those of any other may call all."""


@cache
def source_digest(area: str) -> str:
    """Hex digest of the sources whose kernels those of ``faultloop/<area>`` may call, and of this file."""
    digest = hashlib.sha256(Path(__file__).read_bytes())
    covered = [PACKAGE / name for name in CALLS.get(area, ("",))]
    for path in sorted(path for folder in covered for path in folder.rglob("*.py")):
        source = path.read_bytes()
        if b"njit" in source:
            digest.update(path.relative_to(PACKAGE).as_posix().encode())
            digest.update(source)
    return digest.hexdigest()[:16]


class _Place(NamedTuple):
    root: Path | None
    note: str | None


def cache_root() -> Path | None:
    """Where compiled kernels are kept: ``$FAULTLOOP_CACHE``, else the platform's cache folder, else a folder
    of this user's in the temporary one; None where none of them can be written."""
    return _place().root


def cache_note() -> str | None:
    """One line for a person where the usual place cannot be used."""
    return _place().note


@cache
def _place() -> _Place:
    usual = _usual_place()
    if usual is not None and _writable(usual):
        return _Place(usual, None)
    trouble = "there is no home folder" if usual is None else f"{usual} cannot be written"
    aside = _own_temporary_folder()
    where = "are not kept" if aside is None else f"are kept in {aside}"
    return _Place(aside, f"{trouble}: compiled kernels {where}; FAULTLOOP_CACHE names a place of your own")


def _usual_place() -> Path | None:
    if given := os.environ.get("FAULTLOOP_CACHE"):
        return Path(given)
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or tempfile.gettempdir()) / "faultloop" / "cache"
    if given := os.environ.get("XDG_CACHE_HOME"):
        return Path(given) / "faultloop"
    try:
        return Path.home() / ".cache" / "faultloop"
    except RuntimeError:  # neither HOME nor an entry in passwd
        return None


def _writable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except (OSError, ValueError):
        return False
    return True


def _own_temporary_folder() -> Path | None:
    """Nobody else's: what lies in it is loaded as code."""
    if sys.platform == "win32":
        return None
    try:
        folder = Path(tempfile.gettempdir()) / f"faultloop-{os.getuid()}"
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
    except OSError:
        return None
    own = stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o022
    return folder if own and _writable(folder) else None


class _First(event.Listener):
    def __init__(self, tell: Callable[[], None]) -> None:
        self.tell: Callable[[], None] | None = tell

    def on_start(self, event: event.Event) -> None:
        tell, self.tell = self.tell, None
        if tell is not None:
            tell()

    def on_end(self, event: event.Event) -> None:
        pass


def on_first_compilation(tell: Callable[[], None]) -> None:
    """Have ``tell`` called once, when this process begins to compile a kernel that the cache has not."""
    event.register("numba:compile", _First(tell))


class _Cache(FunctionCache):
    """numba's; but a full disk or a damaged file in it costs compilation, not the run."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        try:
            return super().load_overload(sig, target_context)
        except Exception:  # what unpickling a damaged file may raise
            with suppress(OSError):
                self.flush()
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        with suppress(OSError):
            super().save_overload(sig, data)


class Address(types.WrapperAddressProtocol):
    """A compiled kernel as a value that others take and call.

    They are compiled without it: neither is its code compiled again within theirs, nor they when it changes.

    Parameters
    ----------
    arguments : their numba types.
    """

    def __init__(self, kernel: Any, *arguments: Any) -> None:
        kernel.compile(arguments)
        self._compiled = kernel.overloads[arguments]  # kept: it owns the machine code
        name = self._compiled.fndesc.llvm_cfunc_wrapper_name
        self.address = int(self._compiled.library.get_pointer_to_function(name))

    def __wrapper_address__(self) -> int:
        return self.address

    def signature(self) -> Any:
        return self._compiled.signature


@intrinsic
def _call_step(typing_context, address, state, x, out):
    """``step(state, x, out)`` of the `Address` of a step, which takes three arrays and returns nothing."""

    def generate(context, builder, signature, arguments):
        kinds = [context.get_value_type(kind) for kind in signature.args[1:]]
        kind = ir.FunctionType(context.get_value_type(types.none), kinds)
        builder.call(builder.inttoptr(arguments[0], kind.as_pointer()), arguments[1:])
        return context.get_dummy_value()

    return types.void(types.int64, state, x, out), generate


call_step: Any = _call_step  # inside a kernel without the typing context


@contextmanager
def cache_folder(name: str) -> Iterator[None]:
    """What is decorated within is kept in this folder of the cache (numba chooses as it decorates); only
    where there is a `cache_root`."""
    before = config.CACHE_DIR
    config.CACHE_DIR = str((cache_root() or Path()) / name)
    try:
        yield
    finally:
        config.CACHE_DIR = before


def njit(function: Callable[..., Any] | None = None, **options: Any) -> Any:
    """``numba.njit`` with a file cache and IEEE arithmetic; ``@njit`` or ``@njit(inline="always")``.

    With ``signature_or_function`` it is compiled at once, for that signature only.
    """
    options = {"cache": True, "fastmath": False, "error_model": "numpy"} | options
    kept, signature = options.pop("cache"), options.pop("signature_or_function", None)

    def decorate(function: Callable[..., Any]) -> Any:
        kernel = numba.njit(**options)(function)
        if kept:
            _keep(kernel, function)
        if signature is not None:
            kernel.compile(signature)
            kernel.disable_compile()
        return kernel

    return decorate if function is None else decorate(function)


def inner(function: Callable[..., Any] | None = None, **options: Any) -> Any:
    """`njit` for what only kernels call: it has no entry from Python and no place in the cache, as its code
    is in its callers'.  To make both takes longer than the kernel itself where that has a hundred arrays."""
    return njit(function, **{"cache": False, "no_cpython_wrapper": True, "no_cfunc_wrapper": True} | options)


def _keep(kernel: Any, function: Callable[..., Any]) -> None:
    """Give a kernel its file cache, where there is a place for one."""
    package, _, rest = function.__module__.partition(".")
    if package != "faultloop":  # a user's own kernel: numba's own place, if it finds one
        with suppress(RuntimeError):
            kernel._cache = _Cache(function)
    else:
        area = rest.partition(".")[0]
        keep_in(f"{area}-{source_digest(area)}", kernel, function)


def keep_in(folder: str, kernel: Any, function: Callable[..., Any]) -> None:
    """Give a kernel made of ``function`` its file cache in a folder of the cache, where there is a place."""
    if cache_root() is not None:
        with cache_folder(folder):
            kernel._cache = _Cache(function)
