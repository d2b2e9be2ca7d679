"""The relay's decision, sample by sample: memory, phase selection, direction, zones, trip, location."""

from __future__ import annotations

import numpy as np

from faultloop.jit import njit
from faultloop.relay import memory, pdis, phs, ptrc, rdir, rflo

LOOP_BITS = 6


@njit
def watch_breaker(c, s):
    """A pole that opens makes a new normal: the memory starts again a cycle later, blind until then."""
    opened = s.was_closed & ~s.closed
    s.was_closed = s.closed
    if opened and s.closed:
        s.memory.blind = c.cycle
    if s.memory.blind > 0:
        s.memory.blind -= 1
        s.memory.frozen = 0
        if s.memory.blind == 0:
            memory.fill(c, s.memory, s.x)
    return s.memory.blind == 0


@njit
def rest(s, count):
    """No disturbance: nothing selected, nothing started."""
    s.selection.fault = 0
    s.selection.candidate = 0
    s.selection.count = 0
    s.direction.direction = 0
    s.direction.candidate = 0
    s.direction.count = 0
    for k in range(count):
        pdis.reset_zone(s.zone[k])


@njit
def protect(c, zones, s):
    """One sample of a disturbance: select, find the direction, step the zones.  True if any has started."""
    for k in range(6):
        s.d[k] = s.x[k] - s.memory.reference[k]
    phs.sequences(s.x, s.sequence)
    phs.sequences(s.d, s.change)
    phs.select(c, s)
    rdir.decide(c, s)
    s.memory.fed |= memory.current_differs(c, s.x, s.memory.reference)
    if (
        not s.memory.fed
    ):  # a voltage alone is a voltage transformer's fault, or a fault that does not reach us
        return False
    started = pdis.step_zones(c, zones, s)
    if started:
        rflo.step_location(c, s)
    return started


@njit
def word(c, zones, s, users, out):
    """Bits of pickup and operate: zones, direction, released loops, trip, user elements."""
    count = zones.shape[0]
    pickup, operate, started = 0, 0, 0
    for k in range(count):
        pickup |= s.zone[k].pickup << k
        operate |= s.zone[k].operate << k
    started = pickup != 0
    pickup |= (s.direction.direction > 0) << count
    pickup |= (s.direction.direction < 0) << (count + 1)
    pickup |= phs.released(c, s) << (count + 2)
    place = count + 2 + LOOP_BITS
    for k in range(users.shape[0]):
        on, op = users[k, 0] > 0.5, users[k, 1] > 0.5
        pickup |= on << (place + 1 + k)
        operate |= op << (place + 1 + k)
        started |= on
    pickup |= started << place
    operate |= (s.trip.poles != 0) << place
    out[0] = np.uint64(pickup)
    out[1] = np.uint64(operate)
    if out[0] != s.word[0] or out[1] != s.word[1]:
        s.changed += 1
        s.word[0] = out[0]
        s.word[1] = out[1]


@njit
def decide(constants, zones, state, phasors, users, words):
    """Run a block; stop after the first sample at which an output (trip poles, pilot) changed, or a
    fault was located.

    Parameters
    ----------
    constants, state : records ``CONSTANTS``, ``STATE``, shape (1,).
    zones : (z,) ``ZONE``.
    phasors : (n, 14) rows with their frequency filled in.
    users : (n, k, 2) pickup and operate of the user elements.
    words : (n, 2) uint64, written: pickup and operate bits.

    Returns the number of samples done.
    """
    c, s = constants[0], state[0]
    s.changed = 0
    for n in range(phasors.shape[0]):
        row = phasors[n]
        for k in range(6):
            s.x[k] = complex(row[2 * k], row[2 * k + 1])
        poles, pilot = s.trip.poles, s.trip.pilot
        told = s.trip.count + s.location.told
        ready = memory.remember(c, s.memory, s.x, row[12])
        ready &= watch_breaker(c, s)
        if ready and not s.memory.frozen and memory.differs(c, s.x, s.memory.reference):
            memory.freeze(s.memory)
        started = False
        if ready and s.memory.frozen:
            started = protect(c, zones, s)
            if not started and s.trip.poles == 0:
                inside = pdis.inside(s, zones.shape[0])
                memory.thaw(c, s.memory, s.x, row[12], s.selection.fault, inside)
        else:
            rest(s, zones.shape[0])
        user_operate = 0
        for k in range(users.shape[1]):
            user_operate |= (users[n, k, 1] > 0.5) << k
        ptrc.step_trip(c, zones, s, user_operate)
        if not started and s.trip.poles == 0:
            rflo.finish(s.location)
        word(c, zones, s, users[n], words[n])
        if s.trip.poles != poles or s.trip.pilot != pilot or s.trip.count + s.location.told != told:
            return n + 1
    return phasors.shape[0]
