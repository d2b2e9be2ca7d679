"""Frames, and the processes of a run, over real SocketCAN."""

from __future__ import annotations

from pathlib import Path

from tests.vcan import needs_vcan, passes_on_vcan


@needs_vcan
def test_on_vcan(root: Path) -> None:
    """In one guest: to boot one and to import what the tests need takes half a minute."""
    processes = root / "tests" / "live" / "processes_on_vcan.py"
    passes_on_vcan(root, Path(__file__).with_name("can_on_vcan.py"), 900, "not slow", processes)
