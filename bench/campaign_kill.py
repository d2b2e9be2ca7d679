"""A campaign that is stopped at random moments and gone on with has the bytes of one that ran in one go.

    python bench/campaign_kill.py [--kills 20] [--cases 1500] [--seed 1] [--cluster]

In turns kill -9 of the campaign, of one of its workers, SIGINT, SIGTERM; with one worker and with two.  After
each the campaign is gone on with to its end, and its file and waves are compared with those of the one that
nobody stopped.  `--cluster`: also on a dask cluster, started as docs/campaigns.md says, where a worker, the
campaign and at last the scheduler are killed.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow.parquet as pq

from faultloop.config.toml_text import toml_text

ROOT = Path(__file__).resolve().parents[1]
WAIT_S = 120
CLEAN = {0, 2, 130, -signal.SIGKILL, -signal.SIGTERM, -signal.SIGINT}
"""Exit statuses: done in time, a worker died, interrupted, killed, ended before Python itself had begun."""
TRACKER = "ignore::UserWarning:multiprocessing.resource_tracker"
"""A campaign that is killed cannot clear away what its pool shares: Python's tracker does, and says so."""


class Kind(NamedTuple):
    """What is sent, to whom, with how many workers."""

    number: signal.Signals
    to_worker: bool
    workers: int

    def told(self) -> str:
        whom = "a worker" if self.to_worker else "the campaign"
        return f"{self.number.name} to {whom} of {self.workers}"


KINDS = (
    Kind(signal.SIGKILL, False, 1),
    Kind(signal.SIGKILL, False, 2),
    Kind(signal.SIGKILL, True, 2),
    Kind(signal.SIGINT, False, 2),
    Kind(signal.SIGTERM, False, 2),
    Kind(signal.SIGINT, False, 1),
    Kind(signal.SIGTERM, False, 1),
)


def tables(cases: int) -> dict[str, Any]:
    """200 ms cases of the shipped scenario, anywhere on the line."""
    scenario = str(ROOT / "scenarios" / "ag-zone1.toml")
    head = {"name": "kill", "scenario": scenario, "sampling": "random", "cases": cases}
    return {
        "campaign": head,
        "vary": [
            {"key": "fault.F1.at_pu", "uniform": [0.02, 0.98]},
            {"key": "fault.F1.type", "values": ["AG", "BC", "ABC"]},
            {"key": "scenario.duration_s", "values": [0.2]},
        ],
        "judge": [{"relay": "RA", "where": "inside", "trip": True, "within_ms": 60}],
    }


def command(campaign: Path, out: Path, *options: str) -> list[str]:
    own = ["campaign", str(campaign), "--out", str(out), "--keep", "samples", "--json", *options]
    return [sys.executable, "-m", "faultloop", *own]


def content(out: Path) -> str:
    """A digest of the file's bytes, and of each file of its waves."""
    digest = hashlib.sha256(out.read_bytes())
    for part in sorted(out.with_suffix(".waves").iterdir()):
        digest.update(part.name.encode() + part.read_bytes())
    return digest.hexdigest()


def finish(campaign: Path, out: Path, *options: str) -> dict[str, Any]:
    """To the end; what it says."""
    done = subprocess.run(command(campaign, out, *options), capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"went on with status {done.returncode}: {done.stderr}")
    return json.loads(done.stdout)


