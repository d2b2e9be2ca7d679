"""Numbers of a size that no quantity has, in every key that has no limit of its own."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, get_args

import pytest
from pydantic import BaseModel, ValidationError

from faultloop.config.tables import LEAST, MOST
from faultloop.loop.scenario import Scenario
from faultloop.relay import RelaySettings

LIMITS = ("maximum", "exclusiveMaximum")


def models(of: Any) -> Iterator[type[BaseModel]]:
    """Those in an annotation, and in theirs."""
    if isinstance(of, type) and issubclass(of, BaseModel):
        yield of
        for field in of.model_fields.values():
            yield from models(field.annotation)
    for inner in get_args(of):
        yield from models(inner)


def numbers() -> Iterator[Any]:
    """Every key of a scenario and of settings that is a number, without a greatest value."""
    for model in dict.fromkeys([*models(Scenario), *models(RelaySettings)]):
        for key, schema in model.model_json_schema()["properties"].items():
            forms = [schema, *schema.get("anyOf", ())]
            if any(form.get("type") == "number" and not any(map(form.get, LIMITS)) for form in forms):
                yield pytest.param(model, key, id=f"{model.__name__}.{key}")


def test_there_are_such_keys() -> None:
    assert len(list(numbers())) > 80


@pytest.mark.parametrize(("model", "key"), [*numbers()])
@pytest.mark.parametrize("value", [10 * MOST, 1e300, LEAST / 10, 5e-324])
def test_a_size_that_no_quantity_has_is_refused(model: type[BaseModel], key: str, value: float) -> None:
    with pytest.raises(ValidationError) as error:
        model.model_validate({key: value})
    (own,) = (found for found in error.value.errors() if found["loc"] == (key,))
    assert own["msg"] == f"Value error, is {value:g}; a number is 0, or from 1e-12 to 1e+12 in size"
