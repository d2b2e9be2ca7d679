"""docs/evidence.md is what docs/evidence.py writes of what was left in bench/results."""

from __future__ import annotations

import json
from types import ModuleType

import pytest

from tests.load import ROOT, load


@pytest.fixture(scope="module")
def evidence() -> ModuleType:
    return load("docs/evidence.py")


def test_the_page_is_what_was_left(evidence: ModuleType) -> None:
    assert evidence.PAGE.read_text(encoding="utf-8") == evidence.page(), "python docs/evidence.py"


def test_every_row_has_its_section_and_a_command_that_is_there(evidence: ModuleType) -> None:
    rows = evidence.results()
    assert rows
    for row in rows:
        assert row["section"] in evidence.SECTIONS and set(evidence.COLUMNS) < set(row)
        files = [word for word in row["command"].split() if word.startswith(("bench/", "tests/"))]
        assert files or row["command"].startswith("faultloop suite "), row["command"]
        assert all((ROOT / file.split("::")[0]).exists() for file in files), row["command"]
    lines = [row["line"] for row in rows]
    assert len(lines) == len(set(lines)), "no line twice"


def test_every_line_that_is_checked_has_its_tests_and_its_row() -> None:
    kept = json.loads((ROOT / "bench" / "results" / "checks.json").read_text("utf-8"))
    checks = json.loads((ROOT / "bench" / "checks.json").read_text("utf-8"))
    lines = {line: (section, tests) for section, some in checks.items() for line, tests in some.items()}
    rows = {row["line"]: (row["section"], row["command"].removeprefix("pytest ")) for row in kept}
    assert rows.items() <= lines.items()
    assert not [line for line in lines.keys() - rows.keys() if not lines[line][1].startswith("-m ")], "run"
    for _, tests in lines.values():
        for word in tests.removeprefix("-m 'slow or not slow' ").split():
            file, _, name = word.partition("::")
            assert (ROOT / file).exists(), word
            assert not name or f"def {name}(" in (ROOT / file).read_text("utf-8"), word
