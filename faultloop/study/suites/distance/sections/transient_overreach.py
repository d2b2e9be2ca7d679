"""Transient overreach: how far beyond its reach zone 1 operates, with full offset, ideal transformers."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from faultloop.study.diagram import Curve, Diagram, Limit
from faultloop.study.report import Check, Report, Table
from faultloop.study.suites.distance.makers import OVERREACH
from faultloop.study.suites.distance.network import REACH, Network
from faultloop.study.suites.distance.rows import Rows
from faultloop.study.suites.distance.section import angles, claims_table
from faultloop.study.suites.distance.security import relays, wrong, wrong_checks, wrong_table
from faultloop.study.suites.distance.sweep import TYPES, Sweep

TITLE = "Transient overreach"
RATIOS = {0.1: 100.0, 0.5: 100.0, 1.0: 100.0, 5.0: 100.0, 10.0: 100.0, 15.0: 25.0, 30.0: 25.0, 60.0: 25.0}
"""SIR, and the length of the line [km]."""
BEYOND = (1, 2, 3, 5, 10, 25)
"""Percent beyond the reach."""
LIMIT = 5.0
RELAYS = {"MHO": "mho", "QUAD": "quadrilateral"}


def sweeps(quick: bool) -> dict[str, Sweep]:
    found = {}
    for sir in (1.0, 30.0) if quick else RATIOS:
        network = Network(sir=sir, length_km=RATIOS[sir])
        vary = {"type": ("AG", "BC") if quick else TYPES, "angle": angles(2 if quick else 6)}
        own = relays(network, *RELAYS)
        beyond = (5, 25) if quick else BEYOND
        found[f"overreach-sir-{sir:g}"] = Sweep(
            network, own, {"at": [REACH * (1 + b / 100) for b in beyond], **vary}
        )
        found[f"overreach-next-line-sir-{sir:g}"] = Sweep(
            network, own, {"at": (0.0,) if quick else (0.0, 0.2), **vary}, {"line": "BC", "at_pu": 0.0}
        )
    return found


def fill(report: Report, rows: Mapping[str, Rows]) -> None:
    every = Rows.joined(rows.values())
    report.text.append(
        "Bolted faults just beyond the reach of a zone 1 of 80 % without delay, at every point on wave, "
        "so with every offset from none to full; ideal transformers. The overreach is the farthest fault "
        "that was operated for, over the reach."
    )
    report.tables.append(_table(every))
    shown = []
    worst = {
        relay: max(_overreach(every.only(sir=s), relay) for s in every.values("sir")) for relay in RELAYS
    }
    for claim in OVERREACH[:2]:
        shown.append((claim, f"{worst['MHO']:g} %", "mho, every SIR, ideal transformers"))
    report.tables.append(claims_table("Makers' figures beside ours", shown))
    found = wrong(every)
    report.tables.append(wrong_table("Operations that must not be", found))
    report.diagrams.append(_diagram(every))
    report.checks += [
        Check(f"{name}: overreach, every SIR", worst[relay], LIMIT, "%") for relay, name in RELAYS.items()
    ]
    report.checks += wrong_checks(found)


def _overreach(rows: Rows, relay: str) -> float:
    """Of the farthest fault operated for, in percent of the reach; 0 for none."""
    far = rows["depth"][rows.tripped(relay)]
    return float(np.round(100 * (far.max() / REACH - 1), 6)) if len(far) else 0.0


def _table(rows: Rows) -> Table:
    shown = []
    for sir in rows.values("sir"):
        own = rows.only(sir=sir)
        cells = []
        for relay in RELAYS:
            cells += [f"{_overreach(own, relay):g}", f"{int(own.tripped(relay).sum())} of {len(own)}"]
        shown.append((f"{sir:g}", f"{RATIOS[sir]:g}", *cells))
    columns = (">SIR", ">line km", ">mho %", ">operated", ">quadrilateral %", ">operated")
    return Table("Overreach by SIR", columns, shown)


def _diagram(rows: Rows) -> Diagram:
    x = rows.values("sir")
    curves = [
        Curve(name, x, [_overreach(rows.only(sir=s), relay) for s in x], colour=colour)
        for colour, (relay, name) in enumerate(RELAYS.items())
    ]
    title = "Transient overreach against SIR, worst of every type and angle"
    return Diagram(title, "SIR", "% of the reach", curves, [Limit("limit 5 %", LIMIT)], log_x=True, x_ticks=x,
                   y_range=(0, 30))  # fmt: skip
