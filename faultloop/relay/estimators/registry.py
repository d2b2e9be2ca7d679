"""The estimators by name.  A method is one module in ``methods/``; to add one is to add that file.

The module ``methods/half_fourier.py`` serves ``method = "half-fourier"``.  It has one function
``make(sampling_hz, frequency_hz, *, parameter=default, ...) -> Estimator``, and is imported when it is
asked for.
"""

from __future__ import annotations

import inspect
import pkgutil
from collections.abc import Callable
from functools import cache
from importlib import import_module
from typing import Any

from faultloop.errors import InputError, nearest
from faultloop.relay.estimators import methods as _methods
from faultloop.relay.estimators.base import Estimator
from faultloop.relay.estimators.parameters import number, whole

_registered: dict[str, Callable[..., Estimator]] = {}


def register(name: str, make: Callable[..., Estimator]) -> None:
    """Add an estimator of your own: ``make(sampling_hz, frequency_hz, *, ...) -> Estimator``."""
    _registered[name] = make


@cache  # to list a folder takes 0.5 ms
def _own() -> frozenset[str]:
    return frozenset(module.name.replace("_", "-") for module in pkgutil.iter_modules(_methods.__path__))


def estimator_methods() -> tuple[str, ...]:
    """Names of all estimators, sorted; nothing is imported."""
    return tuple(sorted(_own() | _registered.keys()))


def is_own(method: str) -> bool:
    """Whether a name is that of an estimator of this package."""
    return method in _own() and method not in _registered


def _maker(method: str) -> Callable[..., Estimator]:
    if method in _registered:
        return _registered[method]
    if method not in estimator_methods():
        raise InputError(
            f"unknown estimator '{method}': {nearest(method, estimator_methods())}", key="method"
        )
    return import_module(f"{_methods.__name__}.{method.replace('-', '_')}").make


def estimator_parameters(method: str) -> dict[str, Any]:
    """Names and defaults of a method's parameters.  Raises InputError for an unknown method."""
    return _parameters(_maker(method))


def _parameters(make: Callable[..., Estimator]) -> dict[str, Any]:
    given = inspect.signature(make).parameters.values()
    return {p.name: p.default for p in given if p.kind is p.KEYWORD_ONLY}


def make_estimator(method: str, sampling_hz: int, frequency_hz: float, **parameters: Any) -> Estimator:
    """An estimator by its name in the settings.

    Parameters
    ----------
    method : one of `estimator_methods()`.
    sampling_hz : samples per second [Hz], whole.
    frequency_hz : nominal frequency f0 [Hz].
    parameters : the method's own, see `estimator_parameters`.

    Raises
    ------
    InputError : unknown method or parameter, or a value outside its limits; names the limit.
    """
    return build_estimator(_maker(method), method, sampling_hz, frequency_hz, **parameters)


def build_estimator(
    make: Callable[..., Estimator], method: str, sampling_hz: int, frequency_hz: float, **parameters: Any
) -> Estimator:
    """An estimator by its maker, a user's own included; ``method`` is its name.  Raises InputError."""
    known = _parameters(make)
    for key in parameters:
        if key not in known:
            raise InputError(f"'{method}' has no such parameter: {nearest(key, known)}", key=key)
    sampling_hz = whole("sampling_hz", sampling_hz, least=1)
    frequency_hz = number("frequency_hz", frequency_hz, above=0.0)
    return make(sampling_hz, frequency_hz, **parameters)
