"""Faults that evolve, and faults outside the line that are followed by one on it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from faultloop.study.diagram import Curve, Diagram, Limit
from faultloop.study.report import Check, Report, Table
from faultloop.study.suites.distance.network import FAULT_S, Network
from faultloop.study.suites.distance.rows import Rows, Times
from faultloop.study.suites.distance.section import TIME_COLUMNS, time_cells
from faultloop.study.suites.distance.security import relays
from faultloop.study.suites.distance.sweep import Sweep

TITLE = "Evolving faults"
SECOND = "fault.F2.start_s"
AFTER_MS = (2.0, 5.0, 10.0, 15.0, 20.0, 30.0, 50.0)
PAIRS = (("AG", "ABG"), ("AG", "ABCG"), ("BC", "ABC"), ("CG", "BCG"))
CROSS = (("AG", "BG"), ("BC", "AG"), ("CG", "ABC"), ("AG", "AG"))
"""Types of the first fault, outside, and of the second, on the line."""
FIRST = {
    "inside": {"line": "AB", "at_pu": 0.3},
    "behind": {"bus": "A"},
    "beyond": {"line": "BC", "at_pu": 0.2},
}
RATIOS = (1.0, 5.0)
RELAYS = ("MHO", "QUAD")
SLOWEST_MS = 60.0
"""After the fault that is on the line."""


def sweeps(quick: bool) -> dict[str, Sweep]:
    found = {}
    starts = [FAULT_S + 0.005 * k for k in range(1 if quick else 4)]
    for sir in (1.0,) if quick else RATIOS:
        for place in ("inside", "behind") if quick else FIRST:
            pairs = PAIRS if place == "inside" else CROSS
            for first, second in pairs[:1] if quick else pairs:
                for start in starts:
                    after = (10.0,) if quick else AFTER_MS
                    more = {"name": "F2", "type": second, "line": "AB", "at_pu": 0.3, "start_s": start + 0.01}
                    network = Network(sir=sir, more={"fault": [more]}, duration_s=0.25)
                    fault = FIRST[place] | {"type": first, "start_s": start}
                    name = f"evolving-{place}-{first}-{second}-{sir:g}-{1e3 * start:g}"
                    vary = {SECOND: [round(start + ms / 1e3, 6) for ms in after]}
                    tags = {"first": place, "pair": f"{first}, then {second}", "start_s": start}
                    found[name] = Sweep(network, relays(network, *RELAYS), vary, fault, tags)
    return found


def fill(report: Report, rows: Mapping[str, Rows]) -> None:
    every = Rows.joined(rows.values())
    after = np.round(1e3 * (every[SECOND] - every["start_s"]), 3)
    every = every.tagged(after_ms=after, second_ns=every["fault_ns"] + 1e6 * after)
    report.text.append(
        "A fault at 30 % of the line that takes in further phases after 2 to 50 ms; and a fault at bus A,"
        " or 16 km beyond B, that goes on while another begins at 30 % of the line. Zone 1 must not "
        "operate before there is a fault on the line, and must after it."
    )
    early = _early(every)
    report.tables += [_table(every), _early_table(every, early)]
    curves = []
    for colour, place in enumerate(every.values("first")):
        own = every.only(first=place)
        x = own.values("after_ms")
        worst = [_times(own.only(after_ms=ms), "MHO").at(1.0) for ms in x]
        middle = [_times(own.only(after_ms=ms), "MHO").at(0.5) for ms in x]
        told = "evolving on the line" if place == "inside" else f"first one {place}"
        for name, y, dash in ((f"{told}: median", middle, "solid"), (f"{told}: maximum", worst, "dot")):
            curves.append(Curve(name, x, np.where(np.isfinite(y), y, np.nan), colour=colour, dash=dash))
    title = "Operate time of zone 1, mho, from the first fault on the line"
    limits = [Limit(f"{SLOWEST_MS:g} ms", SLOWEST_MS)]
    report.diagrams.append(Diagram(title, "ms between the faults", "ms", curves, limits, y_range=(0, 100)))
    for relay in RELAYS:
        outside = every.pick(every["first"] != "inside")
        what = f"{relay.lower()}: operated before a fault was on the line"
        report.checks.append(Check.none_of(what, early[relay].sum(), len(outside)))
        inside = every.only(first="inside")
        times = _times(inside, relay)
        what = f"{relay.lower()}, evolving on the line"
        report.checks += [
            Check.none_of(f"{what}: not operated", times.missed, len(inside)),
            Check(f"{what}: longest", times.at(1.0), SLOWEST_MS, "ms", cases=len(inside)),
        ]


def _since(rows: Rows) -> Rows:
    """With the start of the first fault that is on the line."""
    inside = rows["first"] == "inside"
    return rows.tagged(on_line_ns=np.where(inside, rows["fault_ns"], rows["second_ns"]))


def _times(rows: Rows, relay: str) -> Times:
    return _since(rows).times(relay, "on_line_ns")


def _early(rows: Rows) -> dict[str, np.ndarray]:
    """Whether a relay operated before there was a fault on the line."""
    return {relay: _times(rows, relay).values <= 0 for relay in RELAYS}


def _table(rows: Rows) -> Table:
    shown = []
    for place in rows.values("first"):
        for pair in rows.only(first=place).values("pair"):
            own = rows.only(first=place, pair=pair)
            tripped = own.pick(own.tripped("MHO"))
            three = int((tripped["MHO.poles"] == "ABC").sum())
            shown.append((place, pair, *time_cells(_times(own, "MHO")), f"{three} of {len(tripped)}"))
    columns = ("first one", "types", *TIME_COLUMNS, ">three poles")
    return Table("Operate time, mho, from the first fault on the line", columns, shown)


def _early_table(rows: Rows, early: Mapping[str, np.ndarray]) -> Table:
    shown = []
    for place in rows.values("first"):
        own = rows["first"] == place
        if place != "inside":
            shown.append((place, *(f"{int((early[r] & own).sum())} of {int(own.sum())}" for r in RELAYS)))
    return Table("Operated before a fault was on the line", ("first one", ">mho", ">quadrilateral"), shown)
