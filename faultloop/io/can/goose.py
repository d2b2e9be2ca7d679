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
    _st_num: int = field(init=False, default=1)
    _sq_num: int = field(init=False, default=0)
    _counter: int = field(init=False, default=0)

    def __post_init__(self) -> None:
        self.next_ns = self.start_ns

    def set(self, poles: int, t_ns: int) -> None:
        """The state from `t_ns` on; a frame is due at once if that is a change."""
        if poles != self.poles:
            self.poles = poles
            self._st_num = (self._st_num + 1) & 0xFF
            self._sq_num = 0
            self.next_ns = t_ns

    def poll(self, t_ns: int) -> Frame | None:
        """The frame that is due at `t_ns`, or none; the next is due at `next_ns`."""
        if t_ns < self.next_ns:
            return None
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

    Parameters
    ----------
    repetition : the publisher's, for the time allowed to live.
    max_age_ns : a frame whose time differs by more from the receiver's clock is rejected; None where the two
        have no common clock: then a publisher that was silent too long may come back with an earlier time.
    test : this receiver is itself under test, and acts on frames sent under test.
    """

    repetition: Repetition = field(default_factory=Repetition)
    max_age_ns: int | None = 1000 * MS
    test: bool = False
    poles: int | None = None  # the state accepted last; None before the first
    alarm: bool = False  # the publisher has been silent for longer than it may
    lost: int = 0  # frames missed, by the counter, so a gap is counted modulo 15
    restarts: int = 0  # how often the publisher began again
    rejected: Counter[Rejection] = field(default_factory=Counter)
    expires_ns: int | None = None  # end of the newest frame's time allowed to live
    _last: State | None = None

    def receive(self, message: State, t_ns: int) -> bool | Rejection:
        """Take a message that arrived at `t_ns`.

        Returns True for a new state (once for each), False for a repetition, or why it is rejected.
        """
        last = self._last
        objection = self._objection(message, last, t_ns)
        if objection is not None:
            self.rejected[objection] += 1
            return objection
        self._last = message
        self.alarm = False
        self.expires_ns = t_ns + self.repetition.allowed_to_live_ns(message.sq_num)
        new = last is None or message.st_num != last.st_num or message.poles != last.poles
        if last is not None:
            step = _difference(message.st_num, last.st_num, 1 << 8)
            if step < 0 or (step == 0 and new):
                self.restarts += 1
            else:
                self.lost += (message.counter - last.counter - 1) % P01_COUNTERS
        self.poles = message.poles
        return new

    def supervise(self, t_ns: int) -> bool:
        """True once, when the newest frame's time allowed to live has run out by `t_ns`: raise an alarm."""
        if self.alarm or not self._silent(t_ns):
            return False
        self.alarm = True
        return True

    def copied(self) -> Subscriber:
        """An independent copy."""
        return replace(self, rejected=Counter(self.rejected))

    def _objection(self, message: State, last: State | None, t_ns: int) -> Rejection | None:
        if message.test and not self.test:
            return Rejection.TEST
        if self.max_age_ns is not None:
            age_ns = _difference(ticks(t_ns), message.time, 1 << 32) * TICK_NS
            if abs(age_ns) > self.max_age_ns:
                return Rejection.STALE
        if last is None:
            return None
        silent = self._silent(t_ns)
        if not _later(message, last) and not (silent and self.max_age_ns is None):
            return Rejection.OLD
        same_state = message.st_num == last.st_num and _difference(message.sq_num, last.sq_num, 1 << 8) > 0
        if same_state and message.poles != last.poles and not silent:
            return Rejection.INCONSISTENT
        return None

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


def _difference(a: int, b: int, modulus: int) -> int:
    """a - b on a wrapping counter: the value nearest to zero (serial number arithmetic, RFC 1982)."""
    return (a - b + modulus // 2) % modulus - modulus // 2
