"""Tests of your own CAN nodes against a simulated fault, in pytest: the fixture ``faultloop_bus``.

pytest finds it by itself where faultloop is installed; nothing is imported before a test asks for it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from faultloop.testing.bus import FaultloopBus
    from faultloop.testing.run import SeenFrame, SeenTrip, TestRun

_PLACES = {
    "FaultloopBus": "faultloop.testing.bus",
    "SeenFrame": "faultloop.testing.run",
    "SeenTrip": "faultloop.testing.run",
    "TestRun": "faultloop.testing.run",
}

__all__ = ["FaultloopBus", "SeenFrame", "SeenTrip", "TestRun"]


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module 'faultloop.testing' has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(_PLACES[name]), name)
