"""Writes the tables of keys in docs/scenario.md and docs/campaigns.md from the models of these files, and
docs/json.md from the types of what commands print.

python docs/keys.py                 # writes them anew, between <!-- keys: TABLE --> and <!-- end -->
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, get_args

from pydantic import TypeAdapter

from faultloop.cli.printed import PRINTED
from faultloop.config.campaign import CampaignTables
from faultloop.config.key_table import key_table
from faultloop.config.tables import Table
from faultloop.loop.scenario import Scenario

FOLDER = Path(__file__).parent
PAGES: dict[str, type[Any]] = {"scenario.md": Scenario, "campaigns.md": CampaignTables}
PLACE = re.compile(r"<!-- keys: ([\w.]+) -->\n.*?<!-- end -->", re.DOTALL)


JSON = """# What commands print with --json

Made by `python docs/keys.py` from the types that the published schemas are made of: `faultloop schema NAME`
prints the JSON Schema (2020-12) of each. Keys may be added, never taken away or renamed. Times `*_s`, `*_ns`
count from the start of the run, `*_ms` from the fault's inception where nothing else is said; a number that
is none (NaN) is null. Wrong input is one line on standard error, with exit status 2, and nothing on standard
output.
"""


def filled(text: str, whole: type[Any]) -> str:
    """The page with the tables that its marks name.  Raises KeyError for one that the model does not have."""

    def table(mark: re.Match[str]) -> str:
        lines = key_table(model_of(whole, mark[1]))
        return "\n".join([f"<!-- keys: {mark[1]} -->", *lines, "<!-- end -->"])

    return PLACE.sub(table, text)


def tables(whole: type[Any]) -> list[str]:
    """The names of all that a file may hold: ``vt``, and ``vt.circuit`` for a table inside."""
    found = []
    for name, field in whole.model_fields.items():
        for model in _models(field.annotation):
            own = field.alias or name
            found += [own, *(f"{own}.{inner}" for inner in tables(model))]
    return found


def model_of(whole: type[Any], path: str) -> type[Table]:
    """The model of a table."""
    for part in path.split("."):
        field = next((f for name, f in whole.model_fields.items() if (f.alias or name) == part), None)
        if field is None:
            raise KeyError(path)
        (whole,) = _models(field.annotation)
    return whole


def _models(annotation: Any) -> list[type[Table]]:
    if isinstance(annotation, type) and issubclass(annotation, Table):
        return [annotation]
    return [model for inner in get_args(annotation) for model in _models(inner)]


def json_page() -> str:
    """docs/json.md: what each command prints, and once each what is in it."""
    parts: list[str] = [JSON]
    shared: dict[str, Any] = {}
    for name, printed in PRINTED.items():
        schema = TypeAdapter(printed).json_schema(mode="serialization")
        for own, model in schema.get("$defs", {}).items():
            if shared.setdefault(own, model) != model or own.lower() in PRINTED:
                raise ValueError(f"two types are called {own}")
        parts.append(f"## {name}\n")
        parts.append("\n".join(_keys(schema)) if "properties" in schema else f"{_type(schema)}\n")
    for own in sorted(own for own, model in shared.items() if "properties" in model):
        parts.append(f"## {own}\n")
        parts.append("\n".join(_keys(shared[own])))
    return "\n".join(parts)


def _keys(schema: dict[str, Any]) -> list[str]:
    about = " ".join(schema.get("description", "").replace("``", "`").split())
    lines = [*([about, ""] if about else []), "| key | what it is | meaning |", "|---|---|---|"]
    for key, field in schema["properties"].items():
        missing = "" if key in schema.get("required", ()) or "default" in field else ", or not there"
        meaning = " ".join(field["description"].replace("``", "`").split())
        lines.append(f"| `{key}` | {_type(field)}{missing} | {meaning} |".replace("\\|", "|"))
    return [*lines, ""]


def _type(field: dict[str, Any]) -> str:
    """A JSON Schema's type in words."""
    if "$ref" in field:
        name = field["$ref"].rpartition("/")[2]
        return f"[{name}](#{name.lower()})" if name != "Cause" else "text"
    if "anyOf" in field:
        return " or ".join(dict.fromkeys(map(_type, field["anyOf"])))
    if "enum" in field or "const" in field:
        return ", ".join(f"`{value}`" for value in field.get("enum", [field.get("const")]))
    if "prefixItems" in field:
        return f"list: {', '.join(map(_type, field['prefixItems']))}"
    match field.get("type"):
        case "array":
            return f"list of {_type(field['items'])}"
        case "object":
            inside = field.get("additionalProperties")
            return f"by name: {_type(inside)}" if isinstance(inside, dict) else "object"
        case "string":
            return "text"
        case "boolean":
            return "true, false"
        case "integer":
            return "whole number"
        case None:
            return "any"
        case other:
            return str(other)


if __name__ == "__main__":
    (FOLDER / "json.md").write_text(json_page(), encoding="utf-8")
    for page, whole in PAGES.items():
        path = FOLDER / page
        path.write_text(filled(path.read_text(encoding="utf-8"), whole), encoding="utf-8")