def children(pid: int) -> list[int]:
    try:
        return [int(one) for one in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
    except OSError:
        return []


def workers_of(pid: int) -> list[int]:
    """Not the process that tracks what spawned ones share."""
    own = []
    for child in children(pid):
        line = Path(f"/proc/{child}/cmdline")
        if line.exists() and b"spawn_main" in line.read_bytes():
            own.append(child)
    return own


def stopped(campaign: Path, out: Path, kind: Kind, after_s: float) -> tuple[int, int]:
    """Stops it after so long.  Its exit status, and how many cases were kept by then."""
    killed = kind.number is signal.SIGKILL and not kind.to_worker
    process = subprocess.Popen(
        command(campaign, out, "--workers", str(kind.workers)),
        env=os.environ | ({"PYTHONWARNINGS": TRACKER} if killed else {}),
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    begin = time.monotonic()
    while time.monotonic() - begin < after_s and process.poll() is None:
        time.sleep(0.01)
    whom = [process.pid]
    while kind.to_worker and process.poll() is None and not (whom := workers_of(process.pid)[:1]):
        time.sleep(0.01)  # none is there yet
    mine = workers_of(process.pid)
    if process.poll() is None:
        os.kill(whom[0], kind.number)
    _, err = process.communicate(timeout=WAIT_S)
    if process.returncode not in CLEAN or "Traceback" in err or err.count("\n") > 1:
        raise SystemExit(f"{kind.told()} after {after_s:.2f} s: status {process.returncode}\n{err}")
    deadline = time.monotonic() + 10
    while any(Path(f"/proc/{pid}").exists() for pid in mine):
        if time.monotonic() > deadline:
            raise SystemExit(f"{kind.told()}: a worker lives on")
        time.sleep(0.05)
    parts = Path(f"{out}.parts").glob("part-*.parquet")
    return process.returncode, sum(pq.read_metadata(part).num_rows for part in parts)


def trial(campaign: Path, out: Path, kind: Kind, after_s: float, whole: str) -> str:
    """Stop it, go on with it, compare; what happened."""
    status, kept = stopped(campaign, out, kind, after_s)
    was_whole = out.exists()
    summary = finish(campaign, out, "--workers", str(3 - kind.workers))
    if content(out) != whole:
        raise SystemExit(f"{kind.told()} after {after_s:.2f} s: another content")
    if summary["new"] > summary["cases"] - kept and not was_whole:
        raise SystemExit(f"{kind.told()}: {kept} were kept, and {summary['new']} were run again")
    if left := [p.name for p in out.parent.iterdir() if p.name.endswith((".tmp", ".parts"))]:
        raise SystemExit(f"{kind.told()}: left behind: {left}")
    for path in (out, out.with_suffix(".waves.md")):
        path.unlink()
    shutil.rmtree(out.with_suffix(".waves"))
    return f"status {status}, {kept} kept, {summary['new']} run after it"


def on_a_cluster(campaign: Path, out: Path, whole: str) -> None:
    """Two workers by the commands of the docs; one is killed in the middle, then the campaign."""
    environment = os.environ | {"DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "10"}
    dask = [sys.executable, "-m", "distributed.cli"]
    port = 20_000 + os.getpid() % 20_000
    address = f"tcp://127.0.0.1:{port}"
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "env": environment}
    own = ["--host", "127.0.0.1", "--port", str(port), "--no-dashboard"]
    started = [subprocess.Popen([*dask[:2], "distributed.cli.dask_scheduler", *own], **quiet)]
    try:
        for _ in range(2):
            options = [address, "--nthreads", "1", "--nworkers", "1", "--no-dashboard", "--no-nanny"]
            started.append(subprocess.Popen([*dask[:2], "distributed.cli.dask_worker", *options], **quiet))
        time.sleep(5)
        process = subprocess.Popen(command(campaign, out, "--scheduler", address), stdout=subprocess.DEVNULL)
        parts = Path(f"{out}.parts")
        while process.poll() is None and len(list(parts.glob("part-*.parquet"))) < 10:
            time.sleep(0.02)
        started[1].kill()
        while process.poll() is None and len(list(parts.glob("part-*.parquet"))) < 20:
            time.sleep(0.02)
        process.kill()
        process.wait()
        kept = len(list(parts.glob("part-*.parquet")))
        summary = finish(campaign, out, "--scheduler", address)
        if content(out) != whole:
            raise SystemExit("on a cluster: another content")
        new = summary["new"]
        print(f"on a cluster, a worker and the campaign killed: {kept} parts kept, {new} cases after it")
        Path(out).unlink()
        shutil.rmtree(out.with_suffix(".waves"))
        process = subprocess.Popen(
            command(campaign, out, "--scheduler", address), stderr=subprocess.PIPE, text=True
        )
        while process.poll() is None and len(list(parts.glob("part-*.parquet"))) < 10:
            time.sleep(0.02)
        started[0].kill()
        _, err = process.communicate(timeout=WAIT_S)
        print(f"its scheduler killed: status {process.returncode}, {err.strip()}")
        if process.returncode != 2 or err.count("\n") != 1:
            raise SystemExit("that is not one line and status 2")
        finish(campaign, out, "--workers", "2")
        if content(out) != whole:
            raise SystemExit("begun on a cluster, ended here: another content")
    finally:
        for one in started:
            one.kill()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--cases", type=int, default=1500)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--cluster", action="store_true")
    options = parser.parse_args()
    moments = random.Random(options.seed)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        campaign, out = folder / "c.toml", folder / "out" / "c.parquet"
        campaign.write_text(toml_text(tables(options.cases)), encoding="utf-8")
        whole, lasts = "", {}
        for number, workers in enumerate((1, 1, 2)):  # the first compiles what was not run before
            begin = time.monotonic()
            reference = folder / f"whole-{number}" / "c.parquet"
            finish(campaign, reference, "--workers", str(workers))
            lasts[workers] = time.monotonic() - begin
            if whole and content(reference) != whole:
                raise SystemExit("a second time, or two workers, make another file")
            whole = content(reference)
        alone, pair = lasts.values()
        print(f"{options.cases} cases: {alone:.1f} s with one worker, {pair:.1f} s with two: the same bytes")
        for number in range(options.kills):
            kind = KINDS[number % len(KINDS)]
            after_s = moments.uniform(0.0, lasts[kind.workers])
            told = trial(campaign, out, kind, after_s, whole)
            print(f"{number + 1:3}: {kind.told():32} after {after_s:5.2f} s: {told}", flush=True)
        if options.cluster:
            on_a_cluster(campaign, out, whole)
    print("every file as in one go")


if __name__ == "__main__":
    main()
