"""Worst-case response times of messages on CAN.

Davis, Burns, Bril, Lukkien (2007), "Controller Area Network (CAN) schedulability analysis: Refuted, revisited
and revised", Real-Time Systems 35, 239-272: eqs. 1, 3-4, 8-13.  What they refute is the analysis of Tindell,
Hansson, Wellings (1994), which looks at the first instance of a message only: it is here to compare with.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

SECOND_NS = 1_000_000_000


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


def longest_bits(size: int, extended: bool = False) -> int:
    """Bits of a classic frame of `size` bytes at most, intermission included (eq. 1)."""
    g = 54 if extended else 34
    return g + 8 * size + 13 + (g + 8 * size - 1) // 4


def response_ns(messages: Sequence[Message], place: int, bit_ns: int) -> int | None:
    """Worst-case response time of `messages[place]`, from its event to the end of its intermission [ns].

    `messages` are in order of priority, the highest first.  None where there is no bound: what is of its
    priority and higher fills the bus.
    """
    own, higher = messages[place], messages[:place]
    if sum(m.time_ns / m.period_ns for m in messages[: place + 1]) >= 1:
        return None
    blocking = _blocking(messages, place)
    busy, before = own.time_ns, 0
    while busy != before:  # the longest time in which the bus has something of this priority or higher
        busy, before = blocking + sum(_most(m, busy) * m.time_ns for m in messages[: place + 1]), busy
    worst = 0
    for q in range(_most(own, busy)):
        wait = _wait(blocking + q * own.time_ns, higher, bit_ns)
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
