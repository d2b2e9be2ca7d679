"""What a scenario file may say of a relay's clock: ``[[clock]]``."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Annotated

from pydantic import Field

from faultloop.config.tables import Name, Seconds, Table
from faultloop.errors import InputError, nearest


class Clock(Table):
    """``[[clock]]``: of a relay, beside the run's time; exact where there is none."""

    node: Name
    """A relay."""
    offset_us: Annotated[float, Field(ge=-500_000, le=500_000)] = 0.0
    """By how much it is ahead."""
    drift_ppm: Annotated[float, Field(ge=-1000, le=1000)] = 0.0
    """How fast it drifts once it has no time from outside."""
    lost_at_s: Seconds | None = None
    """From then on it has none, and knows that; 0: it never had."""

    @property
    def numbers(self) -> tuple[int, int, int | None]:
        """Offset [ns], drift [ppb], when the time is lost [ns]."""
        lost_ns = None if self.lost_at_s is None else round(self.lost_at_s * 1e9)
        return round(self.offset_us * 1e3), round(self.drift_ppm * 1e3), lost_ns


def check_references(clocks: Sequence[Clock], relays: Iterable[str]) -> None:
    """Relays that must exist, each with one clock; raises InputError."""
    names, seen = list(relays), set()
    for number, clock in enumerate(clocks):
        key = f"clock[{number}].node"
        if clock.node not in names:
            raise InputError(f"there is no relay '{clock.node}'; {nearest(clock.node, names)}", key=key)
        if clock.node in seen:
            raise InputError(f"two of them are of '{clock.node}'", key=key)
        seen.add(clock.node)
