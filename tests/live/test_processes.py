"""Processes on real SocketCAN."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.vcan import needs_vcan, passes_on_vcan


@needs_vcan
def test_on_vcan(root: Path) -> None:
    passes_on_vcan(root, Path(__file__).with_name("processes_on_vcan.py"), 600)


@needs_vcan
@pytest.mark.slow
def test_the_others_on_vcan(root: Path) -> None:
    passes_on_vcan(root, Path(__file__).with_name("processes_on_vcan.py"), 900, "slow")
