"""Closed loop against real time, on one core: two Bergeron sections (a fault in the middle of the line), two
relays with the adaptive Kalman filter, six loops, four zones, every sample and estimate logged to MCAP.

    python bench/closed_loop.py

Prints simulated seconds per second of wall time: the whole, and where the time goes.
"""

# ruff: noqa: E402
from __future__ import annotations

import sys

del sys.path[0]  # this folder: its can.py is not python-can

import cProfile
import os
import pstats
import tempfile
import time
from pathlib import Path

import faultloop
from faultloop.scenario import Scenario, load_scenario

ROOT = Path(__file__).resolve().parents[1]
SECONDS = 10.0
RUNS = 5


def bench_scenario(seconds: float) -> Scenario:
    """The scenario A-G in zone 1, longer; its relays have the adaptive Kalman filter."""
    return load_scenario(
        ROOT / "scenarios" / "ag-zone1.toml",
        [
            f"scenario.duration_s={seconds}",
            f"fault.F1.after_s={seconds - 0.4}",
        ],
    )


def main() -> None:
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    scenario = bench_scenario(SECONDS)
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "bench.mcap"
        faultloop.run(bench_scenario(0.7), log=log)  # compiles
        ratios = []
        for _ in range(RUNS):
            started = time.perf_counter()
            result = faultloop.run(scenario, log=log)
            ratios.append(SECONDS / (time.perf_counter() - started))
            assert len(result.trips) == 2
        megabytes = log.stat().st_size / 1e6
        ratios.sort()
        print(
            f"closed loop, {SECONDS:g} s, two relays, log of {megabytes:.0f} MB: "
            f"{ratios[RUNS // 2]:.1f} x real time (from {ratios[0]:.1f} to {ratios[-1]:.1f}, {RUNS} runs)"
        )
        profile = cProfile.Profile()
        profile.runcall(faultloop.run, scenario, log=log)
        if "--profile" in sys.argv:
            pstats.Stats(profile).sort_stats("tottime").print_stats(25)


if __name__ == "__main__":
    main()
