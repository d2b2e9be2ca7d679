"""What a channel's name and phase field say: quantity, phase, or why it is no phase quantity."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import NamedTuple

from faultloop.io.comtrade.record import AnalogChannel
from faultloop.io.comtrade.units import unit_of

_START = r"(?<![a-z0-9а-я])"
_END = r"(?![a-z0-9а-я])"
_QUANTITY = r"(?:voltage|volts?|current|curr|[vui])"
_PHASE = r"(?:l?[123]|[abcrywst]n?|[авс])"

# A phase quantity: V, U or I (or the word), then the phase, and nothing that makes it another one.  Only at
# the beginning may a space stand between them: "Ua", "U_A-N", "I A", "某某线Ua", and not "Bus I B".
NAMED = re.compile(
    rf"(?:^(?P<q1>{_QUANTITY})[\s_.\-]*(?P<p1>{_PHASE})|{_START}(?P<q2>{_QUANTITY})[_.]?(?P<p2>{_PHASE})){_END}",
    re.IGNORECASE,
)
PHASE_WORD = re.compile(
    rf"(?:phase|ph|фаз[аы]|ф)[\s_.\-]*(?P<p1>{_PHASE}){_END}|{_START}(?P<p2>{_PHASE})(?:相|[\s_.\-]*(?:phase|ph){_END})",
    re.IGNORECASE,
)
# Between two phases: with the quantity before it, or AB, BC, CA in capitals or small letters alone.
_LINE = re.compile(
    rf"{_START}(?:voltage|volts?|[vui])[\s_.]*"
    r"(?:l?1\W?l?2|l?2\W?l?3|l?3\W?l?1|a[-/]?b|b[-/]?c|c[-/]?a|a[-/]?c|b[-/]?a|c[-/]?b|ав|вс|са"
    rf"|r[-/]?[yws]|[yw][-/]?b|b[-/]?r|s[-/]?t|t[-/]?r){_END}",
    re.IGNORECASE,
)
_LINE_WORD = re.compile(
    rf"{_START}(?:ab|bc|ca|l1[-/]?l2|l2[-/]?l3|l3[-/]?l1){_END}|phase.to.phase|line.to.line|线电压|лин",
    re.IGNORECASE,
)
_SEQUENCE = re.compile(
    rf"{_START}3\s*[vui]|{_START}[vui][\s_]?[0оo]{_END}|{_START}[vui][\s_]?(?:n|g|e|res|sum|zero|pos|neg){_END}"
    r"|zero|residual|neutral|earth|ground|sequence|[零负正]序|中性|нул|нейтр|послед",
    re.IGNORECASE,
)
_OTHER_FIELD = re.compile(r"3?[ng0e]|[a-c]{2,3}|l?[1-3]-?l?[1-3]|[rybwst]{2}|ac|dc|[авс]{2}", re.IGNORECASE)
_ALIASES = {
    "an": "a", "а": "a", "bn": "b", "в": "b", "cn": "c", "с": "c",
    "rn": "r", "yn": "y", "wn": "w", "sn": "s", "tn": "t",
}  # fmt: skip

SYSTEMS = (
    ("a", "b", "c"),
    ("l1", "l2", "l3"),
    ("1", "2", "3"),
    ("r", "y", "b"),
    ("r", "w", "b"),
    ("r", "s", "t"),
)
"""How phases are called, first to third; R-Y-B and R-W-B are red, yellow or white, and blue."""

_ORDER = {label: {system.index(label) for system in SYSTEMS if label in system} for label in sum(SYSTEMS, ())}
_NUMBERS = SYSTEMS[2]


class Label(NamedTuple):
    """A channel's quantity ("v", "i") and phase as the file calls it; or why it is taken for no phase."""

    quantity: str
    phase: str
    why: str

    @property
    def is_phase(self) -> bool:
        return bool(self.quantity and self.phase)


def label_of(channel: AnalogChannel) -> Label:
    """What a channel is, by its unit, name and phase field."""
    unit = unit_of(channel.unit)
    if unit is None and channel.unit.strip():
        return Label("", "", f"its unit is {channel.unit}")
    name = channel.name.strip()
    quantity = unit.quantity if unit else ""
    match = None if _LINE.search(name) else NAMED.search(name)
    if match is None and (_LINE.search(name) or _LINE_WORD.search(name)):
        return Label(quantity, "", "between two phases, by its name")
    if match is None and _SEQUENCE.search(name):
        return Label(quantity, "", "a sequence or residual quantity, by its name")
    by_name = "" if match is None else "i" if (match["q1"] or match["q2"])[0] in "iIcC" else "v"
    if quantity and by_name and quantity != by_name:
        return Label("", "", f"its name and its unit, {channel.unit}, do not agree")
    quantity = quantity or by_name
    if not quantity:
        return Label("", "", "neither unit nor name say what it is")
    return _with_phase(channel, quantity, match)


def _with_phase(channel: AnalogChannel, quantity: str, match: re.Match[str] | None) -> Label:
    match = match or PHASE_WORD.search(channel.name)
    named = "" if match is None else _canonical(match["p1"] or match["p2"])
    stated = _field(channel.phase)
    if stated is None:
        return Label(quantity, "", f"its phase field says {channel.phase.strip()}")
    if named and stated and not _ORDER[named] & _ORDER[stated]:
        return Label(quantity, "", f"its name says phase {named.upper()}, its phase field {stated.upper()}")
    phase = stated or named
    if not phase:
        return Label(quantity, "", "it has no phase")
    source = "phase field" if stated else "name"
    return Label(quantity, phase, f"phase {phase.upper()} by its {source}")


def _canonical(phase: str) -> str:
    return _ALIASES.get(phase.lower(), phase.lower())


def _field(text: str) -> str | None:
    """The phase field as a phase; "" where it says nothing; None where it says something else (N, AB)."""
    text = re.sub(r"(?i)^(?:phase|ph)[\s_.\-]*|[\s_.\-]*(?:phase|ph|相)$", "", text.strip())
    text = re.sub(r"(?i)-n$", "", text)
    if re.fullmatch(_PHASE, text, re.IGNORECASE):
        return _canonical(text)
    other = text != "0" and _OTHER_FIELD.fullmatch(text)
    return None if other else ""


def phases_of(labels: Iterable[str]) -> dict[str, str]:
    """Which of a, b, c each of the labels is that stand together in one record.

    B is the second phase beside A and C, and the third beside R and Y: the labels say together whose they
    are.  A single R may be a residual quantity, and 1, 2 without 3 are sequences.
    """
    present = set(labels)
    best: tuple[str, ...] = ()
    for system in SYSTEMS:
        members = present & set(system)
        if len(members) > len(present & set(best)) and _enough(system, members):
            best = system
    return dict(zip(best, "abc", strict=False))


def _enough(system: tuple[str, ...], members: set[str]) -> bool:
    if system == _NUMBERS:
        return len(members) == 3
    return system[0] != "r" or ("r" in members and system[1] in members) or members == {"r", "t"}
