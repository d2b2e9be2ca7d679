"""What a unit in a .cfg is of: volts or amperes, and how many."""

from __future__ import annotations

import re
from typing import Literal, NamedTuple

Quantity = Literal["v", "i"]

_UNIT = re.compile(  # Cyrillic letters look the same and are not
    r"(?P<prefix>kilo|milli|mega|кило|[kKmMкКмМ]|千|毫)?\s*"
    r"(?:(?P<v>volts?|v|вольта?|в|伏)|(?P<i>amp(?:ere|ère|ére)?s?|a|ампера?|а|安))\.?",
    re.IGNORECASE,
)
_FACTORS = {
    "": 1.0, "k": 1e3, "K": 1e3, "к": 1e3, "К": 1e3, "千": 1e3, "kilo": 1e3, "кило": 1e3,
    "m": 1e-3, "м": 1e-3, "毫": 1e-3, "milli": 1e-3, "M": 1e6, "М": 1e6, "mega": 1e6,
}  # fmt: skip


class Unit(NamedTuple):
    """Volts ("v") or amperes ("i"), and the factor to them."""

    quantity: Quantity
    factor: float


def unit_of(text: str) -> Unit | None:
    """The unit that a text means: ``V``, ``kVolts``, ``кВ``, ``Amps``, ``[kA]``; None for any other."""
    match = _UNIT.fullmatch(text.strip().strip("[]()").strip())
    if match is None:
        return None
    prefix = match["prefix"] or ""
    factor = _FACTORS.get(prefix, _FACTORS.get(prefix.lower()))
    return Unit("v" if match["v"] else "i", factor) if factor is not None else None
