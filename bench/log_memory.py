"""Peak memory and time of what reads a log, on logs that are larger than they may be.

A run of 600 s of two relays (3.6 GB), and a short one with 200,000 events, frames, changes of a breaker and
of a record's channels beside it; every command in a process of its own:

    python bench/log_memory.py [--seconds 600] [--events 200000] [--folder DIR] [--only review,diff] [--keep]
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from results import keep

import faultloop
from faultloop.io.mcap_file import LOG_RECORD
from faultloop.io.mcap_reader import open_log
from faultloop.io.mcap_writer import LogWriter
from faultloop.live.merge import merge

AG = Path(__file__).resolve().parents[1] / "scenarios" / "ag-zone1.toml"
MS, LIMIT_MB = 1_000_000, 1000
RERUN = ["--rerun", "x.rrd"]
LONG = {
    "review": ["review", "long.mcap"],
    "review --html --png": ["review", "long.mcap", "--html", "x.html", "--png", "x.png"],
    "review --rerun": ["review", "long.mcap", *RERUN],
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
RESTLESS = {
    name: [*words[:1], *(word.replace("long", "restless") for word in words[1:])]
    for name, words in LONG.items()
    if name.startswith(("review", "why", "locate", "diff"))
}


def write_long(path: Path, seconds: int) -> None:
    """A run of two relays; a fault at 40 % of the time, cleared from both ends."""
    faultloop.run(
        AG, log=path, overrides=[f"scenario.duration_s={seconds}", f"fault.F1.after_s={0.4 * seconds}"]
    )


def write_restless(path: Path, count: int) -> None:
    """A short run, and beside it so many events, frames, changes of a breaker and of a record's channels."""
    run, beside = path.with_name("run.mcap"), path.with_name("beside.mcap")
    faultloop.run(AG, log=run)
    log = open_log(run)
    with LogWriter(beside, log.start_ns) as extra:
        for k in range(count):
            t_ns, on = k * MS, bool(k % 2)
            extra.message("/relay/RA/events", t_ns, "foxglove.Log", name="RA", message=f"event {k}", level=2)
            extra.message("/can", t_ns, "CanFrame", id=0x300, data=bytes(8), direction="rx")
            extra.message("/breaker/QC", t_ns, "BreakerStatus", pole_a=on, pole_b=on, pole_c=on)
            extra.message("/record/digital", t_ns, "RecordDigital", number=k % 8, name=f"D{k % 8}", on=on)
    metadata = {name: values for name, values in log.metadata.items() if name != LOG_RECORD}
    merge([run, beside], path, log.start_ns, metadata, log.attachments)


WATCHED = """
import atexit, re, sys
from pathlib import Path
def told():
    Path(told.where).write_text(re.search(r"VmHWM:\\s+(\\d+)", Path("/proc/self/status").read_text())[1])
told.where = sys.argv.pop(1)
atexit.register(told)
from faultloop.cli import main
main()
"""
"""A command that leaves its own peak [kB]: the kernel tells the parent never less than the parent had."""


def measured(arguments: list[str], folder: Path) -> tuple[float, float, float, int]:
    """Peak resident memory [MB], time and processor time [s], and status of a command."""
    begin, peak = time.perf_counter(), folder / "peak"
    process = subprocess.Popen(
        [sys.executable, "-c", WATCHED, str(peak), *arguments], cwd=folder, stdout=subprocess.DEVNULL
    )
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    cpu = usage.ru_utime + usage.ru_stime
    return int(peak.read_text()) / 1024, time.perf_counter() - begin, cpu, process.returncode


def told_of(log: Path, commands: dict[str, list[str]], made: str) -> str:
    """Every command's peak and time, printed as they come; one line of them all."""
    size = log.stat().st_size / 1e9
    print(f"{made}: {size:.2f} GB")
    told = []
    for name, words in commands.items():
        peak, took, cpu, status = measured(words, log.parent)
        told.append(f"{name} {peak:.0f} MB, {cpu:.1f} s" + (f", status {status}" if status else ""))
        verdict = "" if peak < LIMIT_MB and not status else f"   more than {LIMIT_MB} MB, or failed"
        print(
            f"{name:22} {peak:7.0f} MB {took:7.1f} s ({cpu:.1f} s of cpu)  status {status}{verdict}",
            flush=True,
        )
    return "; ".join(told)


def main() -> None:
    options = argparse.ArgumentParser()
    options.add_argument("--seconds", type=int, default=600)
    options.add_argument("--events", type=int, default=200_000)
    options.add_argument("--folder", type=Path, default=None)
    options.add_argument("--only", default="")
    options.add_argument("--keep", action="store_true", help="leave the figures for docs/evidence.py")
    given = options.parse_args()
    wanted = given.only.split(",") if given.only else list(LONG)
    long, restless = ({n: w for n, w in own.items() if n in wanted} for own in (LONG, RESTLESS))
    with tempfile.TemporaryDirectory(dir=given.folder) as made:
        folder, lines = Path(made), []
        if given.seconds:
            write_long(folder / "long.mcap", given.seconds)
            what = f"A log of {given.seconds} s, two relays"
            lines.append((what, told_of(folder / "long.mcap", long, what)))
        if given.events:
            write_restless(folder / "restless.mcap", given.events)
            what = (
                f"A log of {given.events:,} events, frames, changes of a breaker and of a record's channels"
            )
            lines.append((what, told_of(folder / "restless.mcap", restless, what)))
        if given.keep:
            kept = [(f"{what}: greatest memory, processor time", told) for what, told in lines]
            keep("A run explains itself", kept, beside=True)


if __name__ == "__main__":
    main()
