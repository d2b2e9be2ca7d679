"""What must never be, by where the fault is: the wrong operations of a relay's zones, counted."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from faultloop.study.report import Check, Table
from faultloop.study.suites.distance.network import REACH, Network
from faultloop.study.suites.distance.rows import Mask, Rows

FAR_PU = 1.05 * REACH
"""From here on zone 1 shall not operate: the transient overreach that makers allow themselves."""
ZONES = {
    "MHO": "zone 1, mho",
    "QUAD": "zone 1, quadrilateral",
    "FWD": "forward zone of 120 %",
    "REV": "reverse zone of 50 %",
}
"""Relays that most tests have side by side at A, each with one zone without delay."""


def relays(network: Network, *names: str, **tables: Any) -> dict[str, dict[str, Any]]:
    """Settings of these of `ZONES`; all without names."""
    zones = {
        "MHO": network.mho(),
        "QUAD": network.quad(),
        "FWD": network.mho(1.2),
        "REV": network.mho(0.5, direction="reverse"),
    }
    return {name: network.settings(zones[name], **tables) for name in names or ZONES}


class Wrong(NamedTuple):
    """Operations where there must be none."""

    what: str
    cases: int
    operated: int


def wrong(rows: Rows, names: Mapping[str, str] = ZONES) -> list[Wrong]:
    """Of every relay that is there, by where the faults are; bolted ones."""
    depth = rows["depth"]
    places: dict[str, Mask] = {
        "behind": depth < 0,
        "beyond the line": depth >= 1,
        f"on the line beyond {100 * FAR_PU:.0f} %": (depth >= FAR_PU - 1e-9) & (depth < 1),
        "ahead": depth >= 0,
    }
    never = {"REV": ("ahead",), "FWD": ("behind",)}
    found = []
    for relay, zone in names.items():
        if f"{relay}.tripped" not in rows:
            continue
        kind = relay if relay in never else "MHO"
        for place in never.get(kind, tuple(places)[:3]):
            own = rows.pick(places[place])
            if len(own):
                found.append(Wrong(f"{zone}, fault {place}", len(own), int(own.tripped(relay).sum())))
    return found


def quiet(rows: Rows, what: str = "no fault") -> list[Wrong]:
    """Operations of every relay that is there, in cases without a fault."""
    own = {relay: zone for relay, zone in ZONES.items() if f"{relay}.tripped" in rows}
    return [
        Wrong(f"{zone}, {what}", len(rows), int(rows.tripped(relay).sum()))
        for relay, zone in own.items()
        if len(rows)
    ]


def wrong_table(title: str, found: list[Wrong]) -> Table:
    """Which, of how many."""
    rows = [(w.what, w.operated, w.cases) for w in found]
    return Table(title, ("must not operate", ">operated", ">of"), rows)


def wrong_checks(found: list[Wrong]) -> list[Check]:
    """None of each."""
    return [Check.none_of(f"{w.what}: operated", w.operated, w.cases) for w in found]
