"""A user's own functions, as the settings' ``[[element]]`` tables name them.

``function`` names either a `Function`, with everything that a built-in one has, or a plain function
``step(state, x, out)``: x = one phasor row and one loop row (26 float64), out = [pickup, operate] (above 0.5
is on), state = the element's float64 array.  A step runs as Python while it is being written, and compiled
once it is decorated with ``njit``.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numba.core.dispatcher import Dispatcher
from numpy.typing import NDArray

from faultloop.config.tables import Table, validate
from faultloop.config.user_code import load
from faultloop.errors import InputError, nearest
from faultloop.relay.entry import PythonEntry, at, compiled_entry
from faultloop.relay.functions.element import ElementSettings
from faultloop.relay.functions.function import Function
from faultloop.relay.quantities import CONSTANTS, QUANTITIES, publish

ROW = 26
OUT = 2

RECORDS_ENTRY = """
def entry(g, q, c, w):
    shared, quantities = carray(g, 1, CONSTANTS), carray(q, 1, QUANTITIES)
    own = carray(c, 1, OWN)[0]
    try:
        nothing(step(shared[0], quantities[0], own, carray(w, 1, STATE)[0]))
    except Exception:
        own.failed = 1
"""

ARRAYS_ENTRY = """
def entry(g, q, c, w):
    own = carray(c, 1, OWN)[0]
    mine = carray(w, OUT + ROW + own.length, FLOAT)  # out, x, state
    measured = carray(q, ROW, FLOAT)  # phasors, frequency and loops are first in the quantities
    for k in range(ROW):
        mine[OUT + k] = measured[k]
    mine[0] = 0.0
    mine[1] = 0.0
    try:
        nothing(step(mine[OUT + ROW :], mine[OUT : OUT + ROW], mine[:OUT]))
    except Exception:
        own.failed = 1
    publish(carray(q, 1, QUANTITIES)[0], own.bit, mine[0] > 0.5, mine[1] > 0.5)
"""


class NoSettings(Table):
    """A plain function has no parameters but its state."""


@dataclass(frozen=True, eq=False)
class UserElement:
    """A user's function, ready for the chain: constants and state of its own, and where to call it."""

    name: str
    function: Function
    table: Any
    constants: NDArray[np.void]
    state: NDArray[Any]
    entry: Any

    @property
    def addresses(self) -> dict[str, int]:
        """For the chain."""
        return {
            "entry": self.entry.address,
            "constants": self.constants.ctypes.data,
            "state": self.state.ctypes.data,
        }

    @property
    def error(self) -> BaseException | None:
        """What its code has raised; of a compiled one numba does not say what."""
        if isinstance(self.entry, PythonEntry):
            if isinstance(self.entry.error, KeyboardInterrupt):
                raise self.entry.error
            return self.entry.error
        return RuntimeError("its compiled code raises") if self.constants["failed"][0] else None


def load_elements(settings: Any) -> list[UserElement]:
    """The elements that the relay settings name.  Raises InputError."""
    base = settings.path.parent if settings.path else Path()
    result = []
    for element in settings.element:
        try:
            found = load(element.function, base, "faultloop.functions")
            result.append(_element(element, found, settings))
        except InputError as error:
            key = f"element[{element.name}].{error.key or 'function'}"
            raise InputError(error.what, file=settings.path, key=key) from error
    return result


def _element(element: ElementSettings, found: Any, settings: Any) -> UserElement:
    if isinstance(found, Function):
        return _with_records(element, found, settings)
    return _with_arrays(element, found)


def _with_records(element: ElementSettings, function: Function, settings: Any) -> UserElement:
    if element.state:
        raise InputError(f"'{function.name}' has a state of its own; it is not set", key="state")
    table = validate(function.settings, element.parameters)
    constants = _constants(function)
    try:
        for key, value in function.values(settings, table).items():
            constants[key] = value
    except InputError:
        raise
    except Exception as error:
        raise InputError(f"the values of '{function.name}' are none ({error!r})") from error
    state = function.initial_state(1)
    names = {"OWN": constants.dtype, "STATE": state.dtype}

    def call(g: int, q: int, c: int, w: int) -> None:
        function.step(at(g, CONSTANTS), at(q, QUANTITIES), at(c, constants.dtype), at(w, state.dtype))

    entry = _entry(RECORDS_ENTRY, function.step, names, call)
    return UserElement(element.name, function, table, constants, state, entry)


def _constants(function: Function) -> NDArray[np.void]:
    """(1,) of the function's constants, and whether its compiled step has raised."""
    fields = function.constants_dtype.fields or {}
    return np.zeros(1, np.dtype([*((k, f[0]) for k, f in fields.items()), ("failed", "i8")], align=True))


def _with_arrays(element: ElementSettings, step: Any) -> UserElement:
    if not inspect.isroutine(step) and not isinstance(step, Dispatcher):
        raise InputError(f"'{element.function}' is neither a function nor a Function")
    for key in element.parameters:
        known = nearest(key, ElementSettings.model_fields)
        raise InputError(f"unknown key; {known} (a plain step has no parameters of its own)", key=key)
    function = Function("ELEMENT", NoSettings, step, constants=(("length", "i8"),))
    constants = _constants(function)
    constants["length"] = len(element.state)
    mine = np.array([*np.zeros(OUT + ROW), *element.state], np.float64)
    names = {"OWN": constants.dtype, "OUT": OUT, "ROW": ROW, "FLOAT": np.float64, "publish": publish}

    def call(g: int, q: int, c: int, w: int) -> None:
        quantities = at(q, QUANTITIES)
        mine[:OUT] = 0.0
        mine[OUT : OUT + ROW] = at(q, np.dtype([("row", "f8", (ROW,))])).row
        step(mine[OUT + ROW :], mine[OUT : OUT + ROW], mine[:OUT])
        publish.py_func(quantities, int(constants["bit"][0]), mine[0] > 0.5, mine[1] > 0.5)

    entry = _entry(ARRAYS_ENTRY, step, names, call)
    return UserElement(element.name, function, NoSettings(), constants, mine, entry)


def _entry(source: str, step: Any, names: dict[str, Any], call: Callable[..., None]) -> Any:
    if not isinstance(step, Dispatcher):
        return PythonEntry(call)
    return compiled_entry(source, step, {"CONSTANTS": CONSTANTS, "QUANTITIES": QUANTITIES, **names})
