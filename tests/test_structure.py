"""The structure's own rules that no linter holds: sizes, and that no module needs itself."""

from __future__ import annotations

import ast
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "faultloop"
SOURCES = sorted(PACKAGE.rglob("*.py"))
LARGEST_FILE, LARGEST_CLASS = 500, 250


def _module(path: Path) -> str:
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def test_no_file_is_long() -> None:
    lengths = {_module(path): path.read_text().count("\n") for path in SOURCES}
    assert {name: n for name, n in lengths.items() if n > LARGEST_FILE} == {}


def test_no_class_is_large() -> None:
    sizes = {
        node.name: (node.end_lineno or 0) - node.lineno + 1
        for path in SOURCES
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.ClassDef)
    }
    assert {name: n for name, n in sizes.items() if n > LARGEST_CLASS} == {}


def test_arguments_of_kernels_are_annotated() -> None:
    """What a kernel takes and gives cannot be seen from its body."""
    kernels = {
        f"{_module(path)}.{node.name}": node
        for path in SOURCES
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.FunctionDef) and any("njit" in ast.dump(d) for d in node.decorator_list)
    }
    assert len(kernels) > 300
    bare = [
        name for name, k in kernels.items() if k.returns is None or any(not a.annotation for a in k.args.args)
    ]
    assert bare == []


def _imported(path: Path, known: set[str]) -> set[str]:
    """Modules that importing this one imports: not within functions, not for types alone."""
    found: set[str] = set()
    waiting: list[ast.stmt] = list(ast.parse(path.read_text()).body)
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test):
            continue
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            found |= {f"{node.module}.{alias.name}" for alias in node.names} | {node.module}
        elif not isinstance(node, ast.FunctionDef | ast.ClassDef):
            waiting += [child for child in ast.iter_child_nodes(node) if isinstance(child, ast.stmt)]
    return found & known


def test_no_module_needs_itself() -> None:
    """A package's ``__init__`` counts as a module of its own: what it gathers may not import the package."""
    known = {_module(path) for path in SOURCES}
    graph = {}
    for path in SOURCES:
        name = _module(path)
        # `from a.b import c` where a.b.c is a module imports that; its package is imported anyway.
        needs = _imported(path, known)
        graph[name] = {m for m in needs if m != name and not any(n.startswith(f"{m}.") for n in needs)}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(" -> ".join(error.args[1]))
