"""candump, cansend, cantools, python-can's loggers and our monitor, beside a run on a real bus."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

HAS_VCAN = Path("/sys/class/net/vcan0").is_dir()


@pytest.mark.skipif(
    not HAS_VCAN and shutil.which("linux.uml") is None,
    reason="needs-vcan: no vcan0, and no guest for one: apt-get install user-mode-linux iproute2",
)
@pytest.mark.skipif(shutil.which("candump") is None, reason="needs-can-utils: apt-get install can-utils")
def test_tools_on_vcan(root: Path) -> None:
    """All of tools_on_vcan.py, by pytest, where vcan0 is."""
    environment = {key: value for key, value in os.environ.items() if not key.startswith("PYTEST_")}
    words = [sys.executable, "-m", "pytest", "-n", "0", "-q", "--rootdir", str(root)]
    done = subprocess.run(
        [sys.executable, root / "tests" / "with-vcan", *words, Path(__file__).parent / "tools_on_vcan.py"],
        cwd=root,
        env=environment,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "passed" in done.stdout
