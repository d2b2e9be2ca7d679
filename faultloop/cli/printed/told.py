"""What the types of printed objects have in common."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from pydantic import ConfigDict, TypeAdapter, with_config

told = with_config(ConfigDict(use_attribute_docstrings=True))
"""What keys say of themselves is in the schema."""
Cell = str | float | bool | None
"""Of a table, or a value that was varied."""


def told_with(base: Any) -> Callable[[Any], Any]:
    """The same of a type that has the keys of another, too: pydantic reads a type's own text alone."""

    def complete(schema: dict[str, Any]) -> None:
        for key, field in TypeAdapter(base).json_schema(mode="serialization")["properties"].items():
            schema["properties"][key].setdefault("description", field["description"])

    return with_config(ConfigDict(use_attribute_docstrings=True, json_schema_extra=complete))
