"""The suites by name: each a module of this folder with ``PARTS`` and ``run(parts, *, quick, progress)``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Any

from faultloop.errors import InputError, nearest
from faultloop.study.report import Report

SUITES = {
    "bus": "a breaker node under fuzzed frames; the bus under faults",
    "differential": "line differential of two and three ends",
    "distance": "type tests of the distance relay, in the style of IEC 60255-121",
    "estimators": "every estimator over decay constants, inception angles, noise and frequency",
    "functions": "validation cases of every function and component, curves, parallel lines, reclosing",
    "schemes": "pilot schemes at both ends of a line",
    "seeds": "the five papers' cases, their figures beside ours",
    "synchrophasor": "the class tests of IEC/IEEE 60255-118-1",
}


def run_suite(
    name: str,
    parts: Sequence[str] = (),
    *,
    quick: bool = False,
    progress: Callable[[float], Any] | None = None,
    **more: Any,
) -> list[Report]:
    """Run a suite, or parts of it by name.

    Parameters
    ----------
    quick : fewer cases and seeds, for tests and CI; the reports say so.
    progress : called with the part done, 0 to 1.
    more : what only some suites take, as their ``TAKES`` says; None is not given.

    Raises InputError for an unknown suite or part.
    """
    if name not in SUITES:
        raise InputError(f"there is no suite '{name}'; {nearest(name, SUITES)}", key="suite")
    module = import_module(f"faultloop.study.suites.{name}")
    unknown = [part for part in parts if part not in module.PARTS]
    if unknown:
        raise InputError(
            f"'{unknown[0]}' is no part of {name}; {nearest(unknown[0], module.PARTS)}", key="suite"
        )
    given = {key: value for key, value in more.items() if value is not None}
    for key in given:
        if key not in getattr(module, "TAKES", ()):
            raise InputError(f"{name} takes none; leave it out", key=f"--{key}")
    return module.run(
        list(parts) or list(module.PARTS), quick=quick, progress=progress or (lambda part: None), **given
    )
