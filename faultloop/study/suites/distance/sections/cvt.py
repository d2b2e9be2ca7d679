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
KNOWN_MS = (15.0, 25.0)
"""Median and longest to half of the line where the circuit is known."""
TOLD = ("nothing", "the circuit")
"""What the relay is told of its transformer."""
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
            places = (0.3, 1.0) if quick else (*INSIDE, *OUTSIDE[:3])
            for told in TOLD:
                known = {"kind": "cvt", "circuit": circuit} if told == TOLD[1] else None
                own, tags = relays(network, RELAY, vt=known), {"circuit": circuit, "told": told}
                name = f"cvt-{circuit}-{sir:g}{'-known' if known else ''}"
                found[name] = Sweep(network, own, {"at": places, **vary}, tags=tags)
                if not quick:
                    next_line = {"line": "BC", "at_pu": 0.1 * network.length_km / network.beyond_km}
                    found[f"{name}-beyond"] = Sweep(network, own, vary, next_line, tags)
    return found


def fill(report: Report, rows: Mapping[str, Rows]) -> None:
    every = Rows.joined([own.tagged(place=np.round(own["depth"], 6)) for own in rows.values()])
    report.text.append(
        "Zone 1 of 80 %, mho, behind P1 and P2 (passive, 100 and 20 nF), A1 and A2 (active, 100 and 20 "
        "nF; A2 is of no class): docs/plant.md. The relay is told nothing of it, or the circuit. A-G, B-C, "
        "A-B-C at 12 angles: 36 faults a cell."
    )
    for told in TOLD:
        own = every.only(told=told)
        report.tables += [_outside(own, told), _inside(own, told)]
        report.diagrams.append(_overreach_diagram(own, told))
        report.diagrams += [_contour(own.only(circuit=c), c, told) for c in own.values("circuit")]
    report.tables.append(_makers(every))
    _check(report, every)


def _outside(rows: Rows, told: str) -> Table:
    far = rows.pick(rows["place"] > 0.8)
    places = far.values("place")
    shown = []
    for circuit in rows.values("circuit"):
        for sir in rows.values("sir"):
            cells = [_operated(_cell(far, circuit, sir, p)) for p in places]
            shown.append((circuit, f"{sir:g}", *cells))
    columns = ("circuit", ">SIR", *(f">{100 * p:g} %" for p in places))
    title = f"Operations for faults outside the zone, by place on the line; told {told}"
    return Table(title, columns, shown)


def _cell(rows: Rows, circuit: str, sir: float, place: float) -> Rows:
    return rows.only(circuit=circuit, sir=sir, place=place)


def _operated(rows: Rows) -> str:
    return f"{int(rows.tripped(RELAY).sum())} of {len(rows)}"


def _inside(rows: Rows, told: str) -> Table:
    near = rows.pick(rows["place"] < 0.8)
    shown = []
    for circuit in rows.values("circuit"):
        for sir in rows.values("sir"):
            for place in near.values("place"):
                times = _cell(near, circuit, sir, place).times(RELAY)
                shown.append((circuit, f"{sir:g}", f"{100 * place:g} %", *time_cells(times)))
    title = f"Operate time for faults inside; told {told}"
    return Table(title, ("circuit", ">SIR", ">place", *TIME_COLUMNS), shown)


def _secure_reach(rows: Rows) -> float:
    """The largest reach that would have been secure, per unit of the line, as far as the places tell."""
    far = rows.pick(rows["place"] > 0.8)
    reached = far["place"][far.tripped(RELAY)]
    return float(reached.max()) if len(reached) else 0.8


def _overreach_diagram(rows: Rows, told: str) -> Diagram:
    curves = []
    for colour, circuit in enumerate(rows.values("circuit")):
        x = rows.only(circuit=circuit).values("sir")
        y = [100 * (_secure_reach(rows.only(circuit=circuit, sir=s)) / 0.8 - 1) for s in x]
        curves.append(Curve(circuit, x, y, colour=colour))
    title = f"Overreach of zone 1 behind capacitive voltage transformers; told {told}"
    return Diagram(title, "SIR", "% of the reach", curves, [Limit("REL670, SEL-421: 5 %", 5.0)], log_x=True,
                   x_ticks=rows.values("sir"), y_range=(-2, 40))  # fmt: skip


def _contour(rows: Rows, circuit: str, told: str) -> Diagram:
    near = rows.pick(rows["place"] < 0.8)
    x, y = near.values("place"), near.values("sir")
    z = np.array([[near.only(place=p, sir=s).times(RELAY).at(1.0) for p in x] for s in y])
    times = np.where(np.isfinite(z), z, np.nan)
    surface = Surface([100 * p for p in x], y, times, (10.0, 20.0, 30.0, 50.0))
    title = f"CVT-SIR diagram, {circuit}, told {told}: longest operate time"
    position = "fault position [% of the line]"
    return Diagram(title, position, "SIR", surface=surface)


def _makers(rows: Rows) -> Table:
    shown = []
    for told in TOLD:
        for circuits, names in ((CIRCUITS[:3], "P1, P2, A1"), (CIRCUITS[3:], "A2")):
            own = rows.only(told=told).pick(np.isin(rows.only(told=told)["circuit"], circuits))
            own = own.between("sir", 0.5, 30)
            if len(own):
                over = 100 * (_secure_reach(own) / 0.8 - 1)
                what = f"{names}, told {told}, SIR 0.5 to 30; faults at 85, 90, 100, 110 %"
                shown.append((OVERREACH[1], f"{over:.4g} %", what))
        at18 = rows.only(sir=18.0, told=told)
        at18 = at18.pick(np.isin(at18["circuit"], ("A1", "A2")))
        if len(at18):
            secure = "80 % of the line" if _secure_reach(at18) == 0.8 else "not 80 % of the line"
            shown.append((OVERREACH[2], secure, f"A1, A2, told {told}, SIR 18"))
    return claims_table("Published figures beside ours", shown)


def _check(report: Report, rows: Rows) -> None:
    for circuits, limits in ((CIRCUITS, SECURE), (CIRCUITS[:3], SECURE_MOST)):
        for circuit in circuits:
            for place, most in limits.items():
                for told in TOLD:
                    own = rows.only(circuit=circuit, place=place, told=told).between("sir", 0, most)
                    if len(own):
                        where = f"fault at {100 * place:g} %, SIR to {most:g}: operated"
                        what, operated = f"{circuit}, told {told}, {where}", own.tripped(RELAY).sum()
                        report.checks.append(Check.none_of(what, operated, len(own)))
    near = rows.only(told=TOLD[0]).between("place", 0, 0.3).between("sir", 0, 5)
    half = rows.only(told=TOLD[1]).between("place", 0, 0.5)
    for circuit in near.values("circuit"):
        times = near.only(circuit=circuit).times(RELAY)
        what = f"{circuit}, told {TOLD[0]}, to 30 % of the line, SIR to 5: longest"
        report.checks.append(Check(what, times.at(1.0), WITHIN_MS, "ms"))
        known = half.only(circuit=circuit).times(RELAY)
        what = f"{circuit}, told {TOLD[1]}, to 50 % of the line: "
        for part, name, limit in zip((0.5, 1.0), ("median", "longest"), KNOWN_MS, strict=True):
            report.checks.append(Check(what + name, known.at(part), limit, "ms"))
