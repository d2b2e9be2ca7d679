"""TOML files as pydantic models, and their errors as one line that names file and key."""

from __future__ import annotations

import cmath
import inspect
import math
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar, get_args

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    GetJsonSchemaHandler,
    ValidationError,
    WithJsonSchema,
)
from pydantic_core import CoreSchema

from faultloop.config.input_file import check_input
from faultloop.config.units import unit_of
from faultloop.errors import InputError, nearest

MOST_BYTES = 8 * 2**20
"""Of a TOML file that is read."""
MOST_NESTED = 32
MOST_QUOTED = 100
"""Characters of a wrong value that a message repeats."""
LEAST, MOST = 1e-12, 1e12
"""Of a number's size, but for 0."""


class Table(BaseModel):
    """A TOML table: unknown keys refused, numbers finite, never changed after validation."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, strict=True, allow_inf_nan=False, use_attribute_docstrings=True
    )

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        """A number's unit stands beside it, and a table that says nothing itself says what its model says."""
        schema = handler(core)
        for key, field in handler.resolve_ref_schema(schema).get("properties", {}).items():
            if unit := unit_of(key):
                field["unit"] = unit
            about = field.get("description") or next(map(about_table, _tables(cls, key)), "")
            if about:
                field["description"] = about
        return schema


def _tables(model: type[BaseModel], key: str) -> list[type[BaseModel]]:
    """The models of tables that a key holds."""
    found = next((f for name, f in model.model_fields.items() if key in (name, f.alias)), None)
    return [] if found is None else _models(found.annotation)


def _models(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, Table):
        return [annotation]
    return [model for inner in get_args(annotation) for model in _models(inner)]


def about_table(model: type[BaseModel]) -> str:
    """What a model's first paragraph says that the table is."""
    first = inspect.cleandoc(model.__doc__ or "").split("\n\n")[0]
    return (first.partition("``: ")[2] or first).replace("``", "`")


def _polar(value: Any) -> Any:
    """``{ magnitude = 0.73, angle_deg = -4 }`` as ``[re, im]``."""
    if not isinstance(value, dict):
        return value
    keys = ("magnitude", "angle_deg")
    for key in value:
        if key not in keys:
            raise ValueError(f"unknown key '{key}'; {nearest(key, keys)}")
    if any(isinstance(value.get(k), bool) or not isinstance(value.get(k), (int, float)) for k in keys):
        raise ValueError("give [re, im] or { magnitude = ..., angle_deg = ... }")
    found = cmath.rect(value["magnitude"], math.radians(value["angle_deg"]))
    return (found.real, found.imag)


def _sized(value: float) -> float:
    """Outside of these sizes no quantity of a network is, and powers of it overflow."""
    if value and not LEAST <= abs(value) <= MOST:
        raise ValueError(f"is {value:g}; a number is 0, or from {LEAST:g} to {MOST:g} in size")
    return value


def _pair(value: tuple[float, float]) -> tuple[float, float]:
    if not all(math.isfinite(v) for v in value):
        raise ValueError("both numbers must be finite")
    return _sized(value[0]), _sized(value[1])


Number = Annotated[float, AfterValidator(_sized)]
"""A finite number; TOML's 5 and 5.0 are the same, "5" is not a number."""
Positive = Annotated[float, Field(gt=0), AfterValidator(_sized)]
Poles = Literal["A", "B", "C", "AB", "BC", "CA", "ABC"]
NonNegative = Annotated[float, Field(ge=0), AfterValidator(_sized)]
Milliseconds = Annotated[float, Field(ge=0, le=1e7)]
Seconds = Annotated[float, Field(ge=0, le=1e6)]
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$", max_length=64)]
_NUMBER = {"type": "number"}
_FORMS = {
    "anyOf": [
        {"type": "array", "prefixItems": [_NUMBER, _NUMBER], "minItems": 2, "maxItems": 2},
        {
            "type": "object",
            "properties": {"magnitude": _NUMBER, "angle_deg": _NUMBER},
            "required": ["magnitude", "angle_deg"],
            "additionalProperties": False,
        },
    ]
}
ComplexOhm = Annotated[
    tuple[float, float],
    Field(strict=False),
    BeforeValidator(_polar),
    AfterValidator(_pair),
    WithJsonSchema(_FORMS, mode="validation"),
]
"""An impedance [ohm], or a factor, as TOML ``[r, x]`` or ``{ magnitude = ..., angle_deg = ... }``."""

Model = TypeVar("Model", bound=BaseModel)


def read_toml(path: Path | str) -> tuple[dict[str, Any], str]:
    """The parsed file and its text.  Raises InputError where it cannot be read or is not TOML."""
    text = read_text(Path(path))
    return parse_toml(text, path), text


