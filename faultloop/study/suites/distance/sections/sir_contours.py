"""SIR diagrams: operate time over fault position and source impedance ratio."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from faultloop.study.diagram import Diagram, Surface
from faultloop.study.report import Check, Report, Table
from faultloop.study.suites.distance.network import REACH, Network
from faultloop.study.suites.distance.rows import Rows
from faultloop.study.suites.distance.section import angles
from faultloop.study.suites.distance.security import relays
from faultloop.study.suites.distance.sweep import Sweep

TITLE = "SIR diagram"
RATIOS = {
    0.1: 100.0, 0.3: 100.0, 0.5: 100.0, 1.0: 100.0, 2.0: 100.0, 5.0: 100.0,
    10.0: 25.0, 15.0: 25.0, 20.0: 25.0, 30.0: 25.0, 45.0: 25.0, 60.0: 25.0,
}  # fmt: skip
"""SIR, and the length of the line [km]."""
POSITIONS = (5, 15, 25, 35, 45, 55, 65, 75, 80, 85, 90, 95)
LEVELS = (5.0, 10.0, 15.0, 20.0, 30.0, 40.0)
RELAYS = {"MHO": "mho", "QUAD": "quadrilateral"}
DEPENDABLE = 75
"""Percent of the reach, up to which every fault is operated for at every SIR."""


def sweeps(quick: bool) -> dict[str, Sweep]:
    positions = (15, 65) if quick else POSITIONS
    found = {}
    for sir in (1.0, 30.0) if quick else RATIOS:
        network = Network(sir=sir, length_km=RATIOS[sir])
        found[f"contour-sir-{sir:g}"] = Sweep(
            network,
            relays(network, *RELAYS),
            {
                "at": [REACH * p / 100 for p in positions],
                "type": ("AG", "BC") if quick else ("AG", "BC", "CAG", "ABC"),
                "angle": angles(1 if quick else 4),
            },
        )
    return found


def fill(report: Report, rows: Mapping[str, Rows]) -> None:
    every = Rows.joined(rows.values())
    every = every.tagged(percent=np.round(100 * every["depth"] / REACH, 6))
    report.text.append(
        "Zone 1 of 80 % without delay, ideal transformers; A-G, B-C, C-A-G and A-B-C at four angles in "
        "each cell. A cell is empty where a fault was not operated for within 140 ms."
    )
    for relay, name in RELAYS.items():
        for part, told in ((0.5, "median"), (1.0, "longest")):
            title = f"SIR diagram, {name}: {told} operate time"
            report.diagrams.append(
                Diagram(title, "fault position [% of the reach]", "SIR", surface=_surface(every, relay, part))
            )
    report.tables.append(_table(every))
    inside = every.between("percent", 0, DEPENDABLE)
    for relay, name in RELAYS.items():
        missed = inside.times(relay).missed
        what = f"{name}, to {DEPENDABLE} % of the reach, every SIR: not operated"
        report.checks.append(Check.none_of(what, missed, len(inside)))


def _surface(rows: Rows, relay: str, part: float) -> Surface:
    x, y = rows.values("percent"), rows.values("sir")
    z = [[rows.only(percent=p, sir=s).times(relay).at(part) for p in x] for s in y]
    times = np.array(z)
    return Surface(x, y, np.where(np.isfinite(times), times, np.nan), LEVELS)


def _table(rows: Rows) -> Table:
    """Farthest position up to which everything operated within a time."""
    shown = []
    for relay, name in RELAYS.items():
        for sir in rows.values("sir"):
            cells = []
            for ms in (10.0, 15.0, 20.0, 30.0):
                reached = 0.0
                for percent in rows.values("percent"):
                    if rows.only(sir=sir, percent=percent).times(relay).at(1.0) > ms:
                        break
                    reached = percent
                cells.append(f"{reached:g}" if reached else "-")
            shown.append((name, f"{sir:g}", f"{RATIOS[sir]:g}", *cells))
    columns = ("zone 1", ">SIR", ">line km", ">10 ms", ">15 ms", ">20 ms", ">30 ms")
    return Table("Percent of the reach to which every fault is operated for within", columns, shown)
