"""Infeed from both ends, load either way, and fault resistance."""

from __future__ import annotations

from collections.abc import Mapping

from faultloop.study.diagram import Curve, Diagram
from faultloop.study.report import Check, Report, Table
from faultloop.study.suites.distance.network import FAULT_S, Network
from faultloop.study.suites.distance.rows import Rows
from faultloop.study.suites.distance.section import angles
from faultloop.study.suites.distance.security import Wrong, relays, wrong, wrong_checks, wrong_table
from faultloop.study.suites.distance.sweep import Sweep

TITLE = "Double infeed, load and fault resistance"
LOADS_DEG = (-40.0, -20.0, 0.0, 20.0, 40.0)
FAR = (0.2, 1.0, 5.0)
RESISTANCES = (0.0, 5.0, 10.0, 15.0, 25.0)
"""Of each phase [ohm]; the quadrilateral reaches to 20 between phases and 30 to ground."""
PLACES = (0.2, 0.4, 0.6, 0.84, 0.9, 1.0)
ZONE1 = ("MHO", "QUAD")


def sweeps(quick: bool) -> dict[str, Sweep]:
    found = {}
    vary = {
        "resistance": (0.0, 5.0) if quick else RESISTANCES,
        "type": ("AG",) if quick else ("AG", "BC", "ABC"),
        "angle": angles(1 if quick else 2),
    }
    for far in (1.0,) if quick else FAR:
        for load in (20.0,) if quick else LOADS_DEG:
            network, tags = Network(sir=1.0, far_sir=far, angle_deg=load), {"load_deg": load, "far_sir": far}
            own, name = relays(network), f"infeed-{far:g}-{load:g}"
            places = (0.4, 1.0) if quick else PLACES
            found[name] = Sweep(network, own, {"at": places, **vary}, tags=tags)
            found[f"{name}-behind"] = Sweep(
                network, own, vary, {"bus": "A", "after_s": FAULT_S, "angle_deg": 0.0}, tags
            )
            if not quick:
                further = {"line": "BC", "at_pu": 0.25}
                found[f"{name}-beyond"] = Sweep(network, own, {"at": (0.25,), **vary}, further, tags)
    return found


def fill(report: Report, rows: Mapping[str, Rows]) -> None:
    every = Rows.joined([own if "at" in own else own.tagged(at=float("nan")) for own in rows.values()])
    report.text.append(
        "Sources at both ends, 40 degrees apart at most; SIR 1 at A, 0.2 to 5 at C; each faulted phase "
        "through a resistance of 0 to 25 ohm. The far infeed magnifies it and turns it by the load angle:"
        " a bolted fault must be judged right, one with resistance is told."
    )
    bolted = every.only(resistance=0.0)
    found = wrong(bolted)
    resistive = [Wrong(w.what, w.cases, w.operated) for w in wrong(every.pick(every["resistance"] > 0))]
    report.tables += [
        wrong_table("Operations that must not be, bolted faults", found),
        wrong_table("The same, faults with resistance: told", resistive),
        _coverage(every),
    ]
    report.diagrams += [_diagram(every, relay) for relay in ZONE1]
    report.checks += wrong_checks(found)
    inside = bolted.between("depth", 0, 0.6)
    for relay in ZONE1:
        what = f"{relay.lower()}, bolted, to 60 % of the line, every load: not operated"
        report.checks.append(Check.none_of(what, inside.times(relay).missed, len(inside)))


def _part(rows: Rows, relay: str) -> float:
    return 100.0 * float(rows.tripped(relay).mean()) if len(rows) else float("nan")


def _coverage(rows: Rows) -> Table:
    inside = rows.between("depth", 0, 0.6)
    shown = []
    for kind in inside.values("type"):
        for resistance in inside.values("resistance"):
            own = inside.only(type=kind, resistance=resistance)
            cells = [
                f"{_part(own.only(load_deg=load), r):.0f}" for r in ZONE1 for load in own.values("load_deg")
            ]
            shown.append((kind, f"{resistance:g}", *cells))
    loads = [f"{load:g}" for load in inside.values("load_deg")]
    columns = ("fault", ">ohm", *(f">{r.lower()} {load}" for r in ZONE1 for load in loads))
    note = "Percent operated, to 60 % of the line, every far source; columns: by how much A leads, degrees."
    return Table("Coverage of fault resistance", columns, shown, note)


def _diagram(rows: Rows, relay: str) -> Diagram:
    inside = rows.between("depth", 0, 0.6)
    x = inside.values("resistance")
    curves = []
    for colour, load in enumerate(inside.values("load_deg")):
        y = [_part(inside.only(load_deg=load, resistance=r), relay) for r in x]
        curves.append(Curve(f"A leads by {load:g} degrees", x, y, colour=colour))
    title = f"Faults to 60 % of the line that {relay.lower()} operates for"
    return Diagram(title, "ohm of each faulted phase", "%", curves, y_range=(-2, 102))
