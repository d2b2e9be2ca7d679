"""What a user says of a record's channels: which they are, in what unit, and by what to multiply."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TypeVar

from faultloop.errors import InputError, nearest
from faultloop.io.comtrade.record import AnalogChannel, Record, StatusChannel

SLOTS = ("va", "vb", "vc", "ia", "ib", "ic")
CONTACTS = tuple(f"52{kind}{pole}" for kind in "ab" for pole in ("", "_a", "_b", "_c"))
"""Auxiliary contacts of a breaker or of one pole: 52a is on while it is closed, 52b while it is open."""
ABSENT = "-"

BAY = "bay"
_ASSIGNMENT = re.compile(r"(?:^|,)\s*(v[abc]|i[abc]|52[ab](?:_[abc])?|bay)\s*=")
_Channel = TypeVar("_Channel", AnalogChannel, StatusChannel)


@dataclass(frozen=True, slots=True)
class Choice:
    """A channel that a user chose, and a factor of the user's own."""

    channel: AnalogChannel
    factor: float = 1.0


@dataclass(frozen=True, slots=True)
class Mapping:
    """A parsed ``va=..,ic=..,52a=..``: None where a slot is said to have no channel."""

    analog: dict[str, Choice | None]
    contacts: dict[str, StatusChannel]


def parse_mapping(record: Record, text: str) -> Mapping:
    """Parse a mapping; raises InputError that names what is wrong in it.

    ``bay=NAME``, or its place in the list that `faultloop channels` prints, stands for its six channels; what
    is mapped beside it goes before.
    """
    found = list(_ASSIGNMENT.finditer(text))
    if not found and text.strip():
        raise InputError(f"'{text}' is not of the form va=..,vb=..,ic=..", key="--map")
    if found and text[: found[0].start()].strip():
        known = ", ".join((*SLOTS, "52a", "52b"))
        raise InputError(f"'{text[: found[0].start()]}' is none of {known}", key="--map")
    mapping, bay = Mapping({}, {}), None
    ends = [match.start() for match in found[1:]] + [len(text)]
    for match, end in zip(found, ends, strict=False):
        slot, value = match[1], text[match.end() : end].strip()
        if slot in mapping.analog or slot in mapping.contacts or (slot == BAY and bay is not None):
            raise InputError(f"{slot} is mapped twice", key="--map")
        if slot == BAY:
            bay = value
        elif slot in CONTACTS:
            mapping.contacts[slot] = _contact(record, slot, value)
        else:
            mapping.analog[slot] = None if value == ABSENT else _choice(record, slot, value)
    _check_contacts(mapping.contacts)
    if bay is not None:
        from faultloop.io.comtrade.bays import bay_called

        found_bay = bay_called(record, bay)
        if left := [slot for slot in found_bay.unsaid if slot not in mapping.analog]:
            raise InputError(
                f"bay '{found_bay.name}': its name does not tell {', '.join(left)}: map these beside it",
                key="--map",
            )
        places = found_bay.places
        of_bay = {slot: Choice(record.analog[places[slot]]) if slot in places else None for slot in SLOTS}
        return Mapping(of_bay | mapping.analog, mapping.contacts)
    return mapping


def _choice(record: Record, slot: str, text: str) -> Choice:
    """A name or place with an optional factor."""
    for name, factor in ((text, 1.0), _factored(text)):
        channel = _named(record.analog, slot, name)
        if channel is not None:
            return Choice(channel, factor)
    raise InputError(f"{slot}: no channel '{text}': {nearest(text, record.analog_names)}", key="--map")


def _contact(record: Record, slot: str, text: str) -> StatusChannel:
    channel = _named(record.status, slot, text)
    if channel is None:
        names = [channel.name for channel in record.status]
        raise InputError(f"{slot}: no digital channel '{text}': {nearest(text, names)}", key="--map")
    return channel


def _named(channels: Sequence[_Channel], slot: str, name: str) -> _Channel | None:
    """The channel of this name, else of this place; None where there is neither."""
    same = [channel for channel in channels if channel.name == name]
    same = same or [channel for channel in channels if channel.name.lower() == name.lower()]
    if len(same) == 1:
        return same[0]
    if same:
        places = ", ".join(str(i) for i, channel in enumerate(channels) if channel in same)
        raise InputError(
            f"{slot}: {len(same)} channels are called '{name}': say which by its place, {places}", key="--map"
        )
    if not re.fullmatch(r"[0-9]{1,9}", name):
        return None
    if int(name) >= len(channels):
        last = len(channels) - 1
        raise InputError(f"{slot}: no channel {name}: counted from 0, the last is {last}", key="--map")
    return channels[int(name)]


def _factored(text: str) -> tuple[str, float]:
    name, star, factor = text.rpartition("*")
    try:
        return (name.strip(), float(factor)) if star else (text, 1.0)
    except ValueError:
        return text, 1.0


def _check_contacts(contacts: dict[str, StatusChannel]) -> None:
    """A contact of all poles and one of a single pole would say two things of that pole."""
    for kind in ("52a", "52b"):
        single = [slot for slot in contacts if slot.startswith(f"{kind}_")]
        if kind in contacts and single:
            raise InputError(f"{kind} is of all three poles: give it or {single[0]}", key="--map")


def parse_overrides(texts: Iterable[str], key: str) -> dict[str, str]:
    """``["va=kV", "ia=A,ib=A"]`` as a dict; v stands for va, vb, vc and i for ia, ib, ic."""
    found: dict[str, str] = {}
    for text in texts:
        for part in text.split(","):
            slot, equals, value = (piece.strip() for piece in part.partition("="))
            if not equals or not value:
                raise InputError(f"'{part}' is not of the form va=..", key=key)
            found |= dict.fromkeys(_slots(slot, key), value)
    return found


def _slots(name: str, key: str) -> tuple[str, ...]:
    slots = tuple(slot for slot in SLOTS if name == slot or name == slot[0])
    if not slots:
        raise InputError(f"'{name}' is none of {', '.join(SLOTS)}, v, i", key=key)
    return slots


def numbers_of(overrides: dict[str, str], key: str) -> dict[str, float]:
    """The overrides as numbers."""
    found = {}
    for slot, text in overrides.items():
        try:
            found[slot] = float(text)
        except ValueError:
            raise InputError(f"{slot}: '{text}' is no number", key=key) from None
        if not math.isfinite(found[slot]) or found[slot] == 0:
            raise InputError(f"{slot}: {text} must be a finite number other than 0", key=key)
    return found
