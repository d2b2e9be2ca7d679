"""What tests measure beside what they assert, for docs/evidence.md."""

from __future__ import annotations

from typing import Protocol


class Measured(Protocol):
    """``measured("vector error", 0.03, "%")``: the greatest of all that a test hands over is kept."""

    def __call__(self, what: str, value: float, unit: str = "") -> None: ...
