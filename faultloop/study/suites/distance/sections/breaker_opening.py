"""A breaker opens: the own one with the voltage measured on the line's side, or that at the far end."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from faultloop.study.diagram import Curve, Diagram
from faultloop.study.report import Report, Table
from faultloop.study.suites.distance.network import Network
from faultloop.study.suites.distance.rows import Rows
from faultloop.study.suites.distance.section import angles
from faultloop.study.suites.distance.security import (
    Wrong,
    quiet,
    relays,
    wrong,
    wrong_checks,
    wrong_table,
)
from faultloop.study.suites.distance.sweep import Sweep

TITLE = "Breaker opening"
OPENS_S = 0.12
"""60 ms after the fault."""
AT = "switching.S1.at_s"
RATIOS = (0.5, 5.0)


def _network(sir: float, breaker: str, side: str, poles: str = "ABC") -> Network:
    """One whose breaker opens by itself."""
    switching = {"name": "S1", "breaker": breaker, "operation": "open", "poles": poles, "at_s": OPENS_S}
    far = [{"name": "QB", "line": "AB", "end": "to"}]
    return Network(
        sir=sir, duration_s=0.3, relay={"voltage_at": side}, more={"switching": [switching], "breaker": far}
    )


def sweeps(quick: bool) -> dict[str, Sweep]:
    instants = [OPENS_S + 0.0025 * k for k in range(1 if quick else 4)]
    types = ("AG", "ABC") if quick else ("AG", "BC", "BCG", "ABC")
    vary = {AT: instants, "type": types, "angle": angles(1 if quick else 4)}
    found = {}
    for sir in (5.0,) if quick else RATIOS:
        for breaker in ("QA", "QB"):
            for side in ("line",) if quick else ("line", "bus"):
                network, name = _network(sir, breaker, side), f"opening-{breaker}-{side}-{sir:g}"
                own, tags = relays(network), {"breaker": breaker, "side": side}
                places = {"at": (1.0,) if quick else (0.9, 1.0)} | vary
                found[f"{name}-far"] = Sweep(network, own, places, {"line": "AB", "at_pu": 1.0}, tags)
                found[f"{name}-behind"] = Sweep(network, own, vary, {"bus": "A"}, tags)
                if not quick:
                    next_line = {"at": (0.2, 0.6)} | vary
                    found[f"{name}-beyond"] = Sweep(
                        network, own, next_line, {"line": "BC", "at_pu": 0.5}, tags
                    )
                    for poles in ("A", "BC", "ABC"):
                        load = {"source.SA.angle_deg": (-30.0, 8.0, 30.0), AT: instants}
                        switched = _network(sir, breaker, side, poles)
                        found[f"{name}-none-{poles}"] = Sweep(switched, relays(switched), load, None, tags)
    return found


def fill(report: Report, rows: Mapping[str, Rows]) -> None:
    every = Rows.joined(rows.values())
    faults, none = every.pick(np.isfinite(every["depth"])), every.pick(np.isnan(every["depth"]))
    report.text.append(
        "Bolted faults outside zone 1, at 90 and 100 % of the line, beyond it and at bus A. 60 ms later "
        "the breaker at A opens, by another relay's command, or that at B, each pole at its current zero;"
        " the voltage is measured on the line's side of the breaker or at the bus. And the same without a"
        " fault, all poles, two, or one."
    )
    found = _wrong(faults, none)
    report.tables += [wrong_table("Operations that must not be", found), _by_breaker(faults, none)]
    report.diagrams.append(_diagram(faults))
    report.checks += wrong_checks(found)


def _wrong(faults: Rows, none: Rows) -> list[Wrong]:
    # The far breaker isolates a fault at 90 % with A alone: then it is A's, and the reach told by the zone.
    return [*wrong(faults), *quiet(none)]


def _by_breaker(faults: Rows, none: Rows) -> Table:
    shown = []
    for breaker in faults.values("breaker"):
        for side in faults.values("side"):
            own = faults.only(breaker=breaker, side=side)
            for w in _wrong(own, none.only(breaker=breaker, side=side)):
                if w.operated:
                    shown.append((breaker, side, w.what, w.operated, w.cases))
    if not shown:
        shown.append(("-", "-", "none", 0, len(faults) + len(none)))
    return Table("Which of them", ("opens", "voltage at", "", ">operated", ">of"), shown)


def _diagram(rows: Rows) -> Diagram:
    """When zone 1 operated after the opening, a point for each case that did."""
    curves = []
    for colour, relay in enumerate(("MHO", "QUAD", "FWD", "REV")):
        times = rows.times(relay).values - 1e3 * (rows[AT] - rows["fault_ns"] / 1e9)
        own = np.isfinite(times)
        curves.append(Curve(relay, rows["depth"][own], times[own], "points", colour))
    title = "Every operation, from the opening: those after 0 answer it"
    return Diagram(title, "fault's place, per unit of the line", "ms after the opening", curves)
