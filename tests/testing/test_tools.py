"""candump, cansend, cantools, python-can's loggers and our monitor, beside a run on a real bus."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from tests.vcan import needs_vcan, passes_on_vcan

needs_can_utils = pytest.mark.skipif(
    shutil.which("candump") is None, reason="needs-can-utils: apt-get install can-utils"
)


@needs_vcan
@needs_can_utils
@pytest.mark.slow  # a guest of a minute; candump is in tests/io/can_on_vcan.py, too
def test_tools_on_vcan(root: Path) -> None:
    passes_on_vcan(root, Path(__file__).with_name("tools_on_vcan.py"), 300)


@needs_vcan
@needs_can_utils
@pytest.mark.slow
def test_the_users_breaker_among_processes_on_vcan(root: Path) -> None:
    passes_on_vcan(root, Path(__file__).with_name("tools_on_vcan.py"), 300, "slow")
