"""What the participants on a bus are made from."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from pydantic import Field

from faultloop.config.bus_fault import BusFault
from faultloop.config.can import Can
from faultloop.config.channel import Channel
from faultloop.config.clock import Clock
from faultloop.config.iec61850 import Iec61850
from faultloop.config.time_sync import TimeSync
from faultloop.plant.component import PlantTables

if TYPE_CHECKING:
    from faultloop.plant.breaker import Breaker
    from faultloop.plant.fault import Fault
    from faultloop.plant.line import Line
    from faultloop.plant.source import Source
    from faultloop.plant.switching import Switching


class BusTables(PlantTables):
    """The tables of the plant, of the bus and of what befalls it."""

    can: Can = Can()
    iec61850: Iec61850 = Iec61850()
    bus_fault: tuple[BusFault, ...] = Field(default=(), strict=False)
    channel: tuple[Channel, ...] = Field(default=(), strict=False)
    clock: tuple[Clock, ...] = Field(default=(), strict=False)
    time_sync: TimeSync | None = None

    if TYPE_CHECKING:  # fields that the components bring; for the eyes of a type checker
        source: tuple[Source, ...]
        line: tuple[Line, ...]
        fault: tuple[Fault, ...]
        breaker: tuple[Breaker, ...]
        switching: tuple[Switching, ...]

    @property
    def keys_path(self) -> Path | None:
        """The key file, where there is one."""
        if self.can.keys is None:
            return None
        return (self._path.parent if self._path else Path()) / self.can.keys
