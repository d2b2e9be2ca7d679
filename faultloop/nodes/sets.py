"""Differential data at a node: what it sends, and which of what it hears it takes.

A set of currents is taken once, in the order of its time, from an end that is set alike; everything else -
another line's, a recording, one under test - is refused and counted.

Whatever aligns the ends, the round trip is measured: each set says when the sender heard which of ours.  Half
of it is the way here, if both ways take the same; so the other clock is known but for half of what the ways
differ by.  Where both clocks are set from outside that rest is the ways' difference.  Where it changes by no
more than the round trip explains (half of that: Mills, RFC 5905, section 10) another path is taken, and the
clocks are what they were; by more, and a clock has jumped.
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
NOT, CHANNEL, GLOBAL = range(3)
"""How a clock is synchronized: not at all, to the other end, to a time that all have."""
BY_CHANNEL, HOLDS = 1 << 16, 1 << 17
"""Beside the hash of what ends have alike: the channel aligns; it does while the time is lost."""
LONGEST_TRIP_US = 500_000.0
SILENT_NS = 1_000_000_000
"""After which a source may begin again with an earlier time; without an answer for so long the round trip is
not known any more."""

SHARE = 1 / 32
"""Of a new offset, in the mean."""
STEP_US = 2000.0
"""By which the round trip differs from its mean where another path is taken ..."""
STEPS = 3
"""... so often in a row."""
DEVIATIONS = 4.0
"""Mean deviations of a round trip that varies, below which it is no other path (RFC 6298)."""
LUCKY, QUANTUM_US = 0.5, 20.0
"""Mean deviations that a round trip is below its mean, or as good as that, whose offset counts: half of one
is the mean of what is below, so there always are some."""
JUMP_US = 1000.0
"""By which a clock differs from what it did where it has jumped, or cannot be one: 18 degrees at 50 Hz, of
which a slope of 0.3 makes no trip."""
SETTLING = 16
"""Answers of which the first means are made, 40 ms at 50 Hz."""

SOURCE = np.dtype(
    [
        ("number", "i8"),  # of the relay
        ("own", "i8"),  # of the relay that takes its sets
        ("agreement", "i8"),  # hash of what it must have alike
        ("by_channel", "i8"),  # 1: its clock is another, and known by the round trip
        ("holds", "i8"),  # 1: the same while one of the two has lost the time
        ("count", "i8"),  # sets that were taken from the bus
        ("given", "i8"),  # of these to the relay
        ("time", "i8"),  # of the last one [us]
        ("heard_ns", "i8"),  # when that came; NOTHING before the first
        ("answered_ns", "i8"),  # when the last one came that told of one of ours
        ("counter", "i8"),
        ("lost", "i8"),  # by the counter
        ("offset_us", "f8"),  # its clock against this one's, by half the round trip
        ("half_us", "f8"),  # what of that is half the ways' difference
        ("clock_us", "f8"),  # what is left of it: its clock
        ("trip_us", "f8"),  # the mean round trip; 0: none yet
        ("vary_us", "f8"),  # its mean deviation
        ("late_us", "f8"),  # the last set, by this end's clock
        ("seen", "i8"),  # answers in the means
        ("lucky", "i8"),  # of these in the clock's
        ("steps", "i8"),  # in a row that are not of the mean
        ("settling", "i8"),  # answers until the means are, to sets ...
        ("since_us", "i8"),  # ... that were sent since then
        ("was_offset_us", "f8"),  # the means before
        ("was_trip_us", "f8"),
        ("doubted", "i8"),  # 1: the clock is not known until then
        ("timed", "i8"),  # answers in a row while both had the time of all
        ("learned", "i8"),  # 1: so the ways' difference was measured
        ("switches", "i8"),  # how often another path was found
        ("jumps", "i8"),  # and how often a clock that has jumped
    ],
    align=True,
)
NOTHING = -1


@njit
def accept_set(
    s: Record, frame: Record, t_ns: int, clock_us: int, timed: bool, sent_us: NDArray[np.int64], m: Record
) -> int:
    """FINE and the set in ``m``, or minus the number of why a frame of this source is refused.

    ``clock_us`` is the receiver's clock at ``t_ns``, ``timed`` whether it is that of all, ``sent_us`` (256,)
    the times of its own sets by counter.  The set's time then is by the receiver's clock, ``values[6]`` by
    how much it was changed [us], and ``state`` how the two ends are aligned.
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
    timed = timed and m.state == GLOBAL and not s.by_channel
    if not align(s, m, t_ns, clock_us, timed, sent_us):
        return -JUMP
    m.values[6] = 0.0
    m.state = aligned(s, t_ns, timed)
    if m.state == CHANNEL:
        m.time = (m.time - np.int64(np.rint(s.clock_us))) & 0xFFFFFFFF
        m.values[6] = s.clock_us
    s.count += 1
    return FINE


@njit
def aligned(s: Record, t_ns: int, timed: bool) -> int:
    """How the two clocks are known now."""
    known = s.trip_us > 0.0 and not s.doubted and t_ns - s.answered_ns < SILENT_NS
    if timed and (not known or abs(s.clock_us) < JUMP_US) and not s.doubted:
        return GLOBAL
    return CHANNEL if known and (s.by_channel or s.holds) else NOT


