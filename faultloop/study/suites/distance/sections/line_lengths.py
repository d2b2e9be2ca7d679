"""Lines of 10 to 400 km, of three models: operate time, reach and direction."""

from __future__ import annotations

from collections.abc import Mapping

from faultloop.study.diagram import Diagram, Limit
from faultloop.study.report import Check, Report, Table
from faultloop.study.suites.distance.network import Network
from faultloop.study.suites.distance.rows import Rows
from faultloop.study.suites.distance.section import TIME_COLUMNS, angles, time_cells, times_over
from faultloop.study.suites.distance.security import relays, wrong, wrong_checks, wrong_table
from faultloop.study.suites.distance.sweep import Sweep

TITLE = "Length of the line"
LENGTHS = (10.0, 20.0, 50.0, 100.0, 150.0, 200.0, 300.0, 400.0)
MODELS = ("bergeron", "pi", "rl")
SOURCE_OHM = (8.0, 40.0)
"""Of the source at A: the same strength whatever the line, so that it can energise every one of them."""
INSIDE = 0.6
LONG_KM = 150.0
WORST_MS = {False: 20.0, True: 30.0}
"""Bolted, to 60 % of the line; of lines longer than 150 km."""


def sweeps(quick: bool) -> dict[str, Sweep]:
    vary = {"type": ("AG", "BC") if quick else ("AG", "BC", "ABC"), "angle": angles(1 if quick else 3)}
    found = {}
    for model in ("bergeron",) if quick else MODELS:
        for km in (10.0, 300.0) if quick else LENGTHS:
            for ohm in SOURCE_OHM[:1] if quick else SOURCE_OHM:
                sir = ohm / abs(Network(length_km=km).z1_ohm)
                network = Network(sir=sir, far_sir=sir, length_km=km, model=model, duration_s=0.22)
                behind = Network(
                    sir=sir, far_sir=sir, length_km=km, model=model, behind_km=60.0, duration_s=0.22
                )
                own, name = relays(network), f"length-{model}-{km:g}-{ohm:g}"
                tags = {"model": model, "ohm": ohm}
                places = (0.3, 1.0) if quick else (0.0, 0.15, 0.3, 0.45, 0.6, 0.84, 0.88, 0.94, 1.0)
                found[name] = Sweep(network, own, {"at": places, **vary}, tags=tags)
                back = {"at": (0.5,) if quick else (0.2, 0.6, 0.95), **vary}
                found[f"{name}-behind"] = Sweep(behind, own, back, {"line": "XA", "at_pu": 0.5}, tags)
                if not quick:
                    further = {"line": "BC", "at_pu": 0.5}
                    found[f"{name}-beyond"] = Sweep(network, own, {"at": (0.1, 0.6), **vary}, further, tags)
    return found


def fill(report: Report, rows: Mapping[str, Rows]) -> None:
    every = Rows.joined([own.tagged(at=own["depth"]) for own in rows.values()])
    report.text.append(
        "Sources of 8 and 40 ohm at both ends, whatever the line is; bolted faults on the line, along 60 "
        "km behind it and along 80 km beyond. Travelling waves and resonance are in the models bergeron "
        "and pi, not in rl."
    )
    found = wrong(every)
    inside = every.pick((every["depth"] >= 0) & (every["depth"] <= INSIDE + 1e-9))
    report.tables += [
        wrong_table("Operations that must not be", found),
        _wrong_by_length(every),
        _times(inside),
    ]
    for relay in ("MHO", "QUAD"):
        curves = [
            c
            for k, model in enumerate(inside.values("model"))
            for c in times_over(inside.only(model=model), relay, "length_km", model, k)
        ]
        title = f"Operate time, {relay.lower()}, to {100 * INSIDE:g} % of the line: median, least to greatest"
        limits = [Limit("20 ms, to 150 km", 20.0), Limit("30 ms, longer", 30.0)]
        ticks = inside.values("length_km")
        report.diagrams.append(
            Diagram(title, "km", "ms", curves, limits, log_x=True, x_ticks=ticks, y_range=(0, 60))
        )
    report.checks += wrong_checks(found)
    for long, limit in WORST_MS.items():
        own = inside.pick((inside["length_km"] > LONG_KM) == long)
        told = "longer than 150 km" if long else "to 150 km"
        for relay in ("MHO", "QUAD"):
            what = f"{relay.lower()}, lines {told}, to {100 * INSIDE:g} %: worst"
            report.checks.append(Check(what, own.times(relay).at(1.0), limit, "ms"))


def _times(rows: Rows) -> Table:
    shown = [
        (model, f"{km:g}", *time_cells(rows.only(model=model, length_km=km).times("MHO")))
        for model in rows.values("model")
        for km in rows.values("length_km")
    ]
    return Table(
        f"Operate time, mho, to {100 * INSIDE:g} % of the line", ("model", ">km", *TIME_COLUMNS), shown
    )


def _wrong_by_length(rows: Rows) -> Table:
    shown = []
    for km in rows.values("length_km"):
        found = wrong(rows.only(length_km=km))
        shown.append((f"{km:g}", *(f"{w.operated} of {w.cases}" for w in found)))
    columns = (">km", *(f">{w.what}" for w in wrong(rows.only(length_km=rows.values("length_km")[0]))))
    return Table("The same by length", columns, shown)
