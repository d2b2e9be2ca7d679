"""Runs benches and suites, and leaves what they print for docs/evidence.md.

    python bench/benches.py [WORD]... [--list]    # lines or commands with a word; all (hours) without

bench/benches.json has, by section and line, a command: what it prints is the figure, one line after the
other but for those that list cases one by one (four spaces before them), with the machine's load and, where
that is not 0, the exit status.  Under "own" are the commands that leave rows themselves, many of one run.
"""

from __future__ import annotations

import argparse
import json
import os
import shlex
import subprocess
import sys
from pathlib import Path

from results import FOLDER, Row, leave, row

ROOT = Path(__file__).resolve().parents[1]
BENCHES = Path(__file__).with_name("benches.json")
OWN = "own"


def run(command: str) -> tuple[str, int]:
    """What a bench prints, which is shown as well, and its exit status."""
    words = [sys.executable, *shlex.split(command)]
    own = os.environ | {"PYTHONPATH": str(ROOT), "PYTHONUNBUFFERED": "1"}
    told = []
    with subprocess.Popen(words, cwd=ROOT, env=own, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        for text in process.stdout:
            print(text, end="", flush=True)
            if not text.startswith("    "):
                told.append(" ".join(text.split()))
    return "; ".join(text for text in told if text), process.returncode


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("word", nargs="*")
    parser.add_argument("--list", action="store_true", help="the commands, without running them")
    given = parser.parse_args()
    table = json.loads(BENCHES.read_text(encoding="utf-8"))
    own: list[str] = table.pop(OWN)
    lines = {line: (section, command) for section, some in table.items() for line, command in some.items()}
    path = FOLDER / "benches.json"
    rows: dict[str, Row] = {
        one["line"]: one for one in (json.loads(path.read_text(encoding="utf-8")) if path.exists() else [])
    }
    failed = []
    for line, command in [*((line, command) for line, (_, command) in lines.items()), *((c, c) for c in own)]:
        if given.word and not any(word in line or word in command for word in given.word):
            continue
        print(f"\n$ python {command}", flush=True)
        if given.list:
            continue
        load = os.getloadavg()[0]
        told, status = run(command)
        failed += [command] if status else []
        if line in lines:
            ended = f"; exit status {status}" if status else ""
            figure = f"{told}{ended} (at a load of {load:.1f})"
            rows[line] = row(lines[line][0], line, f"python {command}", figure)
            leave("benches", [rows[name] for name in lines if name in rows])
    print(*(f"not 0: {command}" for command in failed), sep="\n")
    return 1 if failed else 0


if __name__ == "__main__":
    raise SystemExit(main())
