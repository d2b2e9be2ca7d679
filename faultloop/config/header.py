"""``[scenario]`` and ``[system]``: what a scenario is called, how long it runs, and at which rate."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from faultloop.config.tables import Table


def _iso_time(value: Any) -> Any:
    """A date and time, not the number that pydantic would take for one; within what a log can hold."""
    if not isinstance(value, (datetime, str)):
        raise ValueError(f"must be a date and time, as in 2020-01-01T00:00:00Z, not {value!r}")
    time = datetime.fromisoformat(value) if isinstance(value, str) else value
    if not 1970 <= time.year < 2200:
        raise ValueError(f"must be from 1970 to 2199, not in the year {time.year}")
    return time


class Header(Table):
    """``[scenario]``: the run as a whole: its name, how long it is, its seed and start."""

    name: str = Field(min_length=1)
    """What reports call it."""
    duration_s: Annotated[float, Field(gt=0, le=1e6)]
    """Simulated time."""
    seed: int = Field(default=1, ge=0, lt=2**63)
    """Of the noise and of chance on the bus; the same seed gives the same bytes."""
    start: Annotated[datetime, BeforeValidator(_iso_time)] = Field(
        default=datetime(2020, 1, 1, tzinfo=UTC), strict=False
    )
    """The simulated time's epoch, in the log and on the bus; without an offset it is UTC."""

    @property
    def start_ns(self) -> int:
        """Nanoseconds since 1970."""
        start = self.start if self.start.tzinfo else self.start.replace(tzinfo=UTC)
        delta = start - datetime(1970, 1, 1, tzinfo=UTC)
        return (delta.days * 86400 + delta.seconds) * 1_000_000_000 + delta.microseconds * 1000


class System(Table):
    """``[system]``: what all of the network has in common."""

    frequency_hz: Literal[50, 60]
    """Nominal."""
    base_kv: Annotated[float, Field(gt=0, le=2000)]
    """Line-to-line RMS."""
    sampling_hz: int = Field(default=4800, ge=400, le=100_000)
    """Sampled values per second; the relays' settings must have the same."""
    steps_per_sample: int = Field(default=4, ge=1, le=256)
    """Plant steps in one sampling interval: 52 us each by default."""
