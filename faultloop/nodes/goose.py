"""Repetition and acceptance of state messages, as GOOSE does it (IEC 61850-8-1, clause 18).

A change of state is sent at once under a new state number, then repeated at growing intervals up to the
heartbeat; a receiver acts on each state once, and supervises that the repetitions keep coming.  Kernels over
records, in integer nanoseconds: the compiled loop steps the same ones as a node on a real bus.

Departure from GOOSE, whose numbers have 32 bits: `st_num` and `sq_num` have 8 here, to leave room for the
time of sending in 8 bytes.  So the time is what orders two frames; the numbers tell what step it was.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np

from faultloop.io.can.codes import BEFORE_START, FINE, INCONSISTENT, OLD, SEQUENCE, STALE, TEST
from faultloop.io.can.e2e import P01_COUNTERS
from faultloop.io.can.frames import REJECTIONS, Frame, Rejection, State
from faultloop.io.can.port import BREAKER_STATUS, encode, ticks
from faultloop.io.can.record import (
    FRAME,
    MESSAGE,
    Bytes,
    Record,
    Records,
    new_frame,
    new_message,
    taken,
)
from faultloop.io.can.table import TICK_NS, Kind
from faultloop.jit import njit
from faultloop.nodes.clock import FOREVER

MS = 1_000_000
NOTHING_HEARD = -1
NO_COMMON_CLOCK = -1
NEW, NOTHING_NEW = 1, 0
LONGEST_SHIFT = 30

PUBLISHER = np.dtype(
    [
        (name, "i8")
        for name in (
            "kind",
            "number",
            "poles",
            "test",
            "first_ns",  # interval after the first frame of a state, doubled each time
            "heartbeat_ns",  # up to this
            "next_ns",  # when the next frame is due
            "told",  # the poles that st_num stands for
            "st_num",
            "sq_num",
            "counter",
        )
    ]
)
SUBSCRIBER = np.dtype(
    [
        *(
            (name, "i8")
            for name in (
                "kind",  # of whom it hears
                "number",
                "first_ns",
                "heartbeat_ns",
                "grace_ns",
                "max_age_ns",  # NO_COMMON_CLOCK: none
                "max_ahead_ns",
                "test",
                "start_ns",
                "confirmations",
                "poles",  # the state accepted last; NOTHING_HEARD before the first
                "alarm",  # 1: the publisher has been silent for longer than it may
                "lost",
                "restarts",
                "expires_ns",  # end of the newest frame's time allowed to live
                "agreeing",  # how many frames agree with the candidate; 0: there is none
            )
        ),
        ("last", MESSAGE),  # accepted; where something was heard
        ("candidate", MESSAGE),  # the newest of those that agree, but not with `last`
    ],
    align=True,
)


@dataclass(frozen=True, slots=True)
class Repetition:
    """Intervals of the repetition: `first_ns`, doubled each time, at most `heartbeat_ns`.

    The time allowed to live of a frame is twice the interval that follows it, and `grace_ns` for the bus.
    """

    first_ns: int = 2 * MS
    heartbeat_ns: int = 1000 * MS
    grace_ns: int = 2 * MS

    def interval_ns(self, sq_num: int) -> int:
        """Time from the frame numbered `sq_num` to the next [ns]."""
        return interval_ns(self.first_ns, self.heartbeat_ns, sq_num)

    def allowed_to_live_ns(self, sq_num: int) -> int:
        """How long the frame numbered `sq_num` may remain the newest one [ns]."""
        return 2 * self.interval_ns(sq_num) + self.grace_ns


@njit
def interval_ns(first_ns: int, heartbeat_ns: int, sq_num: int) -> int:
    """Time from the frame numbered ``sq_num`` to the next [ns]."""
    return min(first_ns << min(sq_num, LONGEST_SHIFT), heartbeat_ns)


# -- publishing ---------------------------------------------------------------------------------------------


@njit
def set_state(p: Record, poles: int, t_ns: int) -> None:
    """The state from ``t_ns`` on; a frame is due at once if that is a change.

    What no frame has told was no state: two poles that open between two frames are one.
    """
    if poles != p.poles:
        p.poles = poles
        p.next_ns = t_ns


@njit
def publish(p: Record, t_ns: int, m: Record) -> bool:
    """Is a message due at ``t_ns``?  Then it is in ``m``, and the next is due at ``next_ns``."""
    if t_ns < p.next_ns:
        return False
    if p.poles != p.told:
        p.told = p.poles
        p.st_num = (p.st_num + 1) & 0xFF
        p.sq_num = 0
    m.kind = p.kind
    m.number = p.number
    m.poles = p.poles
    m.st_num = p.st_num
    m.sq_num = p.sq_num
    m.counter = p.counter
    m.time = ticks(t_ns)
    m.test = p.test
    # From the time of sending and not from the time due: a late node does not send a burst.
    p.next_ns = t_ns + interval_ns(p.first_ns, p.heartbeat_ns, p.sq_num)
    p.sq_num = p.sq_num % 255 + 1  # 0 is for the first frame of a state only
    p.counter = (p.counter + 1) % P01_COUNTERS
    return True


# -- accepting ----------------------------------------------------------------------------------------------


@njit
def accept(s: Record, m: Record, t_ns: int) -> int:
    """Take a message that arrived at ``t_ns``: NEW for a new state, once for each; NOTHING_NEW for a
    repetition or the first of several confirmations; or minus the number of why it is rejected."""
    objection = _objection(s, m, t_ns)
    if objection == FINE:
        expected = _expected(s, m)
        if _borne_out(s, m, max(s.confirmations, 1 if expected else 2)):
            return _take(s, m, t_ns)
        if expected:
            return NOTHING_NEW  # one of those that must agree
        contradicts = s.poles != NOTHING_HEARD and _goes_on(m, s.last)
        objection = INCONSISTENT if contradicts else SEQUENCE
    return -objection


@njit
def supervise(s: Record, t_ns: int) -> bool:
    """True once, when the newest frame's time allowed to live has run out by ``t_ns``: raise an alarm."""
    if s.alarm or t_ns < s.expires_ns:
        return False
    s.alarm = 1
    return True


