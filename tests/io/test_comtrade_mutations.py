"""Damaged records, as bench/comtrade_mutations.py makes them: played or refused in one line."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from faultloop.loop.replay import replay


def check(root: Path, shared: Path, cases: int, seed: int) -> None:
    # The relay is compiled (and that memory used) here, not in the process that is measured.
    replay(shared / "cases" / "comtrade-stop-zero" / "r.cfg", root / "scenarios" / "settings" / "ab-mho.toml")
    command = [sys.executable, str(root / "bench" / "comtrade_mutations.py"), str(cases), str(seed)]
    environment = os.environ | {"PYTHONPATH": str(root)}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    told = json.loads(done.stdout.splitlines()[-1])
    assert done.returncode == 0, done.stderr[-3000:]
    assert told["played"] + told["refused"] == cases
    assert told["played"] > cases // 20 and told["refused"] > cases // 20
    assert told["peak_mb"] <= 500


def test_mutations(root: Path, shared: Path) -> None:
    check(root, shared, 150, 0)


@pytest.mark.slow
def test_all_mutations(root: Path, shared: Path) -> None:
    check(root, shared, 2000, 100_000)
