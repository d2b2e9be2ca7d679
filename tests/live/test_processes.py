"""Processes on real SocketCAN: this machine's vcan0, or else a guest kernel that has one."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

HAS_VCAN = Path("/sys/class/net/vcan0").is_dir()
HERE = Path(__file__).parent


@pytest.mark.skipif(
    not HAS_VCAN and shutil.which("linux.uml") is None,
    reason="needs-vcan: no vcan0, and no guest for one: apt-get install user-mode-linux iproute2",
)
def test_on_vcan(root):
    """All of processes_on_vcan.py, by pytest, where vcan0 and vcan1 are."""
    environment = {key: value for key, value in os.environ.items() if not key.startswith("PYTEST_")}
    tests = HERE / "processes_on_vcan.py"
    pytest_here = [sys.executable, "-m", "pytest", "-n", "0", "-q", "--rootdir", root, tests]
    done = subprocess.run(
        [sys.executable, root / "tests" / "with-vcan", *pytest_here],
        cwd=root,
        env=environment,
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "passed" in done.stdout
