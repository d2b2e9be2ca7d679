"""``--set KEY=VALUE``: one value of a TOML file, in place of what it says."""

from __future__ import annotations

import tomllib
from typing import Any

from faultloop.errors import InputError, nearest


def apply_override(data: dict[str, Any], override: str) -> None:
    """``table.key=value`` or ``array.name-or-number.key=value`` into parsed TOML, in place."""
    key, equals, text = override.partition("=")
    parts = [p.strip() for p in key.split(".")]
    if not equals or len(parts) < 2 or not all(parts):
        raise InputError(
            f"'{override}' is not KEY=VALUE; KEY is table.key or array.name.key, as in fault.0.at_pu=0.5",
            key="--set",
        )
    value = _value(text.strip())
    here: Any = data
    for depth, part in enumerate(parts[:-1]):
        if isinstance(here, list):
            here = _member(here, part, ".".join(parts[:depth]), override)
        elif isinstance(here, dict):
            here = here.setdefault(part, {})
        else:
            raise InputError(f"'{override}': {'.'.join(parts[:depth])} is not a table", key="--set")
    if isinstance(here, list):
        raise InputError(f"'{override}': name one of {key.rpartition('.')[0]}, then its key", key="--set")
    if not isinstance(here, dict):
        raise InputError(f"'{override}': {key.rpartition('.')[0]} is not a table", key="--set")
    here[parts[-1]] = value


def _value(text: str) -> Any:
    """A TOML value; a bare word is a string (``fault.0.type=BC``), and .5 is a number."""
    try:
        return tomllib.loads(f"x = {text}")["x"]
    except tomllib.TOMLDecodeError:
        pass
    try:
        return float(text)
    except ValueError:
        return text


def _member(items: list[Any], part: str, where: str, override: str) -> Any:
    names = [item.get("name", "") if isinstance(item, dict) else "" for item in items]
    if part in names:
        return items[names.index(part)]
    if part.isdigit() and int(part) < len(items):
        return items[int(part)]
    raise InputError(
        f"'{override}': no {where} '{part}'; {nearest(part, [n or str(i) for i, n in enumerate(names)])}",
        key="--set",
    )