@njit
def _take(s: Record, m: Record, t_ns: int) -> int:
    last = s.last
    heard = s.poles != NOTHING_HEARD
    new = not heard or m.st_num != last.st_num or m.poles != last.poles
    if heard:
        step = _difference(m.st_num, last.st_num, 1 << 8)
        if step < 0 or (step == 0 and not _continues(m, last)):
            s.restarts += 1
        else:
            s.lost += (m.counter - last.counter - 1) % P01_COUNTERS
    s.alarm = 0
    s.agreeing = 0
    s.expires_ns = t_ns + 2 * interval_ns(s.first_ns, s.heartbeat_ns, m.sq_num) + s.grace_ns
    s.poles = m.poles
    _copy(m, last)
    return NEW if new else NOTHING_NEW


@njit
def _expected(s: Record, m: Record) -> bool:
    """Does it follow what was accepted?  At first: a state that commands nothing."""
    if s.poles == NOTHING_HEARD:
        return m.poles == 0 or m.kind == BREAKER_STATUS
    return _continues(m, s.last) or _succeeds(m, s.last)


@njit
def _borne_out(s: Record, m: Record, needed: int) -> bool:
    """Is it a repetition, or do as many frames in a row agree on it?"""
    if s.poles != NOTHING_HEARD and _continues(m, s.last):
        return True
    agrees = s.agreeing > 0 and (
        _later(m, s.candidate) and (_continues(m, s.candidate) or _succeeds(m, s.candidate))
    )
    s.agreeing = s.agreeing + 1 if agrees else 1
    _copy(m, s.candidate)
    return s.agreeing >= needed


@njit
def _objection(s: Record, m: Record, t_ns: int) -> int:
    if m.test and not s.test:
        return TEST
    if s.max_age_ns != NO_COMMON_CLOCK:
        age = _difference(ticks(t_ns), m.time, 1 << 32)
        if not -s.max_ahead_ns <= age * TICK_NS <= s.max_age_ns:
            return STALE
        if s.poles == NOTHING_HEARD and t_ns // TICK_NS - age < s.start_ns // TICK_NS:
            return BEFORE_START
    if s.poles == NOTHING_HEARD or _later(m, s.last):
        return FINE
    return FINE if s.max_age_ns == NO_COMMON_CLOCK and _silent(s, t_ns) else OLD


