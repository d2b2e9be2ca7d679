"""Differential data at a node: what it sends, and which of what it hears it takes.

A set of currents is taken once, in the order of its time, from an end that is set alike; everything else -
another line's, a recording, one under test - is refused and counted.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from faultloop.io.can.codes import FINE, JUMP, OLD, SETTINGS, STALE, TEST
from faultloop.io.can.differential import decode_set
from faultloop.io.can.record import Record
from faultloop.jit import njit

WAITING = 8
"""Sets that a relay may still have to take, of each source."""
MICROSECOND_NS = 1000
OLDEST_US, NEWEST_US = 1_000_000, 100_000
"""How far a set may be behind and ahead of the receiver's clock."""
NOT_ALIGNED = 1
"""Fine, but not to be given yet."""
LONGEST_TRIP_US = 500_000.0
SILENT_NS = 1_000_000_000
"""After which a source may begin again with an earlier time."""

SHARE = 1 / 16
"""Of a new offset, in the mean."""
STEP_US = 2000.0
"""By which the round trip differs from its mean where another path is taken ..."""
STEPS = 3
"""... so often in a row."""
JUMP_US = 1000.0
"""By which the two clocks differ from what they did: 18 degrees at 50 Hz, of which a slope of 0.3 makes no
trip.  Another path with ways that differ otherwise does it, too; after `STEPS` both are measured anew."""
SETTLING = 16
"""Sets that are not given after such a step, until the mean is of the new path."""

SOURCE = np.dtype(
    [
        ("number", "i8"),  # of the relay
        ("own", "i8"),  # of the relay that takes its sets
        ("agreement", "i8"),  # hash of what it must have alike
        ("by_channel", "i8"),  # 1: its clock is another, and known by the round trip
        ("count", "i8"),  # sets that were taken from the bus
        ("given", "i8"),  # of these to the relay
        ("time", "i8"),  # of the last one [us]
        ("heard_ns", "i8"),  # when that came; NOTHING before the first
        ("counter", "i8"),
        ("lost", "i8"),  # by the counter
        ("offset_us", "f8"),  # its clock against this one's
        ("trip_us", "f8"),  # the mean round trip; 0: none yet
        ("late_us", "f8"),  # the last set, by this end's clock
        ("steps", "i8"),
        ("settling", "i8"),
        ("switches", "i8"),  # how often another path was found
    ],
    align=True,
)
NOTHING = -1


@njit
def accept_set(
    s: Record, frame: Record, t_ns: int, clock_us: int, sent_us: NDArray[np.int64], m: Record
) -> int:
    """FINE and the set in ``m``, or minus the number of why a frame of this source is refused.

    ``clock_us`` is the receiver's clock at ``t_ns``, ``sent_us`` (256,) the times of its own sets by counter.
    The set's time then is by the receiver's clock, and ``values[6]`` by how much it was changed [us].
    """
    objection = decode_set(frame, m)
    if objection != FINE:
        return -objection
    if m.test:
        return -TEST
    if m.rejected != s.agreement:
        return -SETTINGS
    heard = s.heard_ns != NOTHING
    if heard and microseconds(m.time - s.time) <= 0 and t_ns - s.heard_ns < SILENT_NS:
        return -OLD
    if not s.by_channel and not -NEWEST_US <= microseconds(clock_us - m.time) <= OLDEST_US:
        return -STALE
    if heard:
        s.lost += (m.counter - s.counter - 1) & 0xFF
    s.counter = m.counter
    s.time = m.time
    s.heard_ns = t_ns
    m.values[6] = 0.0
    if s.by_channel:
        if not align(s, m, clock_us, sent_us):
            return -JUMP
        if s.trip_us == 0.0 or s.settling > 0:
            return NOT_ALIGNED
        shift = np.int64(np.rint(s.offset_us))
        m.time = (m.time - shift) & 0xFFFFFFFF
        m.values[6] = s.offset_us
    s.count += 1
    return FINE


@njit
def align(s: Record, m: Record, clock_us: int, sent_us: NDArray[np.int64]) -> bool:
    """The other end's clock against this one's, by the round trip: it says when it heard which of our sets.
    False where that is another than it was: one of the two clocks has jumped, or the ways differ now.

    Half of the round trip is the way here; if the ways differ by d, the offset is wrong by d / 2.
    """
    if s.settling > 0:
        s.settling -= 1
    known = s.trip_us > 0.0
    late_us = np.float64(microseconds(clock_us - m.time))
    if m.st_num == 0 or m.sq_num != s.own:
        # it has heard nothing of late, or speaks of a third end: the way here alone
        return not known or abs(late_us - s.late_us) <= STEP_US
    trip_us = np.float64(microseconds(clock_us - sent_us[m.page]) - m.st_num)
    offset_us = trip_us / 2 - late_us
    jumps = known and abs(offset_us - s.offset_us) > JUMP_US
    if 0.0 < trip_us < LONGEST_TRIP_US:
        s.steps = s.steps + 1 if jumps or (known and abs(trip_us - s.trip_us) > STEP_US) else 0
        if not known or s.steps >= STEPS:
            s.settling = SETTLING
            s.switches += known
            s.steps = 0
            s.trip_us, s.offset_us = trip_us, offset_us
        elif s.steps == 0:
            s.trip_us += SHARE * (trip_us - s.trip_us)
            s.offset_us += SHARE * (offset_us - s.offset_us)
    if not jumps:
        s.late_us = late_us
    return not jumps


@njit
def microseconds(difference: int) -> int:
    """Of two times modulo 2^32: the value nearest to zero."""
    return int((difference + (1 << 31)) % (1 << 32) - (1 << 31))


def sources(own: int, numbers: Any, agreement: int) -> Any:
    """Of relays by number, that must have this hash, for relay ``own``; with bit 16 the channel aligns."""
    found = np.zeros(len(numbers), SOURCE)
    found["own"], found["number"], found["agreement"] = own, numbers, agreement & 0xFFFF
    found["by_channel"], found["heard_ns"] = agreement >> 16 & 1, NOTHING
    return found
