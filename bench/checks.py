"""Runs the tests that show a line of docs/evidence.md, and leaves how many passed and what they measured.

    python bench/checks.py [WORD]... [--full]    # lines or files with one of the words

bench/checks.json has, by section and line, a selection of tests: files, folders, FILE::TEST.  With
`-m 'slow or not slow'` before it it is one of full size, which takes minutes and is run with --full alone.
Each way is one run of pytest.  What tests measure is what they hand to the fixture ``measured``; of each
quantity the greatest of the line's tests is told.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ElementTree
from pathlib import Path

from results import FOLDER, Row, leave, row

ROOT = Path(__file__).resolve().parents[1]
CHECKS = Path(__file__).with_name("checks.json")
FULL = "-m 'slow or not slow' "
PYTEST = ["-m", "pytest", "-q", "-n", "1", "-p", "no:cacheprovider", "-o", "junit_family=xunit1"]


def selects(selection: str, case: ElementTree.Element) -> bool:
    """Whether one of the selection's files, folders or tests has this one."""
    file, name = case.get("file", ""), case.get("name", "")
    for word in selection.split():
        place, _, test = word.partition("::")
        inside = file == place or file.startswith(f"{place.rstrip('/')}/")
        if inside and (not test or name == test or name.startswith(f"{test}[")):
            return True
    return False


def figure(cases: list[ElementTree.Element]) -> str:
    """What tests came to: how many passed, and what they measured."""
    counts = {"passed": 0, "failed": 0, "skipped": 0}
    most: dict[tuple[str, str], float] = {}
    for case in cases:
        kinds = {child.tag for child in case}
        failed = kinds & {"failure", "error"}
        counts["failed" if failed else "skipped" if "skipped" in kinds else "passed"] += 1
        for entry in case.iter("property"):
            if entry.get("name") == "measured":
                what, value, unit = json.loads(entry.get("value", ""))
                most[what, unit] = max(value, most.get((what, unit), value))
    told = [f"{count:,} {kind}" for kind, count in counts.items() if count or kind == "passed"]
    measured = [f"{what} at most {value:.3g} {unit}".rstrip() for (what, unit), value in most.items()]
    return "; ".join([", ".join(told), *measured])


def run(selections: list[str], marks: list[str]) -> list[ElementTree.Element]:
    """What pytest reports of all these tests."""
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.xml"
        words = dict.fromkeys(word for selection in selections for word in selection.split())
        subprocess.run(
            [sys.executable, *PYTEST, *marks, f"--junitxml={report}", *words], cwd=ROOT, check=False
        )
        return list(ElementTree.parse(report).getroot().iter("testcase"))


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("word", nargs="*")
    parser.add_argument("--full", action="store_true", help="those of full size as well")
    given = parser.parse_args()
    lines = {
        line: (section, tests)
        for section, some in json.loads(CHECKS.read_text(encoding="utf-8")).items()
        for line, tests in some.items()
    }
    path = FOLDER / "checks.json"
    rows: dict[str, Row] = {
        one["line"]: one for one in (json.loads(path.read_text(encoding="utf-8")) if path.exists() else [])
    }
    failed = False
    for full in (False, True) if given.full else (False,):
        wanted = {
            line: (section, tests)
            for line, (section, tests) in lines.items()
            if tests.startswith(FULL) == full
            and (not given.word or any(word in line or word in tests for word in given.word))
        }
        if not wanted:
            continue
        chosen = [tests.removeprefix(FULL) for _, tests in wanted.values()]
        cases = run(chosen, ["-m", "slow or not slow"] if full else [])
        for (line, (section, tests)), selection in zip(wanted.items(), chosen, strict=True):
            own = [case for case in cases if selects(selection, case)]
            told = figure(own)
            failed |= not own or "failed" in told
            print(f"{line}: {told}", flush=True)
            rows[line] = row(section, line, f"pytest {tests}", told)
    leave("checks", [rows[line] for line in lines if line in rows])
    return 1 if failed else 0


if __name__ == "__main__":
    raise SystemExit(main())