@njit
def _silent(s: Record, t_ns: int) -> bool:
    return s.poles != NOTHING_HEARD and t_ns >= s.expires_ns


@njit
def _copy(m: Record, to: Record) -> None:
    to.kind = m.kind
    to.poles = m.poles
    to.st_num = m.st_num
    to.sq_num = m.sq_num
    to.counter = m.counter
    to.time = m.time


@njit
def _later(m: Record, last: Record) -> bool:
    """Was it sent after ``last``?  Within one tick of the clock the numbers decide."""
    order = _difference(m.time, last.time, 1 << 32)
    if order == 0:
        order = _difference(m.st_num, last.st_num, 1 << 8)
    if order == 0:
        order = _difference(m.sq_num, last.sq_num, 1 << 8)
    return order > 0


@njit
def _continues(m: Record, last: Record) -> bool:
    """Is it a repetition of the same state?"""
    return m.poles == last.poles and _goes_on(m, last)


@njit
def _goes_on(m: Record, last: Record) -> bool:
    """Is it numbered as a later frame of the same state?  Counter and `sq_num` have then gone on by as much.

    Modulo 15, the counter's period, that holds where `sq_num` goes from 255 to 1, too.
    """
    if m.st_num != last.st_num or m.sq_num == 0:
        return False
    frames = (m.sq_num - last.sq_num) % 255
    return frames > 0 and (m.counter - last.counter - frames) % P01_COUNTERS == 0


@njit
def _succeeds(m: Record, last: Record) -> bool:
    """Is it of the very next state?  The same counter again is what E2E profile 1 calls repeated."""
    return (
        _difference(m.st_num, last.st_num, 1 << 8) == 1
        and m.poles != last.poles
        and m.counter != last.counter
    )


