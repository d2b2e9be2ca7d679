"""What the benches have left in bench/results stands in docs/evidence.md as it is."""

from __future__ import annotations

import importlib.util
import json
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def test_the_page_has_what_the_benches_left() -> None:
    place = importlib.util.spec_from_file_location("evidence", ROOT / "docs" / "evidence.py")
    assert place is not None and place.loader is not None
    evidence = importlib.util.module_from_spec(place)
    place.loader.exec_module(evidence)
    text = evidence.PAGE.read_text(encoding="utf-8")
    assert evidence.filled(text) == text, "python docs/evidence.py"
    marked = re.findall(evidence.PLACE, text)
    left = [json.loads(path.read_text("utf-8")) for path in (ROOT / "bench" / "results").glob("*.json")]
    assert left
    for result in left:
        assert result["section"] in marked
        for row in result["rows"]:
            script = row["command"].split()[1]
            assert (ROOT / script).is_file() and list(row) == list(evidence.COLUMNS)
