"""The processes of a study: one that dies ends it in one line, and none is left."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from faultloop.errors import InputError
from faultloop.study.pool import pool_of

ROOT = Path(__file__).resolve().parents[2]
NOTHING = InputError("nothing is kept")


def test_work_is_done_and_nobody_is_left() -> None:
    with pool_of(2, lambda: NOTHING) as pool:
        assert [future.result() for future in [pool.submit(abs, -n) for n in range(5)]] == [0, 1, 2, 3, 4]
    assert multiprocessing.active_children() == []


def test_a_worker_that_dies_and_work_that_fails() -> None:
    with pytest.raises(InputError, match="nothing is kept"), pool_of(2, lambda: NOTHING) as pool:
        pool.submit(os._exit, 1).result()
    with pytest.raises(ValueError, match="invalid literal"), pool_of(2, lambda: NOTHING) as pool:
        pool.submit(int, "x").result()
    deadline = time.monotonic() + 30
    while multiprocessing.active_children() and time.monotonic() < deadline:
        time.sleep(0.01)
    assert multiprocessing.active_children() == []


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="needs /proc")
def test_a_worker_that_is_killed_as_it_begins(tmp_path: Path) -> None:
    """While the pool begins the next one: Python's own waited for that for ever, one time in three."""
    campaign = tmp_path / "c.toml"
    campaign.write_text(
        f'[campaign]\nname = "kill"\nscenario = "{ROOT / "scenarios" / "ag-zone1.toml"}"\ncases = 200\n'
        'sampling = "random"\n[[vary]]\nkey = "fault.F1.at_pu"\nuniform = [0.02, 0.98]\n'
        '[[judge]]\nrelay = "RA"\nwhere = "inside"\ntrip = true\n',
        encoding="utf-8",
    )
    command = [sys.executable, "-m", "faultloop", "campaign", campaign, "--workers", "2"]
    for number in range(12):
        out = tmp_path / str(number) / "c.parquet"
        out.parent.mkdir()
        with subprocess.Popen([*command, "--out", out], stderr=subprocess.PIPE, text=True) as process:
            children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
            while not (workers := [pid for pid in children.read_text().split() if is_worker(pid)]):
                time.sleep(0.002)
            os.kill(int(workers[0]), signal.SIGKILL)
            _, err = process.communicate(timeout=120)
        assert process.returncode == 2
        assert "a worker died" in err and err.count("\n") == 1


def is_worker(pid: str) -> bool:
    try:
        return b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return False
