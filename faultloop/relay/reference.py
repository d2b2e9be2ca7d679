"""The reference of all keys of relay settings, from their models: ``python -m faultloop.relay.reference``.

It writes docs/settings.md to standard output; a test holds the file to it.
"""

from __future__ import annotations

import inspect
import sys
from collections.abc import Iterator
from typing import Any

from faultloop.config.tables import Table
from faultloop.relay.functions import FUNCTIONS
from faultloop.relay.functions.function import Function
from faultloop.relay.settings import EstimatorSettings, Header, LineSettings, VtSettings

UNITS = {
    "_ohm": "ohm",
    "_ms": "ms",
    "_deg": "degrees",
    "_pu": "per unit",
    "_cycles": "cycles",
    "_km": "km",
    "_kv": "kV",
    "_hz": "Hz",
    "_a": "A",
    "_v": "V",
}
LIMITS = (("minimum", "≥"), ("exclusiveMinimum", ">"), ("maximum", "≤"), ("exclusiveMaximum", "<"))
HEAD = """# Relay settings: every key

Made from the settings' models by `python -m faultloop.relay.reference`, and held to them by a test; what the
functions do is in docs/relay.md. With `ohms = "secondary"` every ohm, ampere and volt is secondary.
"""


def reference() -> str:
    """The whole page, Markdown."""
    parts = [HEAD]
    tables = (("relay", Header), ("estimator", EstimatorSettings), ("line", LineSettings), ("vt", VtSettings))
    for key, model in tables:
        parts.append(_section(f"`[{key}]`", model))
    for function in FUNCTIONS:
        parts.append(_section(_title(function), function.settings))
    return "\n".join(parts)


def _title(function: Function) -> str:
    if function.most > 1:
        return f"`[[{function.key}]]`, up to {function.most}"
    return f"`[{function.key}]`" if function.always else f"`[{function.key}]`, there if it is given"


def _section(title: str, model: type[Table]) -> str:
    about = inspect.cleandoc(model.__doc__ or "").partition(": ")[2]
    lines = [f"## {title}", ""]
    if about:
        lines += [about[0].upper() + about[1:], ""]
    lines += ["| key | unit | default | values | meaning |", "|---|---|---|---|---|", *_rows(model)]
    return "\n".join(lines) + "\n"


def _rows(model: type[Table]) -> Iterator[str]:
    schema = model.model_json_schema()
    required = schema.get("required", ())
    for key, field in schema.get("properties", {}).items():
        default = "required" if key in required else _default(field.get("default"))
        meaning = " ".join(field.get("description", "").replace("``", "`").split())
        yield f"| `{key}` | {_unit(key)} | {default} | {_values(field)} | {meaning} |"


def _unit(key: str) -> str:
    return next((unit for tail, unit in UNITS.items() if key.endswith(tail)), "")


def _default(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(_default, value)) + "]"
    return f'"{value}"' if isinstance(value, str) else f"{value:g}"


def _values(field: dict[str, Any]) -> str:
    options = [option for option in field.get("anyOf", [field]) if option.get("type") != "null"]
    return " or ".join(dict.fromkeys(_one(option) for option in options))


def _one(option: dict[str, Any]) -> str:
    if "oneOf" in option:
        return " or ".join(_one(own) for own in option["oneOf"])
    if "$ref" in option:
        return "table"
    if "enum" in option:
        return ", ".join(_default(value) for value in option["enum"])
    if "const" in option:
        return _default(option["const"])
    limits = [f"{sign} {option[name]:g}" for name, sign in LIMITS if name in option]
    match option.get("type"):
        case "array" if "prefixItems" in option:
            return f"{len(option['prefixItems'])} numbers"
        case "array":
            return "list"
        case "boolean":
            return "true, false"
        case "string":
            return "text"
        case "integer":
            return " ".join(["whole", ", ".join(limits)]).strip()
        case _:
            return ", ".join(limits) or "number"


if __name__ == "__main__":
    sys.stdout.write(reference())
