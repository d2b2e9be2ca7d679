"""The time that the nodes of a bus have in common: who tells it, and who sets his clock by it.

The master sends a SYNC with the seconds of its time; where that frame has ended, every node stamps it by its
own clock, the master, too, which tells its own stamp in a follow-up.  So neither the wait for the bus nor
the frames' length is in it; what is left are the stamps' jitter and what a clock drifts by from one SYNC to
the next: 2 jitter + drift * period.

A node without a follow-up for `timeout_s` has no time any more, and knows it.  One that tells another time
than the node's clock by more than `jump_us` is refused, and the node has no time until it agrees again, or
has stood by the new one for `timeout_s`: so a node that did not hear of the new time has lost the old one
by then, and no two nodes go by different ones.
"""

from __future__ import annotations

import numpy as np

from faultloop.config.time_sync import TimeSync
from faultloop.io.can.codes import FINE, JUMP, SEQUENCE
from faultloop.io.can.record import Record, Records
from faultloop.io.can.time_sync import FOLLOW_UP, OVERFLOW, SEQUENCES, SYNC, TIME_SYNC, decode_time
from faultloop.jit import njit
from faultloop.nodes.chance import uniform
from faultloop.nodes.clock import CYCLIC, FOREVER, SECOND_NS, tick

FOLLOWS_NS = SECOND_NS // 2
"""A follow-up that comes later than this is of another SYNC."""
NONE = -1

MASTER = np.dtype(
    [
        ("period", CYCLIC),
        ("domain", "i8"),
        ("sequence", "i8"),
        ("seconds", "i8"),  # that the last SYNC has told
        ("awaits", "i8"),  # 1: its end on the bus
        ("stamp_ns", "i8"),  # the master's time at that
        ("follow_ns", "i8"),  # when the follow-up is due; FOREVER: none is
        ("out_ns", "i8"),
        ("back_ns", "i8"),
        ("step_ns", "i8"),  # from then on its time is another ...
        ("step_by_ns", "i8"),  # ... by so much
        ("jitter_ns", "f8"),
        ("seed", "u8"),
        ("count", "u8"),
    ],
    align=True,
)
"""Who tells the time."""

SLAVE = np.dtype(
    [
        ("follows", "i8"),  # 1: its clock is set by TIME_SYNC
        ("domain", "i8"),
        ("deaf_ns", "i8"),  # from then on it hears none
        ("sequence", "i8"),  # of the SYNC whose follow-up is awaited; NONE
        ("last", "i8"),  # of the one that has set the clock last
        ("seconds", "i8"),  # that this one has told
        ("heard_ns", "i8"),
        ("stamp_ns", "i8"),  # the own clock at its end
        ("offset_ns", "i8"),  # what is added to the own clock
        ("synced_ns", "i8"),  # when that was last confirmed; NONE: never
        ("timeout_ns", "i8"),
        ("limit_ns", "i8"),
        ("jumps", "i8"),  # refused
        ("other_ns", "i8"),  # another offset that is told now ...
        ("since_ns", "i8"),  # ... since then; NONE
        ("jitter_ns", "f8"),
        ("seed", "u8"),
        ("count", "u8"),
    ],
    align=True,
)
"""Who sets his clock by it."""


@njit
def jitter(c: Record) -> int:
    """Of the next stamp [ns]."""
    c.count += np.uint64(1)
    return int(np.int64(np.rint((2.0 * uniform(c.seed, c.count) - 1.0) * c.jitter_ns)))


@njit
def time_of(m: Record, t_ns: int) -> int:
    """The master's time [ns since the run's start]."""
    stepped = m.step_by_ns if t_ns >= m.step_ns else np.int64(0)
    return int(max(t_ns + stepped, 0))


