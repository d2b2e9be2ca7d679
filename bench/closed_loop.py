"""Closed loop against real time, on one core: two Bergeron sections (a fault in the middle of the line), two
relays with the adaptive Kalman filter or the default, six loops, four zones, all of it logged to MCAP.

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
from faultloop.loop.scenario import Scenario, load_scenario

ROOT = Path(__file__).resolve().parents[1]
SECONDS = 10.0
RUNS = 5


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
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    for estimator, settings in SETTINGS.items():
        measure(estimator, settings)


def measure(estimator: str, settings: str) -> None:
    """Prints the ratios of some runs."""
    scenario = bench_scenario(SECONDS, settings)
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "bench.mcap"
        faultloop.run(bench_scenario(0.7, settings), log=log)  # compiles
        ratios = []
        for _ in range(RUNS):
            log.unlink()  # or its successor pays for what the file system does to let 50 MB go
            started = time.perf_counter()
            result = faultloop.run(scenario, log=log)
            ratios.append(SECONDS / (time.perf_counter() - started))
            assert len(result.trips) == 2
        megabytes = log.stat().st_size / 1e6
        ratios.sort()
        print(
            f"closed loop, {estimator}: {SECONDS:g} s, two relays, log of {megabytes:.0f} MB: "
            f"{ratios[RUNS // 2]:.1f} x real time (from {ratios[0]:.1f} to {ratios[-1]:.1f}, {RUNS} runs)"
        )
        profile = cProfile.Profile()
        profile.runcall(faultloop.run, scenario, log=log)
        if "--profile" in sys.argv:
            pstats.Stats(profile).sort_stats("tottime").print_stats(25)


if __name__ == "__main__":
    main()
