"""First compilation: `run`, and `run` and a campaign together, with nothing kept, against an earlier tree.

    python bench/cold.py [--before TREE]

Each in a process of its own with an empty folder for its machine code, in turns; wall time, on a machine
that does nothing else.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
LIMIT = 1.5
RUN = """
import sys, faultloop
faultloop.run(sys.argv[1], overrides=["scenario.duration_s=0.2"], keep=False)
"""
BOTH = (
    RUN
    + """
head = {"name": "cold", "scenario": sys.argv[1], "sampling": "grid"}
vary = [{"key": "fault.F1.at_pu", "values": [0.2, 0.5]}, {"key": "scenario.duration_s", "values": [0.2]}]
judge = [{"relay": "RA", "trip": True}]
faultloop.Campaign.from_dict({"campaign": head, "vary": vary, "judge": judge}).run(sys.argv[2])
"""
)


def wall_s(code: str, tree: Path) -> float:
    """Of a process that has nothing compiled."""
    with tempfile.TemporaryDirectory() as folder:
        command = [
            sys.executable,
            "-c",
            code,
            str(tree / "scenarios" / "ag-zone1.toml"),
            f"{folder}/c.parquet",
        ]
        own = {"PYTHONPATH": str(tree), "FAULTLOOP_CACHE": f"{folder}/machine-code"}
        begin = time.perf_counter()
        subprocess.run(command, check=True, cwd=tree, env=os.environ | own)
        return time.perf_counter() - begin


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--before", type=Path)
    parser.add_argument("--keep", action="store_true", help="leave the figures for docs/evidence.md")
    options = parser.parse_args()
    before_s = [wall_s(RUN, options.before)] if options.before else []
    run_s, both_s = wall_s(RUN, ROOT), wall_s(BOTH, ROOT)
    figure = f"{both_s:.0f} s (`run` alone {run_s:.0f})"
    ratio = 0.0
    if options.before:
        least = min(*before_s, wall_s(RUN, options.before))
        ratio = both_s / least
        figure += f", before {least:.0f}: {ratio:.2f} times (limit {LIMIT})"
    print(figure)
    if options.keep:
        from results import keep

        keep("Campaigns", [("First compilation, `run` and a campaign together, wall time", figure)])
    return 0 if ratio <= LIMIT else 3


if __name__ == "__main__":
    raise SystemExit(main())
