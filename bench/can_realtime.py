"""The highest pace at which the plant and two relays as processes lose nothing.

    python bench/can_realtime.py [--can socketcan:vcan0] [--seconds 10] [--paces 0.02 0.05 0.1 0.2 0.5 1]

For each pace a healthy line runs as processes: 4800 samples per second of run time for each of two relays,
which listen, two breakers, and the supervisor, which logs every frame.  Lost: samples that a relay missed, by
their numbers, frames that a kernel buffer could not take, samples that are not in the log.  It stops at the
first pace that is not kept: something was lost, or the last sample was more than a second of wall time late.
Then the whole --seconds of run time, from the highest pace kept down to one that loses nothing.  Where this
machine has no vcan0, it runs in the guest of tests/with-vcan.  Exit status 1 where there is no such pace.
"""

# ruff: noqa: E402
from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[0] = str(ROOT)  # and not this folder, whose can.py is not python-can

import numpy as np

from faultloop.io.can.table import Kind
from faultloop.io.mcap_reader import open_log
from faultloop.live.supervisor import run_processes
from faultloop.loop.result import Result

PROBE_WALL_S = 8.0  # of each pace that is tried
LATE_MS = 1000.0


def missing(result: Result) -> int:
    """Samples that are not in the log's frames, of both relays."""
    assert result.log is not None
    scenario = result.scenario
    frames = open_log(result.log).array("/can")
    total = round(scenario.scenario.duration_s * scenario.system.sampling_hz)
    lost = 0
    for number in range(len(scenario.relay)):
        own = frames[frames["id"] == Kind.SAMPLED_VALUES + number]
        counts = np.array([int.from_bytes(bytes(data)[4:8], "little") for data in own["data"]])
        lost += total - len(np.unique(counts))
    return lost


def run(can: str, pace: float, seconds: float) -> bool:
    """One run, told in a line; whether the pace was kept."""
    overrides = [f"scenario.duration_s={seconds:g}", f"fault.F1.after_s={seconds - 0.01:g}"]
    with tempfile.TemporaryDirectory() as folder:
        began = time.perf_counter()
        result = run_processes(
            ROOT / "scenarios" / "ag-zone1.toml",
            can=can,
            pace=pace,
            log=Path(folder) / "run.mcap",
            overrides=overrides,
        )
        wall_s = time.perf_counter() - began
        not_logged = missing(result)
    pacing = result.pacing
    assert pacing is not None
    lost, dropped = sum(pacing.lost.values()), sum(pacing.dropped.values())
    latency = max(own.greatest for own in pacing.latency.values())
    kept = lost == dropped == not_logged == 0 and not result.died and pacing.jitter.greatest < LATE_MS
    print(
        f"pace {pace:<5g} {seconds:6.2f} s  {4800 * pace:6.0f} samples/s  {result.can_frames:6d} frames"
        f"  lost {lost} dropped {dropped} not logged {not_logged} retries {sum(pacing.retries.values())}\n"
        f"    deadlines missed {pacing.missed} of {pacing.samples}; jitter {pacing.jitter}\n"
        f"    sample to estimate: greatest {latency:.1f} ms; wall {wall_s:.1f} s"
        f"  {'kept' if kept else 'NOT KEPT'}",
        flush=True,
    )
    return kept


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--can", default="socketcan:vcan0")
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--paces", type=float, nargs="+", default=[0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.5, 1.0])
    args = parser.parse_args()
    if args.can == "socketcan:vcan0" and not Path("/sys/class/net/vcan0").is_dir():
        guest = [sys.executable, ROOT / "tests" / "with-vcan", sys.executable, *sys.argv]
        return subprocess.run(guest, check=False).returncode
    kept = []
    for pace in sorted(args.paces):
        if not run(args.can, pace, max(PROBE_WALL_S * pace, 0.2)):
            break
        kept.append(pace)
    print(f"\nthe whole {args.seconds:g} s, from the highest pace kept down:", flush=True)
    for pace in reversed(kept):
        if run(args.can, pace, args.seconds):
            print(f"{args.seconds:g} s at pace {pace:g} without a loss")
            return 0
    print("no pace was kept")
    return 1


if __name__ == "__main__":
    sys.exit(main())
