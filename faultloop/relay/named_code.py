"""Settings can name code, which then runs: what they name, and how it is refused."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

from faultloop.config.user_code import entry_point_names
from faultloop.errors import InputError
from faultloop.relay.settings import RelaySettings

_CODE = re.compile(r"^.+:[A-Za-z_][\w-]*$")
"""``package.module:name`` or ``file.py:name``, wherever it stands."""


def named_code(settings: RelaySettings) -> Iterator[tuple[str, str]]:
    """Each key that names code, and the code, as in ``element[MINE].function``, ``my.py:step``; what an
    installed package brings under a name counts, too."""
    brought = entry_point_names("faultloop.functions") + entry_point_names("faultloop.estimators")
    for key, text in _texts(settings.model_dump(by_alias=True), ""):
        if _CODE.match(text) or (key.endswith((".function", ".method")) and text in brought):
            yield key, text


def refuse_user_code(settings: RelaySettings) -> None:
    """InputError where the settings name code."""
    for key, code in named_code(settings):
        raise InputError(
            f"names code, '{code}', and user code was refused (--no-user-code)", file=settings.path, key=key
        )


def _texts(value: Any, key: str) -> Iterator[tuple[str, str]]:
    if isinstance(value, dict):
        for name, inner in value.items():
            yield from _texts(inner, f"{key}.{name}" if key else name)
    elif isinstance(value, (list, tuple)):
        for number, inner in enumerate(value):
            name = inner.get("name", number) if isinstance(inner, dict) else number
            yield from _texts(inner, f"{key}[{name}]")
    elif isinstance(value, str):
        yield key, value
