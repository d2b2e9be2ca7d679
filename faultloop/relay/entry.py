"""How the chain calls a step that it does not know when it is compiled: by address.

An entry takes four addresses - shared constants, shared quantities, own constants, own state - and calls the
user's step with what is there.  Compiled entries are kept in a file cache under a fingerprint of the step's
code, of everything it refers to and of the values it closes over, so that neither a new process nor another
``make()`` with the same parameters compiles it again; a step with something in it that cannot be
fingerprinted is compiled anew.
"""

from __future__ import annotations

import ctypes
import hashlib
from collections.abc import Callable
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.core.ccallback import CFunc
from numba.core.dispatcher import Dispatcher
from numba.core.errors import TypingError
from numba.extending import intrinsic, overload
from numba.np.numpy_support import carray

from faultloop.errors import InputError
from faultloop.jit import keep_in, source_digest

POINTERS = (types.voidptr,) * 4
ENTRY = types.void(*POINTERS)
FOLDER = "user"
"""Of the cache."""
CALLBACK = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 4)


@intrinsic
def _call_entry(typing_context, address, g, q, c, w):
    """``entry(g, q, c, w)`` at ``address``: records g and q, addresses of c and w."""

    def generate(context, builder, signature, arguments):
        pointer = ir.IntType(8).as_pointer()
        kind = ir.FunctionType(ir.VoidType(), [pointer] * 4)
        entry = builder.inttoptr(arguments[0], kind.as_pointer())
        records = [builder.bitcast(record, pointer) for record in arguments[1:3]]
        builder.call(entry, records + [builder.inttoptr(place, pointer) for place in arguments[3:]])
        return context.get_dummy_value()

    return types.void(types.uint64, g, q, types.uint64, types.uint64), generate


call_entry: Any = _call_entry  # inside a kernel without the typing context


def nothing(result: object) -> None:
    """A step writes and returns nothing."""


@overload(nothing)
def _nothing(result):
    if isinstance(result, types.NoneType):
        return lambda result: None
    raise TypingError("it returns a value; it should write its results and return nothing")


def compiled_entry(source: str, step: Dispatcher, names: dict[str, Any]) -> Any:
    """The ``cfunc`` of ``def entry(g, q, c, w)`` in ``source``, with ``step`` and ``names`` as its globals.

    Raises
    ------
    InputError : ``step`` does not compile with what it is given.
    """
    mark = fingerprint(step, source, *names.values())
    unique = f"entry_{mark or 'unknown'}"
    space = {"__name__": __name__, "step": step, "nothing": nothing, "carray": carray, **names}
    exec(compile(source.replace("def entry(", f"def {unique}("), __file__, "exec"), space)
    entry = CFunc(space[unique], (ENTRY.args, ENTRY.return_type), {}, {"error_model": "numpy"})
    if mark is not None:
        keep_in(FOLDER, entry, space[unique])
    try:
        entry.compile()
        return entry
    except Exception as error:  # numba raises many types; all of them mean this
        raise InputError(f"step '{step.__name__}' does not compile: {_reason(error)}") from error


def cached_step(step: Dispatcher) -> Dispatcher:
    """A step of the user's, ``step(state, x, out)``, behind one that the file cache can keep."""
    mark = fingerprint(step)
    if mark is None:
        return step
    unique = f"{step.__name__}_{mark}"
    space = {"__name__": __name__, "step": step}
    source = f"def {unique}(state, x, out):\n    return step(state, x, out)"
    exec(compile(source, __file__, "exec"), space)
    kernel = numba.njit(error_model="numpy")(space[unique])
    keep_in(FOLDER, kernel, space[unique])
    return kernel


def _reason(error: Exception) -> str:
    """The line of a numba error that says what is wrong."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    telling = [line for line in lines if not line.startswith(("Failed in", "During:", "File", "<source"))]
    return (telling or lines or [type(error).__name__])[0]


class PythonEntry:
    """A plain Python step behind an address; what it raises is kept for the relay to raise."""

    def __init__(self, call: Callable[[int, int, int, int], None]) -> None:
        self.error: BaseException | None = None
        self._call = call
        self._callback = CALLBACK(self._enter)  # kept: it owns the machine code
        self.address = int(ctypes.cast(self._callback, ctypes.c_void_p).value or 0)

    def _enter(self, g: int, q: int, c: int, w: int) -> None:
        if self.error is None:
            try:
                self._call(g, q, c, w)
            except BaseException as error:  # whatever it is, it cannot pass through the kernel
                self.error = error


def at(address: int, dtype: np.dtype) -> Any:
    """The record at an address, with its fields as attributes, as in a kernel."""
    raw: Any = (ctypes.c_char * dtype.itemsize).from_address(address)
    return np.frombuffer(raw, dtype).view(np.recarray)[0]


class _Unknown(Exception):
    """Something whose value cannot be fingerprinted."""


def fingerprint(*values: Any) -> str | None:
    """Of everything that machine code made of these depends on; None where that cannot be said."""
    digest = hashlib.sha256(source_digest("relay").encode())
    try:
        _feed(values, digest.update, set())
    except _Unknown:
        return None
    return digest.hexdigest()[:24]


def _feed(value: Any, update: Callable[[bytes], None], seen: set[int]) -> None:
    if isinstance(value, Dispatcher):
        update(repr(sorted(value.targetoptions.items(), key=str)).encode())
        value = value.py_func
    if isinstance(value, np.dtype):
        update(f"{value.descr if value.names else value}{value.itemsize}".encode())
    elif isinstance(value, FunctionType):
        if id(value) not in seen:
            seen.add(id(value))
            _feed_function(value, update, seen)
    elif isinstance(value, np.ndarray):
        update(f"{value.dtype}{value.shape}".encode() + np.ascontiguousarray(value).tobytes())
    elif isinstance(value, (tuple, list)):
        for item in value:
            _feed(item, update, seen)
    elif isinstance(value, (bool, int, float, complex, str, bytes, np.generic, type(None))):
        update(f"{type(value).__name__} {value!r}".encode())
    elif isinstance(value, type) or type(value).__name__ in ("builtin_function_or_method", "ufunc"):
        update(getattr(value, "__name__", "").encode())
    else:
        raise _Unknown(repr(value))


def _feed_function(function: FunctionType, update: Callable[[bytes], None], seen: set[int]) -> None:
    names: set[str] = set()
    _feed_code(function.__code__, update, names)
    for cell in function.__closure__ or ():
        _feed(cell.cell_contents, update, seen)
    for name in sorted(names):
        value = function.__globals__.get(name)
        if isinstance(value, ModuleType):
            update(value.__name__.encode())
            if value.__name__.partition(".")[0] not in ("math", "cmath", "numpy", "numba"):
                for used in sorted(names):
                    _feed(getattr(value, used, None), update, seen)
        elif value is not None:
            _feed(value, update, seen)


def _feed_code(code: CodeType, update: Callable[[bytes], None], names: set[str]) -> None:
    update(code.co_code)
    names.update(code.co_names)
    update(" ".join(code.co_names + code.co_varnames + code.co_freevars).encode())
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            _feed_code(constant, update, names)
        else:
            update(repr(constant).encode())
