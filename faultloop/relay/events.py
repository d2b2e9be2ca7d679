"""What a person reads, and the trip as data."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from faultloop.relay.layout import FAULTS, LOOPS

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
    level: Level
    text: str
    trip: Trip | None = None


@dataclass(frozen=True)
class Outputs:
    """Output contacts: masks of poles to trip and to close, and the pilot bits."""

    trip_poles: int = 0
    close_poles: int = 0
    pilot: int = 0


def poles_text(mask: int) -> str:
    """``AB`` for 3."""
    return "".join(pole for bit, pole in enumerate("ABC") if mask >> bit & 1)


def loops_text(mask: int) -> str:
    """Released loops as a fault type where they are one: ``ABC`` for the three phase loops."""
    if mask == 0b111000:
        return FAULTS[7]
    return " ".join(loop for bit, loop in enumerate(LOOPS) if mask >> bit & 1)


def bit_texts(bits: tuple[str, ...], zones: int, before: tuple[int, int], now: tuple[int, int]) -> list[str]:
    """Lines for the zones and user elements whose pickup or operate changed (direction and phase selection
    are in the bits, and in the start's line)."""
    lines = []
    loops = loops_text(now[0] >> (zones + 2) & 0b111111)
    direction = "forward" if now[0] >> zones & 1 else "reverse" if now[0] >> (zones + 1) & 1 else ""
    for place, name in enumerate(bits):
        if zones <= place <= zones + 8:
            continue
        for kind, data in enumerate(("Str", "Op")):
            was, on = before[kind] >> place & 1, now[kind] >> place & 1
            if was == on:
                continue
            detail = f"{loops} {direction}" if place < zones and on else ""
            lines.append(" ".join(f"{name} {data} {detail if on else 'reset'}".split()))
    return lines
