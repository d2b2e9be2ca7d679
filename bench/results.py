"""Where a bench leaves its figures, for docs/evidence.py: bench/results/NAME.json, a list of rows.

A row has the section of docs/evidence.md, the line that it shows, the command, the figure and the date.
"""

from __future__ import annotations

import datetime
import json
import sys
from pathlib import Path

FOLDER = Path(__file__).with_name("results")
Row = dict[str, str]


def keep(section: str, rows: list[tuple[str, str]], *, beside: bool = False) -> Path:
    """Leaves a bench's figures: pairs of what is measured and what it came to, by this command, today."""
    name = Path(sys.argv[0]).stem
    words = [
        word if word.startswith("-") or not Path(word).exists() else Path(word).name for word in sys.argv[1:]
    ]
    command = " ".join(["python", f"bench/{name}.py", *words])
    return leave(name, [row(section, line, command, figure) for line, figure in rows], beside=beside)


def row(section: str, line: str, command: str, figure: str) -> Row:
    """One row, of today."""
    date = datetime.datetime.now(datetime.UTC).date().isoformat()
    return {"section": section, "line": line, "command": command, "figure": figure, "date": date}


def leave(name: str, rows: list[Row], *, beside: bool = False) -> Path:
    """Writes bench/results/``name``.json; ``beside``: rows of other lines that are there already stay."""
    FOLDER.mkdir(exist_ok=True)
    path = FOLDER / f"{name}.json"
    if beside and path.exists():
        new = {one["line"]: one for one in rows}
        before = json.loads(path.read_text(encoding="utf-8"))
        rows = [new.pop(one["line"], one) for one in before] + list(new.values())
    text = json.dumps(rows, indent=1, ensure_ascii=False)
    path.write_text(text + "\n", encoding="utf-8")
    return path
