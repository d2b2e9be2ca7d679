"""Repetition and acceptance of state messages, as GOOSE does it (IEC 61850-8-1, clause 18).

A change of state is sent at once under a new state number, then repeated at growing intervals up to the
heartbeat; a receiver acts on each state once, and supervises that the repetitions keep coming.  Pure logic in
integer nanoseconds: the same code serves the simulation and a real node.

Departure from GOOSE, whose numbers have 32 bits: `st_num` and `sq_num` have 8 here, to leave room for the
time of sending in 8 bytes.  So the time is what orders two frames; the numbers tell what step it was.
"""

from __future__ import annotations

from collections import Counter
from copy import copy
from dataclasses import dataclass, field, replace

from faultloop.io.can.e2e import P01_COUNTERS
from faultloop.io.can.frames import Frame, Rejection, State, ticks
from faultloop.io.can.table import TICK_NS, Kind

MS = 1_000_000


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
        return min(self.first_ns << min(sq_num, 40), self.heartbeat_ns)

    def allowed_to_live_ns(self, sq_num: int) -> int:
        """How long the frame numbered `sq_num` may remain the newest one [ns]."""
        return 2 * self.interval_ns(sq_num) + self.grace_ns


@dataclass(slots=True)
class Publisher:
    """Sends one state: `set` changes it, `poll` gives the frame that is due."""

    kind: Kind
    number: int
    poles: int = 0
    start_ns: int = 0
    repetition: Repetition = field(default_factory=Repetition)
    test: bool = False
    next_ns: int = field(init=False)  # when the next frame is due
    _told: int = field(init=False)  # the poles that `_st_num` stands for
    _st_num: int = field(init=False, default=1)
    _sq_num: int = field(init=False, default=0)
    _counter: int = field(init=False, default=0)

    def __post_init__(self) -> None:
        self.next_ns = self.start_ns
        self._told = self.poles

    def set(self, poles: int, t_ns: int) -> None:
        """The state from `t_ns` on; a frame is due at once if that is a change.

        What no frame has told was no state: two poles that open between two frames are one.
        """
        if poles != self.poles:
            self.poles = poles
            self.next_ns = t_ns

    def poll(self, t_ns: int) -> Frame | None:
        """The frame that is due at `t_ns`, or none; the next is due at `next_ns`."""
        if t_ns < self.next_ns:
            return None
        if self.poles != self._told:
            self._told = self.poles
            self._st_num = (self._st_num + 1) & 0xFF
            self._sq_num = 0
        frame = State(
            self.kind,
            self.number,
            self.poles,
            self._st_num,
            self._sq_num,
            self._counter,
            ticks(t_ns),
            self.test,
        ).encode()
        # From the time of sending and not from the time due: a late node does not send a burst.
        self.next_ns = t_ns + self.repetition.interval_ns(self._sq_num)
        self._sq_num = self._sq_num % 255 + 1  # 0 is for the first frame of a state only
        self._counter = (self._counter + 1) % P01_COUNTERS
        return frame

    def copied(self) -> Publisher:
        """An independent copy."""
        return copy(self)


