"""Code of the user's own, by name: ``file.py:name``, ``package.module:name``, or the name of an entry point.

An installed package registers what it brings under the groups ``faultloop.functions``,
``faultloop.estimators`` or ``faultloop.sinks`` of its entry points; nothing is imported before it is asked
for.
"""

from __future__ import annotations

import importlib
import importlib.util
import sys
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType
from typing import Any

from faultloop.errors import InputError, nearest


def load(reference: str, base: Path, group: str) -> Any:
    """What ``reference`` names; a file is looked for in ``base``.

    Raises
    ------
    InputError : no such file, module, name or entry point, or an error while it is imported.
    """
    if ":" not in reference:
        return _entry_point(reference, group)
    place, _, name = reference.rpartition(":")
    module = _module_of_file(base / place) if place.endswith(".py") else _module(place)
    if not hasattr(module, name):
        known = [n for n, value in vars(module).items() if not n.startswith("_") and not _imported(value)]
        raise InputError(f"{place} has no '{name}'; {nearest(name, known)}")
    return getattr(module, name)


def entry_point_names(group: str) -> tuple[str, ...]:
    """Names that installed packages have registered; nothing is imported."""
    return _names(group, tuple(sys.path))


@cache  # looked up in the file system: 20 to 50 ms
def _names(group: str, _: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(sorted(entry_points(group=group).names))


def _entry_point(name: str, group: str) -> Any:
    for found in entry_points(group=group, name=name):
        try:
            return found.load()
        except (Exception, SystemExit) as error:  # somebody's package may raise anything while it is imported
            raise InputError(f"'{name}' ({found.value}) cannot be imported ({error!r})") from error
    what = f"no installed package brings '{name}' ({group}); {nearest(name, entry_point_names(group))}"
    raise InputError(f"{what}; a file of your own is 'file.py:name'")


def _imported(value: Any) -> bool:
    return isinstance(value, ModuleType)


def _module(name: str) -> ModuleType:
    try:
        return importlib.import_module(name)
    except (Exception, SystemExit) as error:
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
    except (Exception, SystemExit) as error:
        raise InputError(f"'{path}' cannot be run ({error!r})") from error
    return module
