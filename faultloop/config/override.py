"""``KEY=VALUE``: one value of parsed TOML, set from the command line, a campaign or a script.

KEY is ``table.key`` or ``array.member.key``; a member is its ``name``, or its place.  In a scenario places
count from 0, as in a list; in relay settings from 1, as in the instances' names: ``pdis.1`` is PDIS1.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

from faultloop.errors import InputError, nearest

OPTION = "--set"
Read = TypeVar("Read")
SETTING_PARTS = 4
"""``relay.NAME.table.key``: with fewer it is a key of the scenario's own ``[[relay]]``."""
MOST_DIGITS = 9
"""Of a place."""
PLACE_TABLES = ("front_end",)
"""Tables of the scenario's own ``[[relay]]``."""


def apply_override(data: dict[str, Any], override: str) -> None:
    """``fault.F1.resistance_ohm=5`` into a parsed scenario, in place."""
    key, value = split_override(override)
    set_key(data, key, value, first=0, said=override)


def split_override(override: str) -> tuple[str, Any]:
    """Key and value of ``KEY=VALUE``."""
    key, equals, text = override.partition("=")
    parts = [part.strip() for part in key.split(".")]
    if not equals or len(parts) < 2 or not all(parts):
        raise _error(
            f"'{override}' is not KEY=VALUE; KEY is table.key or array.name.key, as in fault.0.at_pu=0.5"
        )
    return ".".join(parts), _value(text.strip())


def setting_of(key: str, relays: Sequence[str]) -> tuple[str, str] | None:
    """Relay and key in its settings of ``relay.RA.pdis.1.reach_pu``; None for a key of the scenario.

    Parameters
    ----------
    key : of an override.
    relays : names of the scenario's relays, in its order.
    """
    parts = key.split(".")
    if parts[0] != "relay" or len(parts) < SETTING_PARTS or parts[2] in PLACE_TABLES:
        return None
    name = parts[1]
    if name not in relays and is_place(name) and int(name) < len(relays):
        name = relays[int(name)]
    if name not in relays:
        raise _error(f"'{key}': there is no relay '{name}'; {nearest(name, list(relays))}")
    return name, ".".join(parts[2:])


def override_settings(data: Mapping[str, Any], key: str, value: Any) -> dict[str, Any]:
    """Parsed relay settings with one value changed: ``pdis.1.reach_pu``; ``data`` stays as it is.

    Raises
    ------
    InputError : no such table, or no place for the key.  Whether the value is right is the settings' affair.
    """
    result = copied(data)
    set_key(result, key, value, first=1, said=key)
    return result


def set_key(data: dict[str, Any], key: str, value: Any, *, first: int, said: str) -> None:
    """Set ``key`` in parsed TOML, in place; ``first`` is the number of an array's first member."""
    parts = key.split(".")
    here: Any = data
    for depth, part in enumerate(parts[:-1]):
        where = ".".join(parts[:depth])
        if isinstance(here, list):
            here = _member(here, part, where, first, said)
        elif isinstance(here, dict):
            if part not in here and is_place(parts[depth + 1]):
                raise _error(f"'{said}': there is no [[{part}]]")
            here = here.setdefault(part, {})
        else:
            raise _error(f"'{said}': {where} is not a table")
    parent = ".".join(parts[:-1])
    if isinstance(here, list):
        raise _error(f"'{said}': name one of {parent}, then its key")
    if not isinstance(here, dict):
        raise _error(f"'{said}': {parent} is not a table")
    here[parts[-1]] = value


def is_place(part: str) -> bool:
    """Whether it counts members: digits as they are typed, and no more of them than any list needs."""
    return part.isascii() and part.isdigit() and len(part) <= MOST_DIGITS


def _member(items: list[Any], part: str, where: str, first: int, said: str) -> Any:
    names = [item.get("name", "") if isinstance(item, dict) else "" for item in items]
    if part in names:
        return items[names.index(part)]
    if is_place(part) and 0 <= int(part) - first < len(items):
        return items[int(part) - first]
    known = [(isinstance(name, str) and name) or str(number) for number, name in enumerate(names, first)]
    raise _error(f"'{said}': no {where} '{part}'; {nearest(part, known)}")


def overridden(read: Callable[[Sequence[str]], Read], overrides: Sequence[str], file: object = None) -> Read:
    """``read(overrides)``; what is wrong with ``file`` only because of them is an error of ``--set``."""
    try:
        return read(overrides)
    except InputError as error:
        if not overrides or OPTION in (error.key, error.file):
            raise
        read(())  # where the file is wrong by itself, that is told
        other = error.file if error.file not in (None, str(file)) else None
        key = ": ".join(part for part in (other, error.key) if part)
        raise InputError(error.what, file=OPTION, key=key or None) from None


def _value(text: str) -> Any:
    """A TOML value; a bare word is a string (``fault.0.type=BC``), and .5 is a number."""
    try:
        return tomllib.loads(f"x = {text}")["x"]
    except RecursionError:
        raise InputError("its brackets are nested too deep", key="--set") from None
    except ValueError:
        pass
    try:
        return float(text)
    except ValueError:
        return text


def copied(value: Any) -> Any:
    """Tables and arrays copied, values not."""
    if isinstance(value, Mapping):
        return {key: copied(item) for key, item in value.items()}
    return [copied(item) for item in value] if isinstance(value, list) else value


def _error(what: str) -> InputError:
    return InputError(what, key="--set")
