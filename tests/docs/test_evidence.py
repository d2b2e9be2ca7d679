"""What benches, suites and tests have left in bench/results stands in docs/evidence.md as it is."""

from __future__ import annotations

import importlib.util
import json
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def test_the_page_has_what_was_left() -> None:
    place = importlib.util.spec_from_file_location("evidence", ROOT / "docs" / "evidence.py")
    assert place is not None and place.loader is not None
    evidence = importlib.util.module_from_spec(place)
    place.loader.exec_module(evidence)
    text = evidence.PAGE.read_text(encoding="utf-8")
    assert evidence.filled(text) == text, "python docs/evidence.py"
    marked, rows = re.findall(evidence.PLACE, text), evidence.results()
    assert rows
    for row in rows:
        assert row["section"] in marked and set(evidence.COLUMNS) < set(row)
        files = [word for word in row["command"].split() if word.startswith(("bench/", "tests/"))]
        assert files or row["command"].startswith("faultloop suite "), row["command"]
        assert all((ROOT / file.split("::")[0]).exists() for file in files), row["command"]


def test_every_line_that_is_checked_has_its_tests() -> None:
    for lines in json.loads((ROOT / "bench" / "checks.json").read_text("utf-8")).values():
        for tests in lines.values():
            assert all((ROOT / file.split("::")[0]).exists() for file in tests.split()), tests
