"""``[can]``"""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from faultloop.config.tables import Table


class Can(Table):
    """``[can]``: the bus that the nodes share, and how its frames are protected."""

    interface: str = "virtual"
    """python-can's, or a transport's; `--can` overrides both."""
    channel: str = "faultloop"
    """Left out with the interface: a bus of the run's own."""
    bitrate: int = Field(default=500_000, ge=10_000, le=1_000_000)
    """Bit/s of the arbitration phase."""
    fd: bool = False
    """CAN FD, with its data phase at data_bitrate."""
    data_bitrate: int = Field(default=2_000_000, ge=10_000, le=8_000_000)
    """Bit/s of the data phase of CAN FD."""
    measurements_hz: Annotated[float, Field(ge=0, le=1000)] = 10.0
    """How often each relay publishes its measurements; 0 leaves them out."""
    heartbeat_s: Annotated[float, Field(ge=0.01, le=3600)] = 1.0
    """Interval of the heartbeat and the longest of the repetition of trip, close and pilot frames."""
    keys: Annotated[str, Field(min_length=1)] | None = None
    """Key file, relative to the scenario: with it trip, close, pilot and status frames are authenticated."""
    confirmations: int = Field(default=1, ge=1, le=4)
    """Frames in a row that must agree before a new state is acted upon; 2 costs 2 ms."""

    @property
    def named(self) -> bool:
        """A bus is asked for by its name: others may listen on it."""
        return bool(self.model_fields_set & {"interface", "channel"})

    @model_validator(mode="after")
    def _room_for_the_tag(self) -> Can:
        if self.keys is not None and not self.fd:
            raise ValueError("keys needs fd = true: an authenticated frame has 32 bytes")
        return self
