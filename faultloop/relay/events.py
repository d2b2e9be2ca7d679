"""What a person reads, and the trip as data."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from faultloop.relay.settings import RelaySettings

Level = Literal["info", "warning", "error"]


@dataclass(frozen=True)
class Trip:
    """A trip: function ``PDIS1``, zone (0 for a user's element), loop AG .. CA or ABC, mask of poles."""

    function: str
    zone: int
    loop: str
    poles: int


@dataclass(frozen=True)
class Event:
    """Something that happened at a sample, as a line of text; ``trip`` where it is one."""

    sample_count: int
    """Samples taken since the start."""
    level: Level
    """How serious it is."""
    text: str
    trip: Trip | None = None


@dataclass(frozen=True)
class Outputs:
    """Output contacts: masks of poles to trip and to close, of the pilot signal, to trip far away, and of
    the breakers around; how many sets of differential data were measured."""

    trip_poles: int = 0
    """Poles to trip."""
    close_poles: int = 0
    """Poles to close."""
    pilot: int = 0
    """Of the pilot signal."""
    transfer: int = 0
    """Poles to trip at the far ends."""
    back_trip: int = 0
    """Poles that the breakers around shall open."""
    phasors: int = 0
    """Sets of differential data that were measured."""

    @property
    def masks(self) -> tuple[int, int, int, int, int]:
        """The contacts, in that order."""
        return self.trip_poles, self.close_poles, self.pilot, self.transfer, self.back_trip


@dataclass(frozen=True)
class Names:
    """What a function needs to tell an event: the sample, the settings, and who is behind a bit."""

    sample: int
    settings: RelaySettings
    sources: dict[int, tuple[str, int]]

    def source(self, bit: int) -> tuple[str, int]:
        """Name and zone (0 for a function without zones) of the instance whose first bit this is."""
        return self.sources[bit]


def poles_text(mask: int) -> str:
    """``AB`` for 3."""
    return "".join(pole for bit, pole in enumerate("ABC") if mask >> bit & 1)
