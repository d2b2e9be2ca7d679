"""A large campaign or data set, end to end: time, peak memory of every process, sizes, reading rate.

    python bench/campaign_size.py [CASES] [--workers 2] [--waves samples] [--learn] [--report]
                                  [--folder F] [--keep]

    python bench/campaign_size.py 1000000 --report            # a million cases in one go, and their report
    python bench/campaign_size.py 100000 --waves samples --learn   # a data set, and the classifier's example
    python bench/campaign_size.py --plan 1000000              # the plan alone, and `check`

200 ms cases of two relays with the default estimator and the bus model, anywhere on the line; with
``--learn`` cases of campaigns/fault-type.toml, on which examples/fault_type.py is then trained.  ``--keep``
leaves the figures.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.dataset as ds
import pyarrow.parquet as pq

from faultloop.config.toml_text import toml_text

ROOT = Path(__file__).resolve().parents[1]
EVERY_S = 0.2


def tables(cases: int, sampling: str = "random", only: bool = False) -> dict[str, Any]:
    """A campaign of so many cases."""
    head = {"name": f"{cases} cases", "scenario": str(ROOT / "scenarios" / "ag-zone1.toml"), "seed": 1}
    if sampling == "grid":
        count = round((cases / 10) ** (1 / 3))
        places = [
            {"key": "fault.F1.at_pu", "range": [0.02, 0.98, count]},
            {"key": "fault.F1.angle_deg", "range": [0.0, 350.0, count]},
            {"key": "fault.F1.resistance_ohm", "range": [0.0, 10.0, count]},
        ]
    else:
        head |= {"cases": cases}
        places = [
            {"key": "fault.F1.at_pu", "uniform": [0.02, 0.98]},
            {"key": "fault.F1.angle_deg", "uniform": [0.0, 360.0]},
            {"key": "fault.F1.resistance_ohm", "log_uniform": [0.01, 10.0]},
        ]
    types = ["AG", "BG", "CG", "AB", "BC", "CA", "ABG", "BCG", "CAG", "ABC"]
    return {
        "campaign": head | {"sampling": sampling},
        "vary": [
            *places,
            {"key": "fault.F1.type", "values": types},
            {"key": "fault.F1.after_s", "values": [0.05]},
            {"key": "scenario.duration_s", "values": [0.2]},
        ],
        "only": [{"when": "fault.F1.at_pu < 0.9 or fault.F1.resistance_ohm < 5"}] if only else [],
        "judge": [{"relay": "RA", "where": "inside", "trip": True, "within_ms": 60}],
    }


def fault_types(cases: int) -> dict[str, Any]:
    """campaigns/fault-type.toml with so many cases."""
    data = tomllib.loads((ROOT / "campaigns" / "fault-type.toml").read_text(encoding="utf-8"))
    scenario = str(ROOT / "scenarios" / "ag-zone1.toml")
    return data | {"campaign": data["campaign"] | {"cases": cases, "scenario": scenario}}


def command(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "faultloop", *arguments]


class Watch:
    """Runs a command and follows the memory of all its processes."""

    def __init__(self, arguments: list[str], quiet: bool = False) -> None:
        self.peaks: dict[int, float] = {}
        begin = time.perf_counter()
        process = subprocess.Popen(arguments, stdout=subprocess.DEVNULL if quiet else None)
        while process.poll() is None:
            for pid in [process.pid, *children(process.pid)]:
                self.peaks[pid] = max(peak_mb(pid), self.peaks.get(pid, 0.0))
            time.sleep(EVERY_S)
        self.wall_s = time.perf_counter() - begin
        if process.returncode:
            raise SystemExit(f"{arguments} ended with {process.returncode}")

    def told(self) -> str:
        own = ", ".join(f"{peak:.0f}" for peak in self.peaks.values() if peak)
        return f"{self.wall_s:.1f} s; peak memory of its processes {own} MB"


def children(pid: int) -> list[int]:
    try:
        own = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    except OSError:
        return []
    return [int(one) for one in own] + [other for one in own for other in children(int(one))]


def peak_mb(pid: int) -> float:
    try:
        lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    except OSError:
        return 0.0
    return next((int(line.split()[1]) / 1e3 for line in lines if line.startswith("VmHWM")), 0.0)


def folder_mb(folder: Path) -> float:
    return sum(file.stat().st_size for file in folder.iterdir()) / 1e6


def read_back(waves: Path, cases: int) -> str:
    """All samples once, in batches, as a training loop would."""
    column, begin, read, rows = "RA.samples", time.perf_counter(), 0, 0
    for batch in ds.dataset(waves).to_batches(columns=[column, "fault_type"], batch_size=256):
        array = batch[column].flatten().to_numpy().reshape(len(batch), -1, 6)
        read, rows = read + array.nbytes, rows + len(array)
        assert np.isfinite(array[:, -1]).all()
    wall = time.perf_counter() - begin
    assert rows == cases
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    return (
        f"one relay's samples in batches: {wall:.1f} s, {rows / wall:,.0f} cases/s, "
        f"{read / wall / 1e6:.0f} MB/s, at most {memory:.0f} MB"
    )


def learned(out: Path) -> str:
    """What the shipped example says of a data set."""
    begin = time.perf_counter()
    example = [sys.executable, str(ROOT / "examples" / "fault_type.py"), str(out)]
    told = subprocess.run(example, check=True, capture_output=True, text=True).stdout
    return f"{'; '.join(told.split(chr(10))[:2])} ({time.perf_counter() - begin:.0f} s)"


PLAN = """
import resource, sys, time
from faultloop.study.campaign import Campaign
begin = time.perf_counter()
plan = Campaign.load(sys.argv[1]).plan
made = time.perf_counter()
for number in range(plan.cases):
    plan.values(number)
