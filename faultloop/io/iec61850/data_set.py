"""The values of a data set: of a message, and back."""

from __future__ import annotations

import math
from typing import Any

from faultloop.io.can.frames import (
    Differential,
    Heartbeat,
    Measurements,
    Message,
    Page,
    SampledValues,
    State,
    TimeSync,
)
from faultloop.io.can.table import Kind
from faultloop.io.iec61850.streams import Block, Member

TEST_BIT, VALIDITY_BITS = 11, 2
GOOD, INVALID, QUESTIONABLE = 0b00, 0b01, 0b11
INTERMEDIATE, OPEN, CLOSED, BAD = range(4)


class Refused(Exception):
    """A message of the process bus is not acted upon; the text is the cause, for a log."""


def values_of(message: Message) -> list[Any]:
    """The values of its data set, as ``open61850`` has them."""
    from open61850.data import BitStringData, BoolData, FloatData, IntData

    match message:
        case State(kind=Kind.BREAKER_STATUS):
            position = {0: BitStringData(b"\x40", 6), 1: BitStringData(b"\x80", 6)}
            quality = _quality(message.test)
            return [value for p in range(3) for value in (position[message.poles >> p & 1], quality)]
        case State():
            phases = [BoolData(bool(message.poles >> p & 1)) for p in range(3)]
            return [BoolData(message.poles != 0), *phases, _quality(message.test)]
        case Measurements():
            return [FloatData(value) for value in message.values]
        case Heartbeat():
            time = (message.time + 2**31) % 2**32 - 2**31
            return [IntData(value) for value in (message.state, message.alarms, message.rejected, time)]
        case SampledValues() | Differential() | TimeSync():
            raise AssertionError(f"{type(message).__name__} is no GOOSE")


def _quality(test: bool) -> Any:
    from open61850.data import BitStringData

    return BitStringData(bytes((0, (0x80 >> TEST_BIT - 8) if test else 0)), 3)


def check_types(members: tuple[Member, ...], values: list[Any]) -> None:
    """Refused where the values are not those of the data set."""
    if len(values) != len(members):
        raise Refused("another number of entries in the data set")
    for member, value in zip(members, values, strict=True):
        if not _fits(member.type, value):
            raise Refused(f"{member.reference} is no {member.type}")


def _fits(type: str, value: Any) -> bool:
    from open61850.data import BitStringData, BoolData, FloatData, IntData, UIntData

    match type:
        case "BOOLEAN":
            return isinstance(value, BoolData)
        case "Dbpos":
            return isinstance(value, BitStringData) and _bits(value) == 2
        case "Quality":
            return isinstance(value, BitStringData) and _bits(value) == 13
        case "INT32":
            return isinstance(value, (IntData, UIntData)) and -(2**31) <= value.value < 2**31
        case _:
            return isinstance(value, FloatData)


def _bits(value: Any) -> int:
    return 8 * len(value.value) - value.unused_bits


def poles_of(block: Block, values: list[Any], before: int) -> tuple[int, bool]:
    """Poles of a state's values, and whether any is under test.

    Parameters
    ----------
    before : the poles told last: a pole between its positions is where it was.

    Raises
    ------
    Refused : the quality is not good, the position cannot be, or the values contradict each other.
    """
    qualities = [
        value for member, value in zip(block.members, values, strict=True) if member.type == "Quality"
    ]
    for quality in qualities:
        if quality.value[0] >> 6 != GOOD:
            raise Refused("quality is not good")
    test = any(quality.value[1] & 0x80 >> TEST_BIT - 8 for quality in qualities)
    if block.kind == Kind.BREAKER_STATUS:
        return _positions(values[::2], before), test
    general, *phases = (value.value for value in values[:4])
    poles = sum(1 << p for p, phase in enumerate(phases) if phase)
    if general != (poles != 0):
        raise Refused("general and phases contradict each other")
    return poles, test


def _positions(values: list[Any], before: int) -> int:
    poles = 0
    for p, value in enumerate(values):
        match value.value[0] >> 6:
            case 0:
                poles |= before & 1 << p
            case 2:
                poles |= 1 << p
            case 3:
                raise Refused("a position is bad-state")
    return poles


def told(block: Block, number: int, values: list[Any], counter: int) -> Measurements | Heartbeat:
    """The message in values that are no state; Refused where one is out of its range."""
    plain = [value.value for value in values]
    if block.kind == Kind.MEASUREMENTS:
        if any(math.isinf(value) for value in plain):
            raise Refused("a measured value is infinite")
        return Measurements(number, Page(block.page), (plain[0], plain[1], plain[2]), counter & 0xFF)
    state, alarms, rejected, time = plain
    if not (0 <= state <= 0xFF and 0 <= alarms <= 0xFF and rejected >= 0):
        raise Refused("a value is out of its range")
    return Heartbeat(number, state, alarms, rejected, time & 0xFFFFFFFF)
