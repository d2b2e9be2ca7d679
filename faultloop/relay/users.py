"""A user's own element: a plain function ``step(state, x, out)``.

x = one phasor row and one loop row (26 float64), out = [pickup, operate] (above 0.5 is on), state = the
element's float64 array.  It runs as Python while it is being written; decorated with ``numba.njit`` it runs
compiled, through the same machine code as the estimators.
"""

from __future__ import annotations

import importlib
import importlib.util
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from faultloop.errors import InputError, nearest
from faultloop.relay.functions.element import ElementSettings
from faultloop.relay.settings import RelaySettings
from faultloop.relay.step import Runner, block_runner

WIDTH = 26
OUT = 2


class UserElement:
    """A user's function and its state."""

    def __init__(self, name: str, run: Runner, state: NDArray[np.float64]) -> None:
        self.name = name
        self.run = run  # (state, rows (n, 26), out (n, 2))
        self.state = state


def load_elements(settings: RelaySettings) -> list[UserElement]:
    """The elements that the settings name.  Raises InputError."""
    base = settings.path.parent if settings.path else Path()
    result = []
    for element in settings.element:
        try:
            run = block_runner(_load(element, base))
        except InputError as error:
            key = f"element[{element.name}].function"
            raise InputError(error.what, file=settings.path, key=key) from error
        result.append(UserElement(element.name, run, np.array(element.state, np.float64)))
    return result


def _load(element: ElementSettings, base: Path) -> Callable[..., Any]:
    place, _, name = element.function.rpartition(":")
    module = _module_of_file(base / place) if place.endswith(".py") else _module(place)
    step = getattr(module, name, None)
    if not callable(step):
        known = [n for n, value in vars(module).items() if callable(value) and not n.startswith("_")]
        raise InputError(f"{place} has no function '{name}'; {nearest(name, known)}")
    return step


def _module(name: str) -> ModuleType:
    try:
        return importlib.import_module(name)
    except Exception as error:  # a user's module may raise anything while it is imported
        raise InputError(f"module '{name}' cannot be imported ({error!r})") from error


def _module_of_file(path: Path) -> ModuleType:
    if not path.is_file():
        raise InputError(f"no such file '{path}'")
    name = f"faultloop_user_{path.stem}"
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise InputError(f"'{path}' is not a Python file")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # numba finds a function's globals through it
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise InputError(f"'{path}' cannot be run ({error!r})") from error
    return module