each = (time.perf_counter() - made) / plan.cases
memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
drawn = f"{1e6 * each:.1f} us to draw one, at most {memory:.0f} MB"
print(f"{plan.cases} cases, made ready in {made - begin:.2f} s, {drawn}")
"""
KINDS = [
    ("grid", False),
    ("grid", True),
    ("random", False),
    ("random", True),
    ("sobol", False),
    ("sobol", True),
]


def plan(cases: int, folder: Path) -> None:
    """The plan of each kind of sampling, drawn to its end; then `check`."""
    for sampling, only in KINDS:
        path = folder / f"{sampling}.toml"
        path.write_text(toml_text(tables(cases, sampling, only)), encoding="utf-8")
        print(f"{sampling}{' with a condition' if only else ''}:", end=" ", flush=True)
        subprocess.run([sys.executable, "-c", PLAN, str(path)], check=True)
        print(f"  check: {Watch(command('check', str(path), '--json'), quiet=True).told()}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("cases", type=int, nargs="?", default=2000)
    parser.add_argument("--workers", default=str(os.cpu_count()))
    parser.add_argument("--waves", default="", help="what of each case is kept")
    parser.add_argument("--keep", action="store_true", help="leave the figures for docs/evidence.md")
    parser.add_argument("--report", action="store_true")
    parser.add_argument("--learn", action="store_true", help="with --waves samples")
    parser.add_argument("--plan", type=int)
    parser.add_argument("--folder", type=Path, help="where the files stay; a temporary one where not given")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = options.folder or Path(name)
        folder.mkdir(exist_ok=True)
        if options.plan:
            plan(options.plan, folder)
            return
        path, out = folder / "campaign.toml", folder / "c.parquet"
        made = fault_types(options.cases) if options.learn else tables(options.cases)
        path.write_text(toml_text(made), encoding="utf-8")
        waves = ["--keep", options.waves] if options.waves else []
        watch = Watch(command("campaign", str(path), "--out", str(out), "--workers", options.workers, *waves))
        rate, size = 3600 * options.cases / watch.wall_s, out.stat().st_size
        assert pq.read_metadata(out).num_rows == options.cases
        what = (
            f"A campaign of {options.cases} cases{', with ' + options.waves if waves else ''}, end to end, "
        )
        what += f"{options.workers} workers"
        file = f"{size / 1e6:.1f} MB, {size / options.cases:.0f} bytes a case"
        rows = [(what, f"{watch.told()}; {rate:,.0f} an hour; file of {file}")]
        if options.waves:
            kept = out.with_suffix(".waves")
            mb, files = folder_mb(kept), len(list(kept.iterdir()))
            told = f"{mb:.0f} MB in {files} files, {1e3 * mb / options.cases:.1f} kB a case"
            rows.append((f"Waves of {options.cases} cases", f"{told}; {read_back(kept, options.cases)}"))
        if options.learn:
            rows.append((f"Classifier of {options.cases} cases, beside PHS", learned(out)))
        if options.report:
            outputs = ("--html", str(folder / "c.html"), "--png", str(folder / "c.png"))
            page = Watch(command("campaign-report", str(out), *outputs), quiet=True)
            rows.append((f"Report of {options.cases} rows, page and picture", page.told()))
    for line, figure in rows:
        print(f"{line}: {figure}")
    if options.keep:
        from results import keep

        keep("Campaigns", rows, beside=True)


if __name__ == "__main__":
    main()