def read_text(path: Path) -> str:
    """What is to be TOML.  Raises InputError where it cannot be read."""
    check_input(path, "a TOML file", MOST_BYTES)
    try:
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"is not UTF-8 text (byte {error.start})", file=path) from None
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror or error})", file=path) from None


def parse_toml(text: str, file: object) -> dict[str, Any]:
    """Raises InputError where it is not TOML, or nested deeper than anything is."""
    try:
        data = tomllib.loads(text)
    except RecursionError:
        data = None
    except ValueError as error:  # TOMLDecodeError, and a number of more digits than Python converts
        raise InputError(f"is not valid TOML: {error}", file=file) from None
    if data is None or _deeper(data, MOST_NESTED):
        raise InputError(f"is nested deeper than {MOST_NESTED} brackets or tables", file=file)
    return data


def _deeper(data: Any, levels: int) -> bool:
    here = [data]
    for _ in range(levels):
        inside = [item.values() if isinstance(item, dict) else item for item in here]
        here = [value for items in inside for value in items if isinstance(value, (dict, list))]
    return bool(here)


def validate(model: type[Model], data: Mapping[str, Any], file: object = None) -> Model:
    """``model`` from parsed TOML; the first thing wrong becomes an InputError."""
    try:
        return model.model_validate(data)
    except ValidationError as error:
        raise input_error(error, model, data, file) from None


def input_error(
    error: ValidationError, model: type[BaseModel], data: Mapping[str, Any], file: object
) -> InputError:
    """One line out of pydantic's list: an unknown key first (often it explains the missing one)."""
    found = sorted(error.errors(include_url=False), key=lambda e: e["type"] != "extra_forbidden")[0]
    where, what = found["loc"], found["msg"]
    first: int = getattr(model, "first_place", 0)
    key = _key(where, data, first)
    value, context = found.get("input"), found.get("ctx", {})
    match found["type"]:
        case "extra_forbidden":
            what = f"unknown key; {nearest(str(where[-1]), _fields(model, where[:-1]))}"
        case "missing" if isinstance(where[-1], int):
            what = f"needs {where[-1] + 1} numbers, as in [r, x]"
            key = _key(where[:-1], data, first)
        case "missing":
            what = "missing; it has no default"
        case "tuple_type" if isinstance(value, dict):
            what = f"must be a list of tables, each headed [[{key}]]"
        case "tuple_type":
            what = f"must be a list, not {_quoted(value)}"
        case "too_short":
            what = f"at least {context.get('min_length')} needed, {context.get('actual_length')} given"
        case "too_long":
            what = f"at most {context.get('max_length')} possible, {context.get('actual_length')} given"
        case "value_error":
            what = what.removeprefix("Value error, ")
        case _:
            what = what[0].lower() + what[1:]
            if not isinstance(value, (dict, list)):
                what += f", not {_quoted(value)}"
    return InputError(what, file=file, key=key or None)


def _quoted(value: Any) -> str:
    """What was given, as far as a line has room for it."""
    text = repr(value)
    return text if len(text) <= MOST_QUOTED else f"{text[:MOST_QUOTED]}..."


def _key(where: tuple[int | str, ...], data: Any, first: int) -> str:
    """``fault[1].type``; list members that have a name are shown by it: ``line[L1].length_km``, others by
    their place, counted from ``first`` as in ``--set``."""
    text = ""
    for part in where:
        if _is_tag(part):
            continue
        if isinstance(part, int):
            item = data[part] if isinstance(data, list) and part < len(data) else None
            name = item.get("name") if isinstance(item, dict) else None
            text += f"[{name if isinstance(name, str) else part + first}]"
            data = item
        else:
            text += f".{part}" if text else part
            data = data.get(part) if isinstance(data, dict) else None
    return text


def _fields(model: type[BaseModel], where: tuple[int | str, ...]) -> list[str]:
    """The known keys of the table at ``where``."""
    current: Any = model
    for part in where:
        if isinstance(part, int) or _is_tag(part):
            continue
        field = current.model_fields.get(part) if _is_model(current) else None
        if field is None:
            return []
        candidates = [field.annotation, *_flatten(field.annotation)]
        current = next((c for c in candidates if _is_model(c)), None)
    if not _is_model(current):
        return []
    return [field.alias or name for name, field in current.model_fields.items()]


def _is_tag(part: int | str) -> bool:
    """Which branch of a union was taken: a part of pydantic's path that is no key; models write it so."""
    return isinstance(part, str) and part.startswith("<")


def _is_model(candidate: Any) -> bool:
    return isinstance(candidate, type) and issubclass(candidate, BaseModel)


def _flatten(annotation: Any) -> list[Any]:
    out: list[Any] = []
    for arg in get_args(annotation):
        out += [arg, *_flatten(arg)]
    return out
