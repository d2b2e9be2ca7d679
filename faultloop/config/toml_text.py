"""Parsed TOML as text again (tomllib only reads)."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from datetime import date, datetime, time
from typing import Any


def toml_text(data: Mapping[str, Any]) -> str:
    """A file that parses to ``data``: tables, arrays of tables, and values inline."""
    lines: list[str] = []
    _table(data, (), lines)
    return "\n".join(lines) + "\n"


def _table(data: Mapping[str, Any], place: tuple[str, ...], lines: list[str]) -> None:
    inner = {key: value for key, value in data.items() if isinstance(value, Mapping) or _is_array(value)}
    lines += [f"{_key(key)} = {_value(value)}" for key, value in data.items() if key not in inner]
    for key, value in inner.items():
        path = ".".join(map(_key, (*place, key)))
        if isinstance(value, Mapping):
            lines += ["", f"[{path}]"]
            _table(value, (*place, key), lines)
            continue
        for item in value:
            lines += ["", f"[[{path}]]"]
            _table(item, (*place, key), lines)


def _is_array(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(item, Mapping) for item in value)


def _key(key: str) -> str:
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else _string(key)


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (int, float)):
        return repr(value)
    if isinstance(value, (datetime, date, time)):
        return value.isoformat()
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(_value, value))}]"
    if isinstance(value, Mapping):
        return f"{{ {', '.join(f'{_key(key)} = {_value(item)}' for key, item in value.items())} }}"
    return _string(str(value))


def _string(text: str) -> str:
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
