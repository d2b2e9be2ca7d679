"""The keys of a table as Markdown, from its model: unit, default, values, meaning.

docs/settings.md is made so whole (`faultloop.relay.reference`), the tables of docs/scenario.md and
docs/campaigns.md in their places (docs/keys.py).
"""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from typing import Any

from faultloop.config.tables import Table
from faultloop.config.units import unit_of

LIMITS = (("minimum", "≥"), ("exclusiveMinimum", ">"), ("maximum", "≤"), ("exclusiveMaximum", "<"))
UNBOUNDED = 1e18
"""A limit of how many bits a number has, and not of what it means."""


def section(title: str, model: type[Table]) -> str:
    """A heading, what the table is, and its keys."""
    about = inspect.cleandoc(model.__doc__ or "").partition(": ")[2]
    lines = [f"## {title}", ""]
    if about:
        lines += [about[0].upper() + about[1:], ""]
    return "\n".join([*lines, *key_table(model)]) + "\n"


def key_table(model: type[Table]) -> list[str]:
    """Its lines."""
    return ["| key | unit | default | values | meaning |", "|---|---|---|---|---|", *_rows(model)]


def _rows(model: type[Table]) -> Iterator[str]:
    schema = model.model_json_schema()
    required = schema.get("required", ())
    for key, field in schema.get("properties", {}).items():
        default = "required" if key in required else _default(field.get("default"))
        meaning = " ".join(field.get("description", "").replace("``", "`").split())
        cells = (f"`{key}`", unit_of(key), default, _values(field), meaning)
        yield "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _default(value: Any) -> str:
    if value is None or value in ("", [], {}):
        return ""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(_default, value)) + "]"
    return f'"{value}"' if isinstance(value, str) else f"{value:.10g}"


def _values(field: dict[str, Any]) -> str:
    options = [option for option in field.get("anyOf", [field]) if option.get("type") != "null"]
    return " or ".join(dict.fromkeys(_one(option) for option in options))


def _one(option: dict[str, Any]) -> str:
    if inside := option.get("oneOf", option.get("anyOf")):
        return " or ".join(_one(own) for own in inside)
    if "$ref" in option:
        return "table"
    if "enum" in option:
        return ", ".join(_default(value) for value in option["enum"])
    if "const" in option:
        return _default(option["const"])
    form = "d" if option.get("type") == "integer" else "g"
    limits = [f"{sign} {option[k]:{form}}" for k, sign in LIMITS if abs(option.get(k, 1e99)) < UNBOUNDED]
    match option.get("type"):
        case "array" if "prefixItems" in option:
            return f"{len(option['prefixItems'])} numbers"
        case "array":
            many = option.get("minItems") if option.get("minItems") == option.get("maxItems") else None
            inside = _one(option.get("items", {}))
            return f"list: {inside}" if many is None else f"list of {many}: {inside}"
        case "object" if "properties" in option:
            return "{ " + ", ".join(option["properties"]) + " }"
        case "object":
            return "table"
        case "boolean":
            return "true, false"
        case "string" if option.get("format") == "date-time":
            return "date and time"
        case "string":
            return "text"
        case "integer":
            return " ".join(["whole", ", ".join(limits)]).strip()
        case None:
            return "any"
        case _:
            return ", ".join(limits) or "number"
