"""The one compiler decorator.

numba's file cache keys on the path and time of the file that holds a function, so a caller keeps the stale
machine code of a callee that changed in another file (numba issue 1833), and every checkout compiles anew.
The cache is therefore keyed by a digest of the sources of all that a kernel may call (`CALLS`), and by that
alone: ``plant`` and ``relay`` share no code, so each has a digest of its own; what is called by its `Address`
need not be covered.
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
from collections.abc import Callable
from contextlib import suppress
from functools import cache, partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple, cast

import numba
from llvmlite import ir
from numba.core import event, types
from numba.core.caching import FunctionCache
from numba.extending import intrinsic

from faultloop import linking

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None

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
    """Hex digest of the sources whose kernels those of ``faultloop/<area>`` may call, and of this file; all
    of them, as kernels have in them the constants of modules that have no kernel."""
    digest = hashlib.sha256(Path(__file__).read_bytes() + Path(linking.__file__).read_bytes())
    covered = [PACKAGE / name for name in CALLS.get(area, ("",))]
    for path in sorted(path for folder in covered for path in folder.rglob("*.py")):
        digest.update(path.relative_to(PACKAGE).as_posix().encode())
        digest.update(path.read_bytes())
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

    def holds_something(self) -> bool:
        return Path(self._cache_file._index_path).exists()


class _Locator:
    """Where numba keeps a kernel: by the folder's digest of all sources, so that checkouts and installations
    of the same ones share it, whatever their paths and times are."""

    def __init__(self, function: Callable[..., Any], folder: Path) -> None:
        self._folder = folder / function.__module__
        self._line = function.__code__.co_firstlineno

    def get_cache_path(self) -> str:
        return str(self._folder)

    def ensure_cache_path(self) -> None:
        self._folder.mkdir(parents=True, exist_ok=True)

    def get_source_stamp(self) -> str:
        return ""

    def get_disambiguator(self) -> str:
        return str(self._line)


class _Impl(FunctionCache._impl_class):
    def __init__(self, function: Callable[..., Any], folder: Path) -> None:
        locator = _Locator(function, folder)
        self._locator_classes = [SimpleNamespace(from_function=lambda *_: locator)]
        super().__init__(function)


class _SharedCache(_Cache):
    """In a folder of ours.  Of two processes that need the same machine code one makes it, and the other
    waits and loads it.

    A kernel's lock is taken before those of what it calls, in every process: nobody waits in a circle.  One
    that dies leaves no lock behind.
    """

    def __init__(self, function: Callable[..., Any], folder: Path) -> None:
        self._impl_class = partial(_Impl, folder=folder)
        super().__init__(function)

    _lock: int | None = None

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        found = super().load_overload(sig, target_context)
        if found is None and self._wait_for_turn():
            found = super().load_overload(sig, target_context)
            if found is not None:
                self._release()
        return found

    def save_overload(self, sig: Any, data: Any) -> None:
        try:
            super().save_overload(sig, data)
        finally:
            self._release()

    def give_up(self) -> None:
        """There will be nothing to save: whoever waits may try."""
        self._release()

    def _wait_for_turn(self) -> bool:
        """Whether anybody else had to be waited for."""
        if fcntl is None or self._lock is not None:
            return False
        try:
            self._impl.locator.ensure_cache_path()
            self._lock = os.open(
                self._cache_file._index_path + ".lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC
            )
            try:
                fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                fcntl.flock(self._lock, fcntl.LOCK_EX)
                return True
        except OSError:  # a file system without locks: each compiles for itself
            self._release()
        return False

    def _release(self) -> None:
        lock, self._lock = self._lock, None
        if lock is not None:
            os.close(lock)


def compiled(kernel: Any, *arguments: Any) -> Any:
    """The machine code of a kernel for arguments of the types of these: it is called as the kernel is, and
    with no others."""
    kinds = tuple(cast(Any, numba.typeof)(argument) for argument in arguments)
    kernel.compile(kinds)
    return kernel.overloads[kinds].entry_point


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


def _caller(result: Any) -> Any:
    @intrinsic
    def call(typing_context, address, arguments):
        def generate(context, builder, signature, given):
            values = [builder.extract_value(given[1], place) for place in range(len(arguments))]
            kinds = [context.get_value_type(kind) for kind in arguments]
            kind = ir.FunctionType(context.get_value_type(result), kinds)
            called = builder.call(builder.inttoptr(given[0], kind.as_pointer()), values)
            return context.get_dummy_value() if result == types.void else called

        return result(types.int64, arguments), generate

    return call


call_for_number: Any = _caller(types.int64)
"""``kernel(*arguments)`` of the `Address` of a kernel that returns a whole number; ``arguments`` a tuple.  An
`Address` itself, as an argument, costs Python 0.1 ms a call and may swallow a KeyboardInterrupt."""
call_for_nothing: Any = _caller(types.void)
"""And of one that returns nothing."""


def njit(function: Callable[..., Any] | None = None, **options: Any) -> Any:
    """``numba.njit`` with a file cache and IEEE arithmetic; ``@njit`` or ``@njit(forceinline=True)``.

    With ``signature_or_function`` it is compiled at once, for that signature only.

    A kernel of the subpackages in `CALLS` is lent its arrays and makes none, so it counts no references to
    them: each call that passes a network's hundred arrays counted them up and down, a third of a campaign's
    case.  One that does make an array says ``heap=True``; numba refuses it otherwise.

    ``forceinline`` is the optimiser's; ``inline="always"`` is numba's, on the source, anew at each of 400
    calls: a fifth of a first run's 80 s of compilation.  That is for what returns an array.
    """
    options = {"cache": True, "fastmath": False, "error_model": "numpy"} | options
    kept, signature = options.pop("cache"), options.pop("signature_or_function", None)
    heap = options.pop("heap", False)

    def decorate(function: Callable[..., Any]) -> Any:
        package, _, rest = function.__module__.partition(".")
        counts = heap or package != "faultloop" or rest.partition(".")[0] not in CALLS
        kernel = linking.kernel(function, options | {"_nrt": counts})
        if kept:
            _keep(kernel, function)
        if signature is not None:
            kernel.compile(signature)
            kernel.disable_compile()
        return kernel

    return decorate if function is None else decorate(function)


def is_kept(kernel: Any) -> bool:
    """Whether machine code of a kernel is in the cache; False also where there is no cache."""
    return isinstance(kernel._cache, _Cache) and kernel._cache.holds_something()


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
    root = cache_root()
    if root is not None:
        kernel._cache = _SharedCache(function, root / folder)