@njit
def tell_time(m: Record, t_ns: int, out: Records, count: int) -> int:
    """The master's messages that are due, into ``out`` from ``count`` on; how many there are then."""
    if tick(m.period, t_ns) and not m.out_ns <= t_ns < m.back_ns:
        m.sequence = (m.sequence + 1) % SEQUENCES
        m.seconds = time_of(m, t_ns) // SECOND_NS
        m.awaits = 1
        _message(m, SYNC, m.seconds, 0, out[count])
        count += 1
    if t_ns >= m.follow_ns:
        m.follow_ns = FOREVER
        rest_ns = m.stamp_ns - m.seconds * SECOND_NS
        if 0 <= rest_ns < (OVERFLOW + 1) * SECOND_NS:
            _message(m, FOLLOW_UP, rest_ns % SECOND_NS, rest_ns // SECOND_NS, out[count])
            count += 1
    return count


@njit
def _message(m: Record, page: int, time: int, overflow: int, out: Record) -> None:
    out.kind = TIME_SYNC
    out.number = 0
    out.page = page
    out.counter = m.sequence
    out.st_num = m.domain
    out.time = time
    out.alarms = overflow


@njit
def confirm(m: Record, sequence: int, t_ns: int) -> None:
    """The master's SYNC of that sequence has ended on the bus."""
    if m.awaits and sequence == m.sequence:
        m.awaits = 0
        m.stamp_ns = time_of(m, t_ns) + jitter(m)
        m.follow_ns = t_ns


@njit
def take_time(s: Record, m: Record, t_ns: int, clock_ns: int) -> int:
    """A SYNC or a follow-up that has ended at ``t_ns``, when the own clock showed ``clock_ns``: FINE, or the
    number of why it does not count.  Another domain's is passed over."""
    if m.st_num != s.domain or t_ns >= s.deaf_ns:
        return FINE
    if m.page == SYNC:
        awaits = m.counter == s.sequence and t_ns - s.heard_ns <= FOLLOWS_NS
        if awaits or m.counter == s.last:
            return SEQUENCE  # the same once more, later: it would put the time back by as much
        s.sequence, s.seconds, s.heard_ns = m.counter, m.time, t_ns
        s.stamp_ns = clock_ns + jitter(s)
        return FINE
    if m.counter != s.sequence or t_ns - s.heard_ns > FOLLOWS_NS:
        return SEQUENCE
    s.sequence = NONE
    offset_ns = (s.seconds + (m.alarms & OVERFLOW)) * SECOND_NS + m.time - s.stamp_ns
    if s.synced_ns != NONE and abs(offset_ns - s.offset_ns) > s.limit_ns and not _stands(s, offset_ns, t_ns):
        s.jumps += 1
        return JUMP
    s.offset_ns, s.synced_ns, s.since_ns, s.last = offset_ns, t_ns, NONE, m.counter
    return FINE


@njit
def _stands(s: Record, offset_ns: int, t_ns: int) -> bool:
    """Whether that other time has been told for long enough."""
    if s.since_ns == NONE or abs(offset_ns - s.other_ns) > s.limit_ns:
        s.since_ns = t_ns
    s.other_ns = offset_ns
    return t_ns - s.since_ns >= s.timeout_ns


@njit
def has_time(s: Record, t_ns: int) -> bool:
    """Whether the clock is that of all."""
    return s.synced_ns != NONE and s.since_ns == NONE and t_ns - s.synced_ns <= s.timeout_ns


@njit
def knows_time(n: Record, t_ns: int) -> bool:
    """Whether a node's clock is that of all, whatever sets it."""
    return has_time(n.time, t_ns) if n.time.follows else t_ns < n.clock_lost_ns


@njit
def clock_us(n: Record, t_ns: int) -> int:
    """A node's clock [us], modulo 2^32, set by whatever sets it."""
    return int((oscillator_ns(n, t_ns) + n.time.offset_ns + 500) // 1000 & 0xFFFFFFFF)


@njit
def oscillator_ns(n: Record, t_ns: int) -> int:
    """What drives that clock; one that TIME_SYNC sets drifts all the time."""
    adrift_ns = t_ns if n.time.follows else max(t_ns - n.clock_lost_ns, 0)
    return int(t_ns + n.clock_ns + np.int64(np.rint(adrift_ns * 1e-9 * n.clock_ppb)))


@njit
def hear_time(n: Record, frame: Record, t_ns: int, m: Record) -> int:
    """A node, a ``NODE``, takes a TIME_SYNC frame: FINE, or the number of why it does not count."""
    objection = decode_time(frame, m)
    if objection == FINE and m.page == SYNC:
        confirm(n.master, m.counter, t_ns)
    if objection == FINE and n.time.follows:
        objection = take_time(n.time, m, t_ns, oscillator_ns(n, t_ns))
    return int(objection)


@njit
def clock_first(nodes: Records, t_ns: int) -> int:
    """`clock_us` for whoever is not compiled."""
    return clock_us(nodes[0], t_ns)


@njit
def has_time_first(nodes: Records, t_ns: int) -> bool:
    """`has_time` for whoever is not compiled."""
    return has_time(nodes[0].time, t_ns)


@njit
def confirm_first(masters: Records, t_ns: int) -> None:
    """`confirm` of the SYNC that has just been sent, for whoever is not compiled."""
    confirm(masters[0], masters[0].sequence, t_ns)


def set_master(m: Records, table: TimeSync, seed: int) -> None:
    """What the scenario says, into a (1,) ``MASTER`` whose period is set."""
    m["domain"], m["sequence"], m["follow_ns"] = table.domain, NONE, FOREVER
    m["out_ns"], m["back_ns"] = table.outage_ns or (FOREVER, FOREVER)
    m["step_ns"], m["step_by_ns"] = table.step_ns or (FOREVER, 0)
    m["jitter_ns"], m["seed"] = table.jitter_us * 1e3, seed


def set_slave(s: Records, table: TimeSync, seed: int, deaf_ns: int) -> None:
    """The same of a (1,) ``SLAVE``."""
    s["follows"], s["domain"], s["deaf_ns"] = 1, table.domain, deaf_ns
    s["sequence"] = s["last"] = s["synced_ns"] = s["since_ns"] = NONE
    s["timeout_ns"], s["limit_ns"] = round(table.timeout * 1e9), round(table.jump_us * 1e3)
    s["jitter_ns"], s["seed"] = table.jitter_us * 1e3, seed
