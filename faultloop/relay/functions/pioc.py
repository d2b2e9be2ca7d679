"""PIOC: instantaneous overcurrent, of phases, 3I0 or I2, directional where it should be.

A current above the pickup for ``confirm_ms`` operates: one sample of a travelling wave does not.  It
measures phasors of the fundamental, so neither the decaying offset nor an inrush's harmonics count in full.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from faultloop.config.tables import Milliseconds
from faultloop.jit import njit
from faultloop.relay.functions import overcurrent
from faultloop.relay.functions.function import Function
from faultloop.relay.functions.overcurrent import PHASE, Overcurrent, multiple
from faultloop.relay.quantities import Record, publish, request_trip

if TYPE_CHECKING:
    from faultloop.relay.settings import RelaySettings


class Pioc(Overcurrent):
    """``[[pioc]]``: one stage of instantaneous overcurrent."""

    confirm_ms: Milliseconds = 2.0
    """So long the current must stay above the pickup."""
    trip: bool = True
    """Whether its operate trips."""


def values(settings: RelaySettings, table: Pioc) -> dict[str, Any]:
    """The stage in primary amperes and samples."""
    return overcurrent.values(settings, table) | {
        "confirm": settings.samples(table.confirm_ms),
        "trips": table.trip,
    }


def check(settings: RelaySettings) -> None:
    """Of every stage."""
    overcurrent.check(settings, "pioc")


@njit
def step(g: Record, q: Record, c: Record, w: Record) -> None:
    """One sample of a stage."""
    if not q.settled:
        return
    above, kept = 0, 0
    for k in range(3 if c.quantity == PHASE else 1):
        m = multiple(g, q, c, w, k)
        above |= 1 if m > 1.0 else 0
        kept |= 1 if m >= c.dropout else 0
    w.count = w.count + 1 if above else 0
    if above and w.count > c.confirm:
        w.operated = 1
    elif not kept:
        w.operated = 0
    publish(q, c.bit, above or w.operated, w.operated)
    if w.operated and c.trips:
        request_trip(q, c.bit, q.fault, 1)


PIOC = Function(
    name="PIOC",
    settings=Pioc,
    step=step,
    constants=(*overcurrent.CONSTANTS, ("confirm", "i8"), ("trips", "i8")),
    values=values,
    state=(
        *overcurrent.STATE,
        ("count", "i8"),  # samples in a row above the pickup
        ("operated", "i8"),
    ),
    most=8,
    check=check,
)
