"""Where a bench leaves its figures, for docs/evidence.py: bench/results/NAME.json."""

from __future__ import annotations

import datetime
import json
import sys
from pathlib import Path

FOLDER = Path(__file__).with_name("results")


def keep(section: str, rows: list[tuple[str, str]]) -> Path:
    """Writes a section's rows, what is measured and what it came to, with this command and today's date."""
    name = Path(sys.argv[0]).stem
    words = [
        word if word.startswith("-") or not Path(word).exists() else Path(word).name for word in sys.argv[1:]
    ]
    command = " ".join(["python", f"bench/{name}.py", *words])
    date = datetime.datetime.now(datetime.UTC).date().isoformat()
    told = [{"line": line, "command": command, "figure": figure, "date": date} for line, figure in rows]
    FOLDER.mkdir(exist_ok=True)
    path = FOLDER / f"{name}.json"
    path.write_text(json.dumps({"section": section, "rows": told}, indent=1) + "\n", encoding="utf-8")
    return path
