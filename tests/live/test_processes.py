"""Processes on real SocketCAN."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.vcan import needs_vcan, passes_on_vcan


@needs_vcan
@pytest.mark.slow  # the first two of them run in the guest of tests/io/test_can_socketcan.py
def test_on_vcan(root: Path) -> None:
    passes_on_vcan(root, Path(__file__).with_name("processes_on_vcan.py"), 1500, "slow or not slow")
