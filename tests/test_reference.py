"""docs/reference.md is what the code says, and the code says what each public attribute is."""

from __future__ import annotations

import ast
import dataclasses
import importlib
import inspect
import itertools
import re
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

from tests.load import load


@pytest.fixture(scope="module")
def module() -> ModuleType:
    return load("docs/reference.py")


def test_the_page_is_that_of_the_code(root: Path, module: ModuleType) -> None:
    made, page = module.reference(), (root / "docs" / "reference.md").read_text(encoding="utf-8")
    assert made.splitlines() == page.splitlines(), "python docs/reference.py"


def test_every_public_attribute_says_what_it_is(module: ModuleType) -> None:
    places = [
        (importlib.import_module(place), name)
        for modules in module.MODULES.values()
        for place, names in modules.items()
        for name in names.split()
    ]
    silent = [f"{name}.{one}" for place, name in places for one in _silent(getattr(place, name))]
    assert silent == []


def _silent(thing: object) -> Iterator[str]:
    """Public fields that neither the class nor a docstring of their own speaks of, members without one."""
    if not inspect.isclass(thing):
        return
    (body,) = (
        node.body
        for node in ast.walk(ast.parse(inspect.getsource(inspect.getmodule(thing))))  # type: ignore[arg-type]
        if isinstance(node, ast.ClassDef) and node.name == thing.__name__
    )
    own = {
        one.target.id
        for one, after in itertools.pairwise(body)
        if isinstance(one, ast.AnnAssign)
        and isinstance(one.target, ast.Name)
        and isinstance(after, ast.Expr)
        and isinstance(after.value, ast.Constant)
    }
    about = " ".join(inspect.getdoc(one) or "" for one in thing.__mro__[:-1])
    fields = [field.name for field in dataclasses.fields(thing)] if dataclasses.is_dataclass(thing) else []
    for name in fields:
        if not name.startswith("_") and name not in own and not re.search(rf"\b{name}\b", about):
            yield name
    for name, member in vars(thing).items():
        function = member.fget if isinstance(member, property) else getattr(member, "__func__", member)
        if not name.startswith("_") and inspect.isfunction(function) and not inspect.getdoc(function):
            yield name
