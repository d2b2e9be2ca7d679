"""Runs suites and leaves what they hold, check by check, for docs/evidence.py.

python bench/suites.py NAME [PART]... [--quick] [--workers N] [--html FILE] [--png FILE]
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from math import inf

from results import leave, row

SECTIONS = {
    "bus": "CAN",
    "differential": "Both ends",
    "schemes": "Both ends",
    "distance": "Security and instrument transformers",
    "estimators": "Studies",
    "synchrophasor": "Studies",
    "functions": "Relay functions",
    "seeds": "Papers",
}
SUITE_OPTIONS = ("workers", "html", "png")
MOST = 6
"""Checks of a report that are told one by one; of more the nearest to their limits."""


def figure(report: dict) -> str:
    """What its checks came to."""
    if report["failed"]:
        return f"failed: {report['failed']}"
    asked = [one for one in report["checks"] if one["cases"] != 0]
    checks = [{key: inf if one[key] is None else one[key] for key in one} for one in asked]
    missed = [one for one in checks if one["status"] == "MISSED"]
    nearest = sorted(checks, key=lambda one: abs(one["margin"]) / (abs(one["limit"]) or 1.0))
    shown = checks if len(checks) <= MOST else [*missed, *nearest[:MOST]]
    told = [
        f"{one['what']}: {one['value']:.4g} {one['unit']}".rstrip()
        + f" (limit {one['limit']:.4g}{'' if one['held'] else ', ' + one['status']})"
        for one in shown
    ]
    held = sum(one["held"] for one in checks)
    return f"{held} of {len(checks)} checks held" + ("; " if told else "") + "; ".join(told)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("suite", choices=sorted(SECTIONS))
    parser.add_argument("part", nargs="*")
    parser.add_argument("--quick", action="store_true")
    for option in SUITE_OPTIONS:
        parser.add_argument(f"--{option}", help="as the suite's own")
    given = parser.parse_args()
    words = ["suite", given.suite, *given.part, *(["--quick"] if given.quick else [])]
    words += [f"--{name}={value}" for name in SUITE_OPTIONS if (value := getattr(given, name))]
    done = subprocess.run(
        [sys.executable, "-m", "faultloop", *words, "--json"], stdout=subprocess.PIPE, check=False
    )
    assert done.returncode in (0, 3), "the suite did not end"
    rows = []
    for report in json.loads(done.stdout)["reports"]:
        part = report["name"].removeprefix(f"{given.suite}-")
        name = ["suite", given.suite, part, *(["--quick"] if given.quick else [])]
        rows.append(
            row(SECTIONS[given.suite], report["title"], f"faultloop {' '.join(name)}", figure(report))
        )
        print(f"{rows[-1]['line']}: {rows[-1]['figure']}")
    leave(f"suite-{given.suite}", rows, beside=True)


if __name__ == "__main__":
    main()
