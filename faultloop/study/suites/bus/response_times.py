"""Worst-case response times of messages on CAN.

Davis, Burns, Bril, Lukkien (2007), "Controller Area Network (CAN) schedulability analysis: Refuted, revisited
and revised", Real-Time Systems 35, 239-272: eqs. 1, 3-4, 8-13.  What they refute is the analysis of Tindell,
Hansson, Wellings (1994), which looks at the first instance of a message only: it is here to compare with.
Errors on the wire are in it as Tindell, Burns, Wellings (1995), "Calculating controller area network (CAN)
message response times", Control Engineering Practice 3, 1163-1169, put them in.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

SECOND_NS = 1_000_000_000
ERROR_BITS = 31


@dataclass(frozen=True, slots=True)
class Message:
    """A stream of frames, as the analysis has it; all times [ns].

    `time_ns` is the longest time on the wire, intermission included; `period_ns` the shortest between two
    frames; `jitter_ns` how much later than its event a frame is offered at most.
    """

    name: str
    time_ns: int
    period_ns: int
    jitter_ns: int = 0


class Errors(NamedTuple):
    """At most `burst` errors at once, then one each `period_ns`; `burst` 0 is a bus without errors.

    Each costs at most 31 bits (flags 12, delimiter 8, intermission 3, suspend transmission 8) and a frame, of
    the message's priority or a higher one, that is sent again.
    """

    burst: int = 0
    period_ns: int = 1 << 62

    def most(self, span_ns: int) -> int:
        """How many there are within a time."""
        return self.burst + -(-span_ns // self.period_ns) - 1 if self.burst else 0


NO_ERRORS = Errors()


def longest_bits(size: int, extended: bool = False) -> int:
    """Bits of a classic frame of `size` bytes at most, intermission included (eq. 1)."""
    g = 54 if extended else 34
    return g + 8 * size + 13 + (g + 8 * size - 1) // 4


def response_ns(
    messages: Sequence[Message], place: int, bit_ns: int, errors: Errors = NO_ERRORS
) -> int | None:
    """Worst-case response time of `messages[place]`, from its event to the end of its intermission [ns].

    `messages` are in order of priority, the highest first.  None where there is no bound: what is of its
    priority and higher, and the errors, fill the bus.
    """
    own, higher, same = messages[place], messages[:place], messages[: place + 1]
    error_ns = ERROR_BITS * bit_ns + max(m.time_ns for m in same)
    if sum(m.time_ns / m.period_ns for m in same) + error_ns / errors.period_ns >= 1:
        return None
    blocking = _blocking(messages, place)
    busy, before = own.time_ns, 0
    while busy != before:  # the longest time in which the bus has something of this priority or higher
        lost_ns = blocking + errors.most(busy) * error_ns
        busy, before = lost_ns + sum(_most(m, busy) * m.time_ns for m in same), busy
    worst = 0
    for q in range(_most(own, busy)):
        wait, before = 0, -1
        while wait != before:
            lost_ns = blocking + errors.most(wait + own.time_ns) * error_ns
            wait, before = _wait(lost_ns + q * own.time_ns, higher, bit_ns), wait
        worst = max(worst, own.jitter_ns + wait - q * own.period_ns + own.time_ns)
    return worst


def first_response_ns(messages: Sequence[Message], place: int, bit_ns: int) -> int | None:
    """What Tindell, Hansson and Wellings (1994) give: the first instance's alone.  It may be too short."""
    own, higher = messages[place], messages[:place]
    if sum(m.time_ns / m.period_ns for m in higher) >= 1:
        return None
    return own.jitter_ns + _wait(_blocking(messages, place), higher, bit_ns) + own.time_ns


def _blocking(messages: Sequence[Message], place: int) -> int:
    """The longest frame of a lower priority: it may just have begun (eq. 3)."""
    return max((m.time_ns for m in messages[place + 1 :]), default=0)


def _most(message: Message, span_ns: int) -> int:
    """How many of its frames can be offered within a time."""
    return -(-(span_ns + message.jitter_ns) // message.period_ns)


def _wait(first_ns: int, higher: Sequence[Message], bit_ns: int) -> int:
    """Until the frame begins: whoever comes up to a bit time after that still wins."""
    wait, before = first_ns, -1
    while wait != before:
        wait, before = first_ns + sum(_most(m, wait + bit_ns) * m.time_ns for m in higher), wait
    return wait
