"""Peak memory and time of what reads a log, on one that is larger than they may be.

600 s of two relays (3 GB), with a fault, trips and frames; every command in a process of its own:

    python bench/log_memory.py [--seconds 600] [--folder DIR] [--only review,diff] [--keep]
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from results import keep

from faultloop.io.mcap_writer import LogWriter

RATE, SECOND_NS = 4800, 1_000_000_000
LIMIT_MB = 1000


def write_log(path: Path, seconds: int) -> None:
    """One second of noisy waves and estimates, again and again; a fault at 40 % of the time, cleared."""
    dice = np.random.default_rng(0)
    count = np.arange(RATE)
    turn = np.exp(2j * np.pi * 50 * count / RATE)[:, None]
    phasors = np.array([127e3, 127e3, 127e3, 400, 400, 400]) * np.exp(1j * np.radians([0, -120, 120] * 2))
    samples = np.sqrt(2) * np.real(phasors * turn) + dice.normal(size=(RATE, 6))
    pairs = np.stack([phasors.real, phasors.imag], axis=1).reshape(-1)
    estimates = np.hstack([pairs + dice.normal(size=(RATE, 12)), np.full((RATE, 2), 50.0)])
    loops = 300 + dice.normal(size=(RATE, 12))
    fault = int(0.4 * seconds)
    with LogWriter(path, 1_577_836_800 * SECOND_NS) as log:
        for name in ("RA", "RB"):
            log.add_relay(name, ["PDIS1", "PDIS2", "PTRC1"])
        closed = {"pole_a": True, "pole_b": True, "pole_c": True}
        log.message("/breaker/QA", 0, "BreakerStatus", **closed)
        for second in range(seconds):
            t_ns = second * SECOND_NS + count * SECOND_NS // RATE
            words = np.zeros(RATE, np.uint64)
            if second == fault:
                words[100:700] = 5
                log.message("/plant/faults", int(t_ns[0]), "FaultState", fault=0, on=True, type="AG")
                trip = {"function": "PDIS1", "zone": 1, "loop": "AG", "poles": 7}
                log.message("/relay/RA/trips", int(t_ns[100]), "Trip", sample_count=100, **trip)
                log.message("/breaker/QA", int(t_ns[110]), "BreakerStatus", command="open", **closed)
                log.message("/breaker/QA", int(t_ns[300]), "BreakerStatus")
                log.message("/plant/faults", int(t_ns[400]), "FaultState", fault=0, on=False, type="AG")
            for name in ("RA", "RB"):
                log.relay_block(name, t_ns, second * RATE + count, samples, estimates, loops, words, words)
            for k in range(50):
                log.message("/can", int(t_ns[96 * k]), "CanFrame", id=0x300, data=bytes(8), direction="rx")


def measured(arguments: list[str], folder: Path) -> tuple[float, float, float, int]:
    """Peak resident memory [MB], time and processor time [s], and status of a command."""
    begin = time.perf_counter()
    process = subprocess.Popen(
        [sys.executable, "-m", "faultloop", *arguments], cwd=folder, stdout=subprocess.DEVNULL
    )
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    cpu = usage.ru_utime + usage.ru_stime
    return usage.ru_maxrss / 1024, time.perf_counter() - begin, cpu, process.returncode


def main() -> None:
    options = argparse.ArgumentParser()
    options.add_argument("--seconds", type=int, default=600)
    options.add_argument("--folder", type=Path, default=None)
    options.add_argument("--only", default="")
    options.add_argument("--keep", action="store_true", help="leave the figures for docs/evidence.py")
    given = options.parse_args()
    with tempfile.TemporaryDirectory(dir=given.folder) as made:
        folder = Path(made)
        begin = time.perf_counter()
        write_log(folder / "long.mcap", given.seconds)
        size = (folder / "long.mcap").stat().st_size / 1e9
        took = time.perf_counter() - begin
        print(f"{given.seconds} s of two relays: {size:.2f} GB, written in {took:.0f} s")
        commands = {
            "review": ["review", "long.mcap"],
            "review --html --png": ["review", "long.mcap", "--html", "x.html", "--png", "x.png"],
            "why": ["why", "long.mcap"],
            "layout": ["layout", "long.mcap", "--foxglove", "f.json", "--plotjuggler", "p.xml"],
            "locate": ["locate", "long.mcap", "long.mcap", "--relay-a", "RA", "--relay-b", "RB"],
            "diff": ["diff", "long.mcap", "long.mcap"],
            "recover": ["recover", "long.mcap", "out.mcap"],
            "export --comtrade": ["export", "long.mcap", "--comtrade", "x.cfg"],
            "export --parquet": ["export", "long.mcap", "--parquet", "parquet"],
            "export --csv": ["export", "long.mcap", "--csv", "csv"],
            "export --can": ["export", "long.mcap", "--can", "x.asc"],
        }
        wanted = given.only.split(",") if given.only else list(commands)
        told = []
        for name in wanted:
            peak, took, cpu, status = measured(commands[name], folder)
            told.append(f"{name} {peak:.0f} MB, {cpu:.1f} s" + (f", status {status}" if status else ""))
            verdict = "" if peak < LIMIT_MB and not status else f"   more than {LIMIT_MB} MB, or failed"
            print(
                f"{name:22} {peak:7.0f} MB {took:7.1f} s ({cpu:.1f} s of cpu)  status {status}{verdict}",
                flush=True,
            )
        if given.keep:
            line = f"A log of {given.seconds} s, two relays, {size:.2f} GB: greatest memory, processor time"
            keep("A run explains itself", [(line, "; ".join(told))], beside=True)


if __name__ == "__main__":
    main()
