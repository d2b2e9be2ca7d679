"""Checks of what a settings file may give an estimator; each failure names the key and the limit."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable
from typing import Any, TypeVar

from faultloop.errors import InputError

Make = TypeVar("Make", bound=Callable[..., Any])


def extends(base: Callable[..., Any]) -> Callable[[Make], Make]:
    """Show the keyword parameters of ``base`` beside the function's own, which takes them as ``**others``."""

    def shown(make: Make) -> Make:
        parameters = dict(inspect.signature(base).parameters)
        for name, parameter in inspect.signature(make).parameters.items():
            if parameter.kind is not parameter.VAR_KEYWORD:
                parameters[name] = parameter
        setattr(make, "__signature__", inspect.Signature(list(parameters.values())))  # noqa: B010
        return make

    return shown


def number(
    key: str, value: Any, *, above: float = -math.inf, least: float = -math.inf, most: float = math.inf
) -> float:
    """``value`` as a finite float with above < value, least <= value <= most; else InputError."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise InputError(f"{value!r} is not a finite number", key=key)
    if not value > above:
        raise InputError(f"{value:g} should be above {above:g}", key=key)
    if value < least:
        raise InputError(f"{value:g} should be at least {least:g}", key=key)
    if value > most:
        raise InputError(f"{value:g} should be at most {most:g}", key=key)
    return float(value)


def whole(key: str, value: Any, *, least: int, most: int = 2**31) -> int:
    """``value`` as an int with least <= value <= most (48.0 counts as 48); else InputError."""
    if number(key, value, least=least, most=most) != int(value):
        raise InputError(f"{value!r} should be a whole number", key=key)
    return int(value)


def choice(key: str, value: Any, known: tuple[str, ...]) -> str:
    """``value`` if it is one of ``known``; else InputError with the nearest."""
    if value not in known:
        from faultloop.errors import nearest

        raise InputError(f"unknown value {value!r}: {nearest(str(value), known)}", key=key)
    return value


def samples_per_cycle(sampling_hz: int, frequency_hz: float, *, least: float, method: str) -> float:
    """fs / f0, which need not be whole, if there are at least ``least``; else InputError."""
    per_cycle = sampling_hz / frequency_hz
    if per_cycle < least:
        raise InputError(
            f"{per_cycle:.4g} samples per cycle are too few for '{method}': at {frequency_hz:g} Hz it needs "
            f"sampling_hz of at least {math.ceil(least * frequency_hz)}",
            key="sampling_hz",
        )
    return per_cycle
