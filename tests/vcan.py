"""Tests that need vcan0: this machine's, or else the one of a guest kernel (tests/with-vcan)."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

needs_vcan = pytest.mark.skipif(
    not Path("/sys/class/net/vcan0").is_dir() and shutil.which("linux.uml") is None,
    reason="needs-vcan: no vcan0, and no guest for one: apt-get install user-mode-linux iproute2",
)


def passes_on_vcan(root: Path, file: Path, timeout_s: float, which: str = "not slow", *more: Path) -> None:
    """Run files of tests, or those with ``which`` marks, by pytest where vcan0 and vcan1 are; fails with its
    output."""
    environment = {key: value for key, value in os.environ.items() if not key.startswith("PYTEST_")}
    pytest_here = [sys.executable, "-m", "pytest", "-n", "0", "-q", "-m", which, "--rootdir", root]
    done = subprocess.run(
        [sys.executable, root / "tests" / "with-vcan", *pytest_here, file, *more],
        cwd=root,
        env=environment,
        capture_output=True,
        text=True,
        timeout=timeout_s,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "passed" in done.stdout
