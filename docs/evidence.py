"""Writes into docs/evidence.md what the benches have left in bench/results.

python docs/evidence.py             # anew, between <!-- results: SECTION --> and <!-- end -->
"""

from __future__ import annotations

import json
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "evidence.md"
PLACE = re.compile(r"<!-- results: ([^>]+?) -->\n.*?<!-- end -->", re.DOTALL)
COLUMNS = ("line", "command", "figure", "date")


def filled(text: str) -> str:
    """The page with the rows of each section that it marks."""
    results = [
        json.loads(path.read_text("utf-8")) for path in sorted((ROOT / "bench" / "results").glob("*.json"))
    ]

    def rows(mark: re.Match[str]) -> str:
        lines = [f"<!-- results: {mark[1]} -->", "| line | command | figure | date |", "|---|---|---|---|"]
        for result in results:
            if result["section"] == mark[1]:
                lines += [_row(row) for row in result["rows"]]
        return "\n".join([*lines, "<!-- end -->"])

    return PLACE.sub(rows, text)


def _row(row: dict[str, str]) -> str:
    cells = [row[column].replace("|", "\\|") for column in COLUMNS]
    cells[1] = f"`{cells[1]}`"
    return "| " + " | ".join(cells) + " |"


if __name__ == "__main__":
    PAGE.write_text(filled(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
