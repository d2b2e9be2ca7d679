"""PTRC: which poles to trip, and for how long."""

from __future__ import annotations

from faultloop.jit import njit
from faultloop.relay.memory import size2


@njit
def poles_for(c, s, fault):
    """Poles to trip for a fault of this type.

    One pole only in single-pole mode, for a one-phase fault, with all poles closed and no other pole
    tripped; everything else - a fault that grows, a second fault while a pole is open - is three poles.
    """
    if c.single_pole and 1 <= fault <= 3 and s.closed == 7:
        pole = 1 << (fault - 1)
        if s.trip.poles == 0 or s.trip.poles == pole:
            return pole
    return 7


@njit
def gone(c, s):
    """Whether every tripped pole is open: its current is gone, or the breaker says so."""
    for phase in range(3):
        pole = 1 << phase
        if s.trip.poles & pole and s.closed & pole and size2(s.x[3 + phase]) >= c.open_current**2:
            return False
    return True


@njit
def step_trip(c, zones, s, user_operate):
    """One sample of the trip logic; ``user_operate`` is the mask of the user elements that operate."""
    t = s.trip
    source, fault, operating = 0, 0, False
    for k in range(zones.shape[0] - 1, -1, -1):
        if s.zone[k].operate and zones[k].trips:
            source, fault, operating = k, s.zone[k].fault, True
    if not operating:
        mask = user_operate & c.user_trip
        for k in range(8):
            if (mask >> k) & 1 and not operating:
                source, fault, operating = -1 - k, s.selection.fault, True
    if t.poles:
        t.timer += 1
    if operating:
        poles = t.poles | poles_for(c, s, fault)
        if poles != t.poles:
            t.poles = poles
            t.timer = 0
            t.zone = source
            t.fault = fault
            t.count += 1
    elif t.poles and t.timer >= c.minimum_trip and gone(c, s):
        t.poles = 0
    pilot = 0
    for k in range(zones.shape[0]):
        if s.zone[k].pickup and zones[k].pilot:
            pilot = 1
    t.pilot = pilot