@njit
def align(s: Record, m: Record, t_ns: int, clock_us: int, timed: bool, sent_us: NDArray[np.int64]) -> bool:
    """Measures ways and clocks.  False where a set's clock is another than it was, or cannot be: one of the
    two has jumped."""
    late_us = np.float64(microseconds(clock_us - m.time))
    limit_us = max(STEP_US, DEVIATIONS * s.vary_us)
    if timed and late_us < -JUMP_US:
        return False  # heard before it was sent
    trip_us = 0.0
    if m.st_num > 0 and m.sq_num == s.own and sent_us[m.page] != NOTHING:
        trip_us = np.float64(microseconds(clock_us - sent_us[m.page]) - m.st_num)
    if not 0.0 < trip_us < LONGEST_TRIP_US:
        # it has heard nothing of late, or speaks of a third end: the way here alone
        fine = s.trip_us == 0.0 or abs(late_us - s.late_us) <= limit_us
        if fine:
            s.late_us = late_us
        return fine
    if timed and late_us - trip_us > JUMP_US:
        return False  # the same, at the other end
    s.answered_ns = t_ns
    s.timed = s.timed + 1 if timed else 0
    offset_us = trip_us / 2 - late_us
    if s.trip_us == 0.0:
        anew(s, trip_us, offset_us, not timed, sent_us[m.page])
    longer_us = abs(trip_us - s.trip_us)
    # what the round trip would explain, too: a jump while sets are on their way looks like a longer way
    jumps = s.settling == 0 and abs(offset_us - s.offset_us) > limit_us / 2
    if jumps or (s.settling == 0 and longer_us > limit_us):
        s.steps += 1
        if s.steps >= STEPS:
            anew(s, trip_us, offset_us, jumps or not timed, clock_us)
    elif s.settling == 0 or microseconds(sent_us[m.page] - s.since_us) >= 0:
        s.steps = 0
        mean(s, trip_us, offset_us)
        learn(s)
    if not jumps:
        s.late_us = late_us
    return not jumps


@njit
def anew(s: Record, trip_us: float, offset_us: float, doubted: bool, since_us: int) -> None:
    """Another path or another clock, or the first of them: the means begin anew, with what has gone there and
    back since then; until they are there the clock may be ``doubted``."""
    s.was_trip_us, s.was_offset_us = s.trip_us, s.offset_us
    s.doubted = 1 if doubted else s.doubted
    s.trip_us, s.offset_us, s.vary_us = trip_us, offset_us, 0.0
    s.seen, s.lucky, s.steps, s.settling, s.since_us = 0, 0, 0, SETTLING, since_us


@njit
def mean(s: Record, trip_us: float, offset_us: float) -> None:
    """One more answer in the means, and the last of the first ones."""
    s.seen += 1
    share = max(SHARE, 1.0 / s.seen)
    s.vary_us += share * (abs(trip_us - s.trip_us) - s.vary_us)
    s.trip_us += share * (trip_us - s.trip_us)
    # those that waited least tell most: what comes in a bunch has waited, its last one not as long
    if s.seen == 1 or trip_us <= s.trip_us - LUCKY * s.vary_us + QUANTUM_US:
        s.offset_us += max(SHARE, 1.0 / (s.lucky + 1)) * (offset_us - s.offset_us)
        s.lucky += 1
    if s.settling > 0:
        if s.seen == 1:  # what began it was on its way when it began
            s.trip_us, s.offset_us, s.vary_us = trip_us, offset_us, 0.0
        s.settling -= 1
        if s.settling == 0:
            settled(s)


@njit
def settled(s: Record) -> None:
    """What has become of it: a path that is longer by as much as the clock seems to be another leaves the
    clock alone, and its ways differ by the rest."""
    turned_us, longer_us = s.offset_us - s.was_offset_us, abs(s.trip_us - s.was_trip_us)
    s.doubted = 0
    if s.was_trip_us == 0.0:
        return
    if abs(turned_us) <= longer_us / 2 + JUMP_US and abs(s.half_us + turned_us) <= s.trip_us / 2:
        s.half_us += turned_us
        s.switches += 1
    else:
        s.jumps += 1


@njit
def learn(s: Record) -> None:
    """Clock and ways from the means; where both ends have the time of all, the ways."""
    if s.settling > 0:
        return
    if s.timed >= SETTLING and (not s.learned or abs(s.offset_us - s.half_us) < JUMP_US):
        s.half_us = s.offset_us
        s.learned = 1
    s.clock_us = s.offset_us - s.half_us


@njit
def microseconds(difference: int) -> int:
    """Of two times modulo 2^32: the value nearest to zero."""
    return int((difference + (1 << 31)) % (1 << 32) - (1 << 31))


def sources(own: int, numbers: Any, agreement: int) -> Any:
    """Of relays by number, that must have this hash, for relay ``own``; with `BY_CHANNEL` the channel aligns,
    with `HOLDS` while the time is lost."""
    found = np.zeros(len(numbers), SOURCE)
    found["own"], found["number"], found["agreement"] = own, numbers, agreement & 0xFFFF
    found["by_channel"], found["holds"] = agreement & BY_CHANNEL > 0, agreement & HOLDS > 0
    found["heard_ns"] = found["answered_ns"] = NOTHING
    return found
