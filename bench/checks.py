"""Runs the tests that show a line of docs/evidence.md, and leaves how many passed and what they measured.

    python bench/checks.py [WORD]...    # those whose line or files have one of the words; all without

What a test measured is what it says with ``record_property("figure", ...)``.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ElementTree
from pathlib import Path

from results import leave, row

ROOT = Path(__file__).resolve().parents[1]
CHECKS = Path(__file__).with_name("checks.json")


def figure(report: Path) -> str:
    """What a JUnit report of pytest tells."""
    cases = list(ElementTree.parse(report).getroot().iter("testcase"))
    counts = {"passed": 0, "failed": 0, "skipped": 0}
    for case in cases:
        kinds = {child.tag for child in case}
        counts[
            "failed" if kinds & {"failure", "error"} else "skipped" if "skipped" in kinds else "passed"
        ] += 1
    told = [f"{count} {kind}" for kind, count in counts.items() if count or kind == "passed"]
    measured = [
        str(entry.get("value"))
        for case in cases
        for entry in case.iter("property")
        if entry.get("name") == "figure"
    ]
    return "; ".join([", ".join(told), *measured])


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("word", nargs="*")
    given = parser.parse_args()
    for section, lines in json.loads(CHECKS.read_text(encoding="utf-8")).items():
        for line, tests in lines.items():
            if given.word and not any(word in line or word in tests for word in given.word):
                continue
            with tempfile.TemporaryDirectory() as folder:
                report = Path(folder) / "report.xml"
                command = [
                    "-m",
                    "pytest",
                    "-q",
                    "-n",
                    "1",
                    "-p",
                    "no:cacheprovider",
                    "-m",
                    "slow or not slow",
                ]
                subprocess.run(
                    [sys.executable, *command, f"--junitxml={report}", *tests.split()], cwd=ROOT, check=False
                )
                told = figure(report)
            print(f"{line}: {told}", flush=True)
            one = row(section, line, f"pytest -m 'slow or not slow' {tests}", told)
            leave("checks", [one], beside=True)


if __name__ == "__main__":
    main()
