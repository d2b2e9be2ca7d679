"""Kernels that kernels call are linked once, at the root.

numba makes each kernel ready to run by itself: it links the code of all that the kernel calls, optimises the
whole and translates it; what lies five calls deep is optimised and translated five times.  Here what a kernel
calls is a *part*: its code is kept as it came until the root, the kernel that Python calls, links all parts,
its own and those of its parts, and optimises and translates them together.

A kernel of faultloop's is both: a dispatcher that Python calls, and one for parts.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any

import numba
from numba.core import config as numba_config
from numba.core import registry, sigutils, types
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.environment import lookup_environment

Dispatcher: Any = registry.CPUDispatcher
config: Any = numba_config
ENVIRONMENT = "_ZN08NumbaEnv"
"""How numba begins the names of variables that hold a function's environment."""
OURS = "_ZN9faultloop"
"""And those of functions of this package."""

_own: list[Any] = []
"""Functions of kernels being compiled, the innermost last; in the one thread that holds numba's lock."""


class _Silent:
    """A code generator for code that is not there to run yet: no place for an environment."""

    def __init__(self, codegen: Any) -> None:
        self._codegen = codegen

    def __getattr__(self, name: str) -> Any:
        return getattr(self._codegen, name)

    def set_env(self, name: str, env: Any) -> None:
        """At the root."""


class _Part(JITCodeLibrary):
    """A kernel's own code, neither linked nor optimised."""

    parts: tuple[Any, ...] = ()

    @property
    def codegen(self) -> Any:
        return _Silent(self._codegen)

    def finalize(self) -> None:
        self.parts, self._linking_libraries = tuple(self._linking_libraries), []
        super().finalize()

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        self._ensure_finalized()
        return 0


class _Root(JITCodeLibrary):
    """A kernel with all its parts."""

    def finalize(self) -> None:
        module: Any = self._final_module
        origin = _origins(self._linking_libraries)
        self._linking_libraries = []
        # What nothing refers to yet is left out of a link, so a library may be wanted again.
        while missing := dict.fromkeys(origin[name] for name in _declared(module) if name in origin):
            for library in missing:
                self._reload_init.update(library._reload_init)
                module.link_in(library._get_module_for_linking(), preserve=True)
        super().finalize()

    def _optimize_final_module(self) -> None:
        """Operations of the same kind side by side go into vectors, which changes no bit of a result.  numba
        leaves that out."""
        given, config.SLP_VECTORIZE = config.SLP_VECTORIZE, 1  # under numba's lock
        try:
            super()._optimize_final_module()
        finally:
            config.SLP_VECTORIZE = given

    def _verify_declare_only_symbols(self) -> None:
        super()._verify_declare_only_symbols()
        for name in _declared(
            self._final_module
        ):  # it would run here by another's copy, and not from the cache
            if name.startswith(OURS):
                raise AssertionError(f"{self.name}: {name} is not linked")

    def _finalize_specific(self) -> None:
        super()._finalize_specific()
        codegen: Any = self._codegen
        for variable in self._final_module.global_variables:
            if variable.name.startswith(ENVIRONMENT) and not variable.is_declaration:
                env = lookup_environment(variable.name)
                if env is not None:
                    codegen.set_env(variable.name, env)


def _declared(module: Any) -> list[str]:
    return [function.name for function in module.functions if function.is_declaration]


def _origins(libraries: Iterable[Any]) -> dict[str, Any]:
    """Of the functions of libraries and of all their parts: which has them."""
    origin: dict[str, Any] = {}
    seen: set[Any] = set()
    waiting = list(libraries)
    while waiting:
        library = waiting.pop()
        if library not in seen:
            seen.add(library)
            waiting.extend(getattr(library, "parts", ()))
            defined = library._get_module_for_linking().functions
            origin.update((function.name, library) for function in defined if not function.is_declaration)
    return origin


@contextmanager
def _compiling(function: Any) -> Iterator[None]:
    _own.append(function)
    try:
        yield
    finally:
        _own.pop()


class _Compiler(Compiler):
    def compile_extra(self, func: Any) -> Any:
        with _compiling(func):
            compiled: Any = super().compile_extra(func)
        if not self.state.flags.nrt and _has_array(compiled.signature.return_type):
            raise AssertionError(f"{func.__qualname__} returns an array without counting a reference to it")
        return compiled


class _PartCompiler(_Compiler):
    def compile_extra(self, func: Any) -> Any:
        self.state.library = _Part(self.state.targetctx.codegen(), func.__qualname__)
        return super().compile_extra(func)


class _RootCompiler(_Compiler):
    def compile_extra(self, func: Any) -> Any:
        self.state.library = _Root(self.state.targetctx.codegen(), func.__qualname__)
        self.state.library.enable_object_caching()
        return super().compile_extra(func)


def _has_array(kind: Any) -> bool:
    return isinstance(kind, types.Buffer) or any(_has_array(part) for part in getattr(kind, "types", ()))


class Kernel(Dispatcher):
    """What Python calls; a kernel of faultloop's that calls it takes its part."""

    part: Any

    @property
    def is_compiling(self) -> Any:
        """Whether a call of it may be one of itself."""
        return self._compiling_counter or self.part.is_compiling

    def compile(self, sig: Any) -> Any:
        """As numba does; a kernel that cannot be compiled keeps nobody waiting (`faultloop.jit`)."""
        try:
            return super().compile(sig)
        except BaseException:
            give_up = getattr(self._cache, "give_up", None)
            if give_up is not None:
                give_up()
            raise

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """What numba asks for when it finds out the types of a call.

        A constant is an argument like others: numba would compile a kernel for each it is called with, and
        the optimiser sees those of what it inlines anyway.
        """
        folded = tuple(types.unliteral(kind) for kind in self._compiler.fold_argument_types(args, kws)[1])
        callers = self.typingctx.callstack
        ours = bool(callers and _own) and callers[0].func_id.func is _own[-1]
        if ours and folded not in self.overloads:
            return self.part.get_call_template(folded, {})
        return super().get_call_template(folded, {})

    def get_overload(self, sig: Any) -> Any:
        """And when it writes the call."""
        known = tuple(sigutils.normalize_signature(sig)[0]) in self.overloads
        return super().get_overload(sig) if known else self.part.get_overload(sig)


def kernel(function: Callable[..., Any], options: dict[str, Any]) -> Any:
    """``numba.njit`` of a function, as a `Kernel`."""
    made: Any = numba.njit(**options, pipeline_class=_RootCompiler)(function)
    if isinstance(made, Dispatcher):  # not where compilation is off
        made.__class__ = Kernel
        options = options | {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
        made.part = numba.njit(**options, pipeline_class=_PartCompiler)(function)
    return made
