"""The bays of a record: which currents and voltages belong together, by what their names have in common."""

from __future__ import annotations

import re
from dataclasses import dataclass

from faultloop.errors import InputError, nearest
from faultloop.io.comtrade.mapping import ABSENT, SLOTS
from faultloop.io.comtrade.names import NAMED, PHASE_WORD, label_of, phases_of
from faultloop.io.comtrade.record import AnalogChannel, Record

_WORDS = re.compile(
    r"\([^)]*\)|电压|电流|voltages?|currents?|volts?|amps?|напряжени\w|ток(?:и|ов)?(?![а-я])", re.IGNORECASE
)
_ALIKE = 4
"""Characters at the beginning that two names must have in common for a guess that they are of one bay."""


@dataclass(frozen=True, slots=True)
class Bay:
    """Three currents with the voltages that seem to be theirs: places in the analog list by slot."""

    name: str
    places: dict[str, int]
    why: str  # how the voltages were found

    @property
    def mapping(self) -> str:
        """What ``--map`` wants; ? where a user must say."""
        absent = "?" if self.unsaid else ABSENT
        return ",".join(f"{slot}={self.places.get(slot, absent)}" for slot in SLOTS)

    @property
    def unsaid(self) -> list[str]:
        """The slots that a user must say."""
        return [slot for slot in SLOTS if slot not in self.places] if self.why.startswith("one of") else []


def bay_of(channel: AnalogChannel) -> str:
    """What a channel's circuit, or its name without quantity and phase, calls the bay; "" for neither."""
    text = channel.circuit.strip()
    if text in ("", "0"):
        text = PHASE_WORD.sub(" ", NAMED.sub(" ", channel.name.strip(), count=1), count=1)
    return _WORDS.sub(" ", text).strip(" _.-:/")


def bays_of(record: Record) -> list[Bay]:
    """The record's bays; of voltages alone where it has no currents."""
    voltages, currents = _groups(record, "v"), _groups(record, "i")
    if not currents:
        return [Bay(name, places, "no currents") for name, places in voltages.items()]
    found = []
    for name, places in currents.items():
        own, why = _voltages_of(name, list(voltages))
        found.append(Bay(name, (voltages[own] if own is not None else {}) | places, why))
    return found


def bay_called(record: Record, wanted: str) -> Bay:
    """The bay of that name, of that place in the list, or with that part of a name, which only one has.

    Raises InputError where there is none, or several.
    """
    bays = bays_of(record)
    names = [bay.name for bay in bays]
    found = [bay for bay in bays if bay.name.lower() == wanted.lower()]
    if not found and re.fullmatch(r"[0-9]{1,6}", wanted) and int(wanted) < len(bays):
        found = [bays[int(wanted)]]
    found = found or [bay for bay in bays if wanted and wanted.lower() in bay.name.lower()]
    if not found:
        listed = f"0 to {len(bays) - 1}, {nearest(wanted, names)}" if bays else "the record has none"
        raise InputError(f"no bay '{wanted}': {listed}", key="--map")
    if len(found) > 1:
        raise InputError(f"'{wanted}' can be any of {', '.join(bay.name for bay in found)}", key="--map")
    return found[0]


def _groups(record: Record, quantity: str) -> dict[str, dict[str, int]]:
    """By bay the places of its phases; the first channel of each phase."""
    labels: dict[str, list[tuple[str, int]]] = {}
    for place, channel in enumerate(record.analog):
        label = label_of(channel)
        if label.is_phase and label.quantity == quantity:
            labels.setdefault(bay_of(channel), []).append((label.phase, place))
    groups = {}
    for bay, members in labels.items():
        phases, places = phases_of(phase for phase, _ in members), {}
        for phase, place in members:
            if phase in phases:
                places.setdefault(quantity + phases[phase], place)
        if places:
            groups[bay] = places
    return groups


def _voltages_of(bay: str, voltages: list[str]) -> tuple[str | None, str]:
    """The voltages' bay for the currents of a bay, and why that one; None where it cannot be told."""
    if bay in voltages:
        return bay, "of the same name"
    alike = {other: _common(bay, other) for other in voltages}
    longest = max(alike.values(), default=0)
    best = [other for other, length in alike.items() if length == longest]
    if longest >= _ALIKE and len(best) == 1:
        return best[0], f"of the name most alike, '{best[0]}'"
    if len(voltages) == 1:
        return voltages[0], "the only ones"
    return None, "none" if not voltages else f"one of {len(voltages)}: say which"


def _common(one: str, other: str) -> int:
    """Characters that two names have in common at their beginning."""
    different = (i for i, (a, b) in enumerate(zip(one, other, strict=False)) if a != b)
    return next(different, min(len(one), len(other)))
