"""Writes into docs/evidence.md what benches, suites and tests have left in bench/results.

    python docs/evidence.py             # anew, between <!-- results: SECTION --> and <!-- end -->

Figures come from `python bench/NAME.py --keep`, `python bench/suites.py NAME` and `python bench/checks.py`.
"""

from __future__ import annotations

import json
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "evidence.md"
RESULTS = ROOT / "bench" / "results"
PLACE = re.compile(r"<!-- results: ([^>]+?) -->\n.*?<!-- end -->", re.DOTALL)
COLUMNS = ("line", "command", "figure", "date")


def results() -> list[dict[str, str]]:
    """All rows that were left, by the names of their files."""
    return [row for path in sorted(RESULTS.glob("*.json")) for row in json.loads(path.read_text("utf-8"))]


def filled(text: str) -> str:
    """The page with the rows of each section that it marks."""
    rows = results()

    def table(mark: re.Match[str]) -> str:
        head = [f"<!-- results: {mark[1]} -->", "| line | command | figure | date |", "|---|---|---|---|"]
        return "\n".join([*head, *(_row(row) for row in rows if row["section"] == mark[1]), "<!-- end -->"])

    return PLACE.sub(table, text)


def _row(row: dict[str, str]) -> str:
    cells = [row[column].replace("|", "\\|").replace("\n", " ") for column in COLUMNS]
    cells[1] = f"`{cells[1]}`"
    return "| " + " | ".join(cells) + " |"


if __name__ == "__main__":
    PAGE.write_text(filled(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
