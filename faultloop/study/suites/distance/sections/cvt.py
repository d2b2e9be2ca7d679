"""Zone 1 behind capacitive voltage transformers: overreach and operate time, and the CVT-SIR diagram."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from faultloop.study.diagram import Curve, Diagram, Limit, Surface
from faultloop.study.report import Check, Report, Table
from faultloop.study.suites.distance.makers import OVERREACH
from faultloop.study.suites.distance.network import BASE_KV, Network
from faultloop.study.suites.distance.rows import Rows
from faultloop.study.suites.distance.section import TIME_COLUMNS, angles, claims_table, time_cells
from faultloop.study.suites.distance.security import relays
from faultloop.study.suites.distance.sweep import Sweep

TITLE = "Capacitive voltage transformers"
CIRCUITS = ("P1", "P2", "A1", "A2")
RATIOS = (0.5, 1.0, 5.0, 10.0, 18.0, 30.0)
OUTSIDE = (0.85, 0.9, 1.0, 1.1)
INSIDE = (0.1, 0.3, 0.5, 0.7)
WITHIN_MS = 50.0
SECURE = {1.0: 30.0, 1.1: 30.0}
"""Place on the line, and the SIR up to which zone 1 must not operate behind any circuit."""
SECURE_MOST = {0.9: 18.0}
"""The same behind P1, P2 and A1."""
RATIO = [BASE_KV * 1e3 / 3**0.5, 110.0 / 3**0.5]
RELAY = "MHO"


def sweeps(quick: bool) -> dict[str, Sweep]:
    vary = {"type": ("AG", "BC") if quick else ("AG", "BC", "ABC"), "angle": angles(1 if quick else 12)}
    found = {}
    for circuit in ("P1", "A1") if quick else CIRCUITS:
        for sir in (5.0,) if quick else RATIOS:
            vt = {"name": "V", "ratio": RATIO, "model": "cvt", "circuit": circuit}
            network = Network(sir=sir, more={"vt": [vt]}, relay={"vt": "V"})
            own, tags = relays(network, RELAY), {"circuit": circuit}
            places = (0.3, 1.0) if quick else (*INSIDE, *OUTSIDE[:3])
            found[f"cvt-{circuit}-{sir:g}"] = Sweep(network, own, {"at": places, **vary}, tags=tags)
            if not quick:
                next_line = {"line": "BC", "at_pu": 0.1 * network.length_km / network.beyond_km}
                found[f"cvt-{circuit}-{sir:g}-beyond"] = Sweep(network, own, vary, next_line, tags)
    return found


def fill(report: Report, rows: Mapping[str, Rows]) -> None:
    every = Rows.joined([own.tagged(place=np.round(own["depth"], 6)) for own in rows.values()])
    report.text.append(
        "Zone 1 of 80 %, mho, behind P1 and P2 (passive, 100 and 20 nF), A1 and A2 (active, 100 and 20 "
        "nF; A2 is of no class): docs/plant.md. The relay is not told which. A-G, B-C, A-B-C at 12 "
        "angles: 36 faults a cell."
    )
    report.tables += [_outside(every), _inside(every), _makers(every)]
    report.diagrams.append(_overreach_diagram(every))
    report.diagrams += [_contour(every.only(circuit=c), c) for c in every.values("circuit")]
    _check(report, every)


def _outside(rows: Rows) -> Table:
    far = rows.pick(rows["place"] > 0.8)
    places = far.values("place")
    shown = []
    for circuit in rows.values("circuit"):
        for sir in rows.values("sir"):
            cells = [_operated(_cell(far, circuit, sir, p)) for p in places]
            shown.append((circuit, f"{sir:g}", *cells))
    columns = ("circuit", ">SIR", *(f">{100 * p:g} %" for p in places))
    return Table("Operations for faults outside the zone, by place on the line", columns, shown)


def _cell(rows: Rows, circuit: str, sir: float, place: float) -> Rows:
    return rows.only(circuit=circuit, sir=sir, place=place)


def _operated(rows: Rows) -> str:
    return f"{int(rows.tripped(RELAY).sum())} of {len(rows)}"


def _inside(rows: Rows) -> Table:
    near = rows.pick(rows["place"] < 0.8)
    shown = []
    for circuit in rows.values("circuit"):
        for sir in rows.values("sir"):
            for place in near.values("place"):
                times = _cell(near, circuit, sir, place).times(RELAY)
                shown.append((circuit, f"{sir:g}", f"{100 * place:g} %", *time_cells(times)))
    return Table("Operate time for faults inside", ("circuit", ">SIR", ">place", *TIME_COLUMNS), shown)


def _secure_reach(rows: Rows) -> float:
    """The largest reach that would have been secure, per unit of the line, as far as the places tell."""
    far = rows.pick(rows["place"] > 0.8)
    reached = far["place"][far.tripped(RELAY)]
    return float(reached.max()) if len(reached) else 0.8


def _overreach_diagram(rows: Rows) -> Diagram:
    curves = []
    for colour, circuit in enumerate(rows.values("circuit")):
        x = rows.only(circuit=circuit).values("sir")
        y = [100 * (_secure_reach(rows.only(circuit=circuit, sir=s)) / 0.8 - 1) for s in x]
        curves.append(Curve(circuit, x, y, colour=colour))
    title = "Overreach of zone 1 behind capacitive voltage transformers"
    return Diagram(title, "SIR", "% of the reach", curves, [Limit("REL670, SEL-421: 5 %", 5.0)], log_x=True,
                   x_ticks=rows.values("sir"), y_range=(-2, 40))  # fmt: skip


def _contour(rows: Rows, circuit: str) -> Diagram:
    near = rows.pick(rows["place"] < 0.8)
    x, y = near.values("place"), near.values("sir")
    z = np.array([[near.only(place=p, sir=s).times(RELAY).at(1.0) for p in x] for s in y])
    times = np.where(np.isfinite(z), z, np.nan)
    surface = Surface([100 * p for p in x], y, times, (10.0, 20.0, 30.0, 50.0))
    title, position = f"CVT-SIR diagram, {circuit}: longest operate time", "fault position [% of the line]"
    return Diagram(title, position, "SIR", surface=surface)


def _makers(rows: Rows) -> Table:
    shown = []
    for circuits, told in ((CIRCUITS[:3], "P1, P2, A1"), (CIRCUITS[3:], "A2")):
        own = rows.pick(np.isin(rows["circuit"], circuits)).between("sir", 0.5, 30)
        if len(own):
            over = 100 * (_secure_reach(own) / 0.8 - 1)
            shown.append(
                (OVERREACH[1], f"{over:.4g} %", f"{told}, SIR 0.5 to 30; faults at 85, 90, 100, 110 %")
            )
    at18 = rows.only(sir=18.0).pick(np.isin(rows.only(sir=18.0)["circuit"], ("A1", "A2")))
    if len(at18):
        secure = "80 % of the line" if _secure_reach(at18) == 0.8 else "not 80 % of the line"
        shown.append((OVERREACH[2], secure, "A1, A2, SIR 18"))
    return claims_table("Published figures beside ours", shown)


def _check(report: Report, rows: Rows) -> None:
    for circuits, limits in ((CIRCUITS, SECURE), (CIRCUITS[:3], SECURE_MOST)):
        for circuit in circuits:
            for place, most in limits.items():
                own = rows.only(circuit=circuit, place=place).between("sir", 0, most)
                if len(own):
                    what = f"{circuit}, fault at {100 * place:g} %, SIR to {most:g}: operated, of {len(own)}"
                    report.checks.append(Check(what, float(own.tripped(RELAY).sum()), 0.0))
    near = rows.between("place", 0, 0.3).between("sir", 0, 5)
    for circuit in near.values("circuit"):
        times = near.only(circuit=circuit).times(RELAY)
        what = f"{circuit}, to 30 % of the line, SIR to 5: longest"
        report.checks.append(Check(what, times.at(1.0), WITHIN_MS, "ms"))
