"""Closed loop against real time: two Bergeron sections (a fault in the middle of the line), two relays with
the adaptive Kalman filter or the default, six loops, four zones, all of it logged to MCAP.

    python bench/closed_loop.py [--before TREE] [--rounds 3] [--keep] [--profile]

Prints simulated seconds per second of wall time, on one core, and with the log on a second one.  With a tree
of before its own bench runs in turns: the limits, 50 and 60 times, were set where it ran 30 times real time.
"""

# ruff: noqa: E402
from __future__ import annotations

import sys

del sys.path[0]  # this folder: its can.py is not python-can

import argparse
import cProfile
import os
import pstats
import re
import statistics
import subprocess
import tempfile
import time
from pathlib import Path

import faultloop
from faultloop.loop.scenario import Scenario, load_scenario

ROOT = Path(__file__).resolve().parents[1]
SECONDS = 10.0
RUNS = 5
BEFORE = 30.0
"""Times real time, of the default on one core, when the limits were set."""
LIMITS = {"one core": 50.0, "the log on a second": 60.0}

SETTINGS = {
    "adaptive-kalman": "settings/ab-kalman.toml",
    "kalman-bank, the default": "settings/ab-mho.toml",
}


def bench_scenario(seconds: float, settings: str) -> Scenario:
    """The scenario A-G in zone 1, longer."""
    return load_scenario(
        ROOT / "scenarios" / "ag-zone1.toml",
        [
            f"scenario.duration_s={seconds}",
            f"fault.F1.after_s={seconds - 0.4}",
            f"relay.RA.settings={settings}",
            f"relay.RB.settings={settings}",
        ],
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--before", type=Path)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--profile", action="store_true")
    parser.add_argument("--keep", action="store_true", help="leave the figures for docs/evidence.md")
    options = parser.parse_args()
    cores = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_setaffinity") else []
    ratios: dict[tuple[str, str], list[float]] = {}
    before: list[float] = []
    for _ in range(options.rounds):
        if options.before is not None:
            before.append(ratio_of(options.before))
        for estimator, settings in SETTINGS.items():
            for number, way in enumerate(LIMITS):
                if cores:
                    os.sched_setaffinity(0, cores[: number + 1])
                own = measure(settings, log_thread=number == 1)
                ratios.setdefault((estimator, way), []).extend(own)
        if cores:
            os.sched_setaffinity(0, cores)
    rows = []
    for (estimator, way), own in ratios.items():
        middle = statistics.median(own)
        told = f"{middle:.1f} times real time (at best {max(own):.1f}, {len(own)} runs of {SECONDS:g} s)"
        if estimator.endswith("default"):
            told += f"; limit {LIMITS[way]:g}"
            if before:
                then = statistics.median(before)
                told += f" where before runs {BEFORE:g}: here {then:.1f}, so {middle * BEFORE / then:.1f}"
        rows.append((f"Closed loop of two relays, logged, {estimator}, {way}", told))
    for line, figure in rows:
        print(f"{line}: {figure}")
    if options.keep:
        sys.path.append(str(Path(__file__).parent))
        from results import keep

        keep("Campaigns", rows)
    if options.profile:
        scenario = bench_scenario(SECONDS, SETTINGS["kalman-bank, the default"])
        with tempfile.TemporaryDirectory() as folder, cProfile.Profile() as profile:
            faultloop.run(scenario, log=Path(folder) / "bench.mcap")
        pstats.Stats(profile).sort_stats("tottime").print_stats(25)


def ratio_of(tree: Path) -> float:
    """What a tree's own bench says of the default, on one core."""
    own = os.environ | {"PYTHONPATH": str(tree)}
    command = [sys.executable, str(tree / "bench" / "closed_loop.py")]
    told = subprocess.run(command, check=True, capture_output=True, text=True, cwd=tree, env=own).stdout
    found = re.search(r"default.*?: .*?([0-9.]+) (?:x|times) real time", told)
    assert found is not None, told
    return float(found[1])


def measure(settings: str, log_thread: bool) -> list[float]:
    """The ratios of some runs."""
    scenario = bench_scenario(SECONDS, settings)
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "bench.mcap"
        faultloop.run(bench_scenario(0.7, settings), log=log)  # compiles
        ratios = []
        for _ in range(RUNS):
            log.unlink()  # or its successor pays for what the file system does to let 50 MB go
            started = time.perf_counter()
            result = faultloop.run(scenario, log=log, log_thread=log_thread)
            ratios.append(SECONDS / (time.perf_counter() - started))
            assert len(result.trips) == 2
    return ratios


if __name__ == "__main__":
    main()