@njit
def _difference(a: int, b: int, modulus: int) -> int:
    """a - b on a wrapping counter: the value nearest to zero (serial number arithmetic, RFC 1982)."""
    return (a - b + modulus // 2) % modulus - modulus // 2


# -- for whoever is not compiled ----------------------------------------------------------------------------


@njit
def publish_frame(publishers: Records, t_ns: int, message: Bytes, frame: Bytes) -> bool:
    """Is a frame of the first publisher due at ``t_ns``?  Then it is in ``frame``."""
    m = message.view(MESSAGE)[0]
    due = publish(publishers[0], t_ns, m)
    if due:
        encode(m, frame.view(FRAME)[0])
    return due


@njit
def accept_bytes(subscribers: Records, message: Bytes, t_ns: int) -> int:
    """`accept` of the first subscriber."""
    return accept(subscribers[0], message.view(MESSAGE)[0], t_ns)


def _silent_subscriber() -> Any:
    record = np.zeros(1, SUBSCRIBER)
    record["poles"], record["expires_ns"] = NOTHING_HEARD, FOREVER
    return record


_SILENT = _silent_subscriber()


class Publisher:
    """Sends one state: `set` changes it, `poll` gives the frame that is due.

    Parameters
    ----------
    kind, number : of its messages.
    poles : its state at the start.
    start_ns : when the first frame is due.
    test : it sends under test.
    record : a view of one ``PUBLISHER``, shape (1,), to be used; a new one where not given.
    """

    def __init__(
        self,
        kind: Kind,
        number: int,
        poles: int = 0,
        start_ns: int = 0,
        repetition: Repetition | None = None,
        test: bool = False,
        *,
        record: Any = None,
    ) -> None:
        repetition = repetition or Repetition()
        self.record = np.zeros(1, PUBLISHER) if record is None else record
        self._message, self._frame = new_message(), new_frame()
        intervals = (repetition.first_ns, repetition.heartbeat_ns)
        self.record[0] = (kind, number, poles, test, *intervals, start_ns, poles, 1, 0, 0)

    @property
    def next_ns(self) -> int:
        """When the next frame is due."""
        return int(self.record["next_ns"][0])

    @property
    def poles(self) -> int:
        """Its state."""
        return int(self.record["poles"][0])

    def set(self, poles: int, t_ns: int) -> None:
        """The state from `t_ns` on; a frame is due at once if that is a change."""
        set_state(self.record[0], poles, t_ns)

    def poll(self, t_ns: int) -> Frame | None:
        """The frame that is due at `t_ns`, or none; the next is due at `next_ns`."""
        if not publish_frame(self.record, t_ns, self._message, self._frame):
            return None
        return Frame(*taken(self._frame, 0))

    def copied(self) -> Publisher:
        """An independent copy."""
        copy = Publisher(Kind.TRIP, 0)
        copy.record[:] = self.record
        return copy


class Subscriber:
    """Accepts the states of one publisher.

    What continues the state accepted last is taken at once, and so is the next state in number.  Anything
    else (a first state that commands, a number that jumps or begins again, a counter that stands still) may
    be a publisher that restarted, frames lost, or an accident: it is taken when a further frame bears it out.

    Parameters
    ----------
    repetition : the publisher's, for the time allowed to live.
    max_age_ns : a frame whose time is further behind the receiver's clock is rejected; None where the two
        have no common clock: then a publisher that was silent too long may come back with an earlier time.
    max_ahead_ns : the same for a time that is ahead.  It is short, as an accepted frame bars all before it.
    test : this receiver is itself under test, and acts on frames sent under test.
    start_ns : when this receiver started.  The first frame must have been sent since: what was sent before
        may be a recording, and what a publisher still means it repeats.
    confirmations : frames that must agree before a new state is taken.
    kind, number : of whom it hears, for a node with several.
    expected : that the publisher is never heard at all is a silence, too.
    record : a view of one ``SUBSCRIBER``, shape (1,), to be used; a new one where not given.

    Attributes
    ----------
    rejected : how many messages, by cause.
    """

    def __init__(
        self,
        repetition: Repetition | None = None,
        max_age_ns: int | None = 1000 * MS,
        max_ahead_ns: int = 100 * MS,
        test: bool = False,
        start_ns: int = 0,
        confirmations: int = 1,
        *,
        kind: int = 0,
        number: int = 0,
        expected: bool = False,
        record: Any = None,
    ) -> None:
        repetition = repetition or Repetition()
        self.record = np.zeros(1, SUBSCRIBER) if record is None else record
        self.rejected: Counter[Rejection] = Counter()
        self.record[:] = _SILENT
        head = (kind, number, repetition.first_ns, repetition.heartbeat_ns, repetition.grace_ns)
        age_ns = NO_COMMON_CLOCK if max_age_ns is None else max_age_ns
        settings = (*head, age_ns, max_ahead_ns, test, start_ns, confirmations)
        self.record.view(np.int64)[: len(settings)] = settings
        if expected:
            self.record["expires_ns"] = start_ns + 2 * repetition.heartbeat_ns + repetition.grace_ns

    def receive(self, message: State, t_ns: int) -> bool | Rejection:
        """Take a message that arrived at `t_ns`.

        Returns True for a new state (once for each), False for a frame that changes nothing (a repetition, or
        the first of several confirmations), or why it is rejected.
        """
        answer = accept_bytes(self.record, new_message(*message.fields), t_ns)
        if answer >= 0:
            return answer == NEW
        rejection = REJECTIONS[-answer - 1]
        self.rejected[rejection] += 1
        return rejection

    def supervise(self, t_ns: int) -> bool:
        """True once, when the newest frame's time allowed to live has run out by `t_ns`: raise an alarm."""
        return supervise(self.record[0], t_ns)

    @property
    def poles(self) -> int | None:
        """The state accepted last; None before the first."""
        poles = int(self.record["poles"][0])
        return None if poles == NOTHING_HEARD else poles

    @property
    def alarm(self) -> bool:
        """The publisher has been silent for longer than it may."""
        return bool(self.record["alarm"][0])

    @property
    def lost(self) -> int:
        """Frames missed, by the counter, so a gap is counted modulo 15."""
        return int(self.record["lost"][0])

    @property
    def restarts(self) -> int:
        """How often the publisher began again."""
        return int(self.record["restarts"][0])

    @property
    def expires_ns(self) -> int | None:
        """End of the newest frame's time allowed to live."""
        return None if self.poles is None else int(self.record["expires_ns"][0])

    def copied(self) -> Subscriber:
        """An independent copy."""
        copy = Subscriber()
        copy.record[:] = self.record
        copy.rejected = Counter(self.rejected)
        return copy
