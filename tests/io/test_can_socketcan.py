"""Frames over real SocketCAN."""

from __future__ import annotations

from pathlib import Path

from tests.vcan import needs_vcan, passes_on_vcan


@needs_vcan
def test_on_vcan(root: Path) -> None:
    passes_on_vcan(root, Path(__file__).with_name("can_on_vcan.py"), 300)
