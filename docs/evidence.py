"""Writes docs/evidence.md from what tests, benches and suites have left in bench/results.

    python docs/evidence.py

Figures come from `python bench/checks.py`, `python bench/NAME.py --keep` and `python bench/suites.py NAME`.
"""

from __future__ import annotations

import json
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "evidence.md"
RESULTS = ROOT / "bench" / "results"
COLUMNS = ("line", "command", "figure", "date")
SECTIONS = (
    "The closed loop",
    "Speed",
    "The house",
    "Security and instrument transformers",
    "Relay functions",
    "Both ends",
    "Campaigns",
    "A run explains itself",
    "Studies",
    "Papers",
    "CAN",
    "Process bus",
)
HEAD = """# Evidence

What is claimed, the command that shows it, what it came to, and when that was. `python docs/evidence.py`
writes this page from the files that tests, benches and suites leave in `bench/results`; nothing in it is
typed. `make evidence` runs the tests and writes it; `make evidence-long` runs those of full size, benches and
suites as well, which takes hours. Figures of time are of a machine of two cores; ratios are of one run. What
was measured on earlier trees, what was tried and went wrong, and what a person looked at stands in
[Measured before](measured-before.md).
"""


def results() -> list[dict[str, str]]:
    """All rows that were left: of tests first, then by the names of their files."""
    paths = sorted(RESULTS.glob("*.json"), key=lambda path: (path.stem != "checks", path.stem))
    return [row for path in paths for row in json.loads(path.read_text("utf-8"))]


def page() -> str:
    """The page: a table for each section that has rows."""
    rows = results()
    parts = [HEAD]
    for section in SECTIONS:
        own = [_row(row) for row in rows if row["section"] == section]
        if own:
            head = ["| line | command | figure | date |", "|---|---|---|---|"]
            parts.append("\n".join([f"## {section}\n", *head, *own]) + "\n")
    return "\n".join(parts)


def _row(row: dict[str, str]) -> str:
    cells = [row[column].replace("|", "\\|").replace("\n", " ") for column in COLUMNS]
    cells[1] = f"`{cells[1]}`"
    return "| " + " | ".join(cells) + " |"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
