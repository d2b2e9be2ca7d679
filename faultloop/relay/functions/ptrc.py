"""PTRC: which poles to trip, and for how long."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import Field

from faultloop.config.tables import Milliseconds, Positive, Table
from faultloop.errors import InputError
from faultloop.jit import njit
from faultloop.relay.events import Event, Names, Trip, poles_text
from faultloop.relay.functions.function import Function
from faultloop.relay.memory import size2
from faultloop.relay.quantities import FAULTS, Record

if TYPE_CHECKING:
    from faultloop.relay.settings import RelaySettings


class Ptrc(Table):
    """``[ptrc]``: trip logic."""

    mode: Literal["three-pole", "single-pole"] = "three-pole"
    """Single-pole: one pole for a one-phase fault, three for every other."""
    zones: tuple[int, ...] | None = Field(default=None, strict=False)
    """The zones that trip; all where not given."""
    minimum_trip_ms: Milliseconds = 80.0
    """A trip lasts at least this long, and until the poles' current is gone or the breaker says open."""
    open_current_a: Positive | None = None
    """A pole below it is open; 20 A primary where not given."""
    pilot_zone: Annotated[int, Field(ge=1)] | None = None
    """The zone whose start is sent to the far end."""


def values(settings: RelaySettings, table: Ptrc) -> dict[str, Any]:
    """Mode and duration of a trip."""
    return {
        "single_pole": table.mode == "single-pole",
        "minimum_trip": settings.samples(table.minimum_trip_ms),
    }


def check(settings: RelaySettings) -> None:
    """The zones it names are there."""
    zones = [zone.zone for zone in settings.pdis]
    table = settings.ptrc
    for key, wanted in (("zones", table.zones or ()), ("pilot_zone", (table.pilot_zone,))):
        for zone in wanted:
            if zone is not None and zone not in zones:
                listed = ", ".join(map(str, dict.fromkeys(zones))) or "none"
                raise InputError(f"there is no zone {zone}; zones: {listed}", key=f"ptrc.{key}")


@njit
def poles_for(q: Record, c: Record, w: Record) -> int:
    """Poles to trip for the fault of this sample's request.

    One pole only in single-pole mode, for a one-phase fault, with all poles closed and no other pole
    tripped; everything else - a fault that grows, a second fault while a pole is open, one after which no
    pole alone would be closed again - is three poles.
    """
    fault = q.request.fault
    if c.single_pole and 1 <= fault <= 3 and q.closed == 7 and not (q.request.three_pole or q.three_pole):
        pole = 1 << (fault - 1)
        if w.poles == 0 or w.poles == pole:
            return pole
    return 7


@njit
def gone(g: Record, q: Record, w: Record) -> bool:
    """Whether every tripped pole is open: its current is gone, or the breaker says so."""
    for phase in range(3):
        pole = 1 << phase
        if w.poles & pole and q.closed & pole and size2(q.x[3 + phase]) >= g.open_current**2:
            return False
    return True


@njit
def step(g: Record, q: Record, c: Record, w: Record) -> None:
    """One sample of the trip logic; publishes ``q.poles``."""
    if w.poles:
        w.timer += 1
    if q.request.made:
        poles = w.poles | poles_for(q, c, w)
        if poles != w.poles:
            w.poles = poles
            w.timer = 0
            w.bit = q.request.bit
            w.fault = q.request.fault
            w.count += 1
            q.notices += 1
    elif w.poles and w.timer >= c.minimum_trip and gone(g, q, w):
        w.poles = 0
    q.poles = w.poles
    q.pickup |= np.uint64(q.started) << np.uint64(c.bit)
    q.operate |= np.uint64(w.poles != 0) << np.uint64(c.bit)


def tell(names: Names, was: np.void, now: np.void) -> Iterator[Event]:
    """A trip, or another pole of it, as text and as data; its end."""
    if now["count"] != was["count"]:
        function, zone = names.source(int(now["bit"]))
        trip = Trip(function, zone, FAULTS[int(now["fault"])], int(now["poles"]))
        text = f"PTRC1 Tr poles {poles_text(trip.poles)} zone {trip.zone} loop {trip.loop}"
        yield Event(names.sample, "warning", text, trip)
    elif was["poles"] and not now["poles"]:
        yield Event(names.sample, "info", "PTRC1 Tr reset")


PTRC = Function(
    name="PTRC",
    settings=Ptrc,
    step=step,
    constants=(("single_pole", "i8"), ("minimum_trip", "i8")),
    values=values,
    state=(
        ("poles", "i8"),
        ("timer", "i8"),
        ("bit", "i8"),  # of the function that tripped
        ("fault", "i8"),
        ("count", "i8"),  # trips so far
    ),
    always=True,
    told=False,  # the trip is, with its poles
    tell=tell,
    trips=True,
    check=check,
)