@dataclass(slots=True)
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
    """

    repetition: Repetition = field(default_factory=Repetition)
    max_age_ns: int | None = 1000 * MS
    max_ahead_ns: int = 100 * MS
    test: bool = False
    start_ns: int = 0
    confirmations: int = 1
    poles: int | None = None  # the state accepted last; None before the first
    alarm: bool = False  # the publisher has been silent for longer than it may
    lost: int = 0  # frames missed, by the counter, so a gap is counted modulo 15
    restarts: int = 0  # how often the publisher began again
    rejected: Counter[Rejection] = field(default_factory=Counter)
    expires_ns: int | None = None  # end of the newest frame's time allowed to live
    _last: State | None = None
    _candidate: State | None = None  # the newest of `_agreeing` frames that agree, but not with `_last`
    _agreeing: int = 0

    def receive(self, message: State, t_ns: int) -> bool | Rejection:
        """Take a message that arrived at `t_ns`.

        Returns True for a new state (once for each), False for a frame that changes nothing (a repetition, or
        the first of several confirmations), or why it is rejected.
        """
        objection = self._objection(message, t_ns)
        if objection is None:
            expected = self._expected(message)
            if self._borne_out(message, max(self.confirmations, 1 if expected else 2)):
                return self._accept(message, t_ns)
            if expected:
                return False  # one of those that must agree
            contradicts = self._last is not None and _goes_on(message, self._last)
            objection = Rejection.INCONSISTENT if contradicts else Rejection.SEQUENCE
        self.rejected[objection] += 1
        return objection

    def _accept(self, message: State, t_ns: int) -> bool:
        last = self._last
        self._last, self._candidate, self._agreeing = message, None, 0
        self.alarm = False
        self.expires_ns = t_ns + self.repetition.allowed_to_live_ns(message.sq_num)
        new = last is None or message.st_num != last.st_num or message.poles != last.poles
        if last is not None:
            step = _difference(message.st_num, last.st_num, 1 << 8)
            if step < 0 or (step == 0 and not _continues(message, last)):
                self.restarts += 1
            else:
                self.lost += (message.counter - last.counter - 1) % P01_COUNTERS
        self.poles = message.poles
        return new

    def _expected(self, message: State) -> bool:
        """Does it follow what was accepted?  At first: a state that commands nothing."""
        if self._last is None:
            return message.poles == 0 or message.kind == Kind.BREAKER_STATUS
        return _continues(message, self._last) or _succeeds(message, self._last)

    def _borne_out(self, message: State, needed: int) -> bool:
        """Is it a repetition, or do as many frames in a row agree on it?"""
        last, candidate = self._last, self._candidate
        if last is not None and _continues(message, last):
            return True
        agrees = candidate is not None and (
            _later(message, candidate) and (_continues(message, candidate) or _succeeds(message, candidate))
        )
        self._agreeing = self._agreeing + 1 if agrees else 1
        self._candidate = message
        return self._agreeing >= needed

    def supervise(self, t_ns: int) -> bool:
        """True once, when the newest frame's time allowed to live has run out by `t_ns`: raise an alarm."""
        if self.alarm or not self._silent(t_ns):
            return False
        self.alarm = True
        return True

    def copied(self) -> Subscriber:
        """An independent copy."""
        return replace(self, rejected=Counter(self.rejected))

    def _objection(self, message: State, t_ns: int) -> Rejection | None:
        if message.test and not self.test:
            return Rejection.TEST
        if self.max_age_ns is not None:
            age = _difference(ticks(t_ns), message.time, 1 << 32)
            if not -self.max_ahead_ns <= age * TICK_NS <= self.max_age_ns:
                return Rejection.STALE
            if self._last is None and t_ns // TICK_NS - age < self.start_ns // TICK_NS:
                return Rejection.BEFORE_START
        if self._last is None or _later(message, self._last):
            return None
        return None if self.max_age_ns is None and self._silent(t_ns) else Rejection.OLD

    def _silent(self, t_ns: int) -> bool:
        return self.expires_ns is not None and t_ns >= self.expires_ns


def _later(message: State, last: State) -> bool:
    """Was it sent after `last`?  Within one tick of the clock the numbers decide."""
    order = (
        _difference(message.time, last.time, 1 << 32)
        or _difference(message.st_num, last.st_num, 1 << 8)
        or _difference(message.sq_num, last.sq_num, 1 << 8)
    )
    return order > 0


def _continues(message: State, last: State) -> bool:
    """Is it a repetition of the same state?"""
    return message.poles == last.poles and _goes_on(message, last)


def _goes_on(message: State, last: State) -> bool:
    """Is it numbered as a later frame of the same state?  Counter and `sq_num` have then gone on by as much.

    Modulo 15, the counter's period, that holds where `sq_num` goes from 255 to 1, too.
    """
    if message.st_num != last.st_num or message.sq_num == 0:
        return False
    frames = (message.sq_num - last.sq_num) % 255
    return frames > 0 and (message.counter - last.counter - frames) % P01_COUNTERS == 0


def _succeeds(message: State, last: State) -> bool:
    """Is it of the very next state?  The same counter again is what E2E profile 1 calls repeated."""
    return (
        _difference(message.st_num, last.st_num, 1 << 8) == 1
        and message.poles != last.poles
        and message.counter != last.counter
    )


def _difference(a: int, b: int, modulus: int) -> int:
    """a - b on a wrapping counter: the value nearest to zero (serial number arithmetic, RFC 1982)."""
    return (a - b + modulus // 2) % modulus - modulus // 2
