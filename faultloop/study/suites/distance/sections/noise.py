"""White noise on every sample, and converters of few bits."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from faultloop.study.diagram import Diagram, Limit
from faultloop.study.report import Check, Report, Table
from faultloop.study.suites.distance.network import BASE_KV, Network
from faultloop.study.suites.distance.rows import Rows
from faultloop.study.suites.distance.section import TIME_COLUMNS, angles, time_cells, times_over
from faultloop.study.suites.distance.security import quiet, relays, wrong, wrong_checks
from faultloop.study.suites.distance.sweep import Sweep

TITLE = "Noise and resolution"
RATED_V = BASE_KV * 1e3 * (2 / 3) ** 0.5
RATED_A = 1000.0 * 2**0.5
FULL_SCALE_A = 40 * RATED_A
PARTS = (0.0, 0.1, 0.3, 1.0)
"""RMS of the noise, percent of the rated peaks (220 kV, 1 kA)."""
BITS = (12, 14, 16)
RATIOS = {1.0: 100.0, 30.0: 25.0}
"""SIR, and the length of the line [km]."""
INSIDE = 0.6
HELD_TO = 0.1
"""Percent of noise up to which nothing wrong is allowed; beyond it is told."""


def front_ends(quick: bool) -> dict[str, dict[str, Any]]:
    """By name; the number before the blank is the noise."""
    found = {
        f"{part:g} %": {"voltage_noise_v": part / 100 * RATED_V, "current_noise_a": part / 100 * RATED_A}
        for part in ((0.0, 0.1) if quick else PARTS)
    }
    for bits in () if quick else BITS:
        found[f"{bits} bits"] = {"adc_bits": bits, "current_full_scale_a": FULL_SCALE_A}
    return found


def sweeps(quick: bool) -> dict[str, Sweep]:
    vary = {"type": ("BC",) if quick else ("AG", "BC", "ABC"), "angle": angles(1 if quick else 6)}
    found = {}
    for sir in (1.0,) if quick else RATIOS:
        for name, front_end in front_ends(quick).items():
            network = Network(sir=sir, length_km=RATIOS[sir], front_end=front_end)
            own, tags = relays(network), {"noise": name}
            title = f"noise-{name.replace(' ', '-').replace('%', 'percent')}-{sir:g}"
            places = (0.4, 1.0) if quick else (0.0, 0.2, 0.4, 0.6, 0.84, 0.9, 1.0)
            found[title] = Sweep(network, own, {"at": places, **vary}, tags=tags)
            found[f"{title}-behind"] = Sweep(network, own, vary, {"bus": "A"}, tags)
            seeds = [1] if quick else [1, 2, 3, 4, 5, 6]
            found[f"{title}-none"] = Sweep(network, own, {"scenario.seed": seeds}, None, tags)
    return found


def fill(report: Report, rows: Mapping[str, Rows]) -> None:
    every = Rows.joined(rows.values())
    report.text.append(
        "White noise on each sample, its RMS in percent of the rated peaks (220 kV, 1 kA), or a converter"
        " of so many bits with a full scale of twice the voltage and forty times the current; SIR 1 on "
        "100 km and 30 on 25 km, where the fault current is 0.42 kA."
    )
    shown = []
    for name in _names(every):
        own = every.only(noise=name)
        faults, none = own.pick(np.isfinite(own["depth"])), own.pick(np.isnan(own["depth"]))
        found = [*wrong(faults), *quiet(none)]
        shown += [(name, w.what, w.operated, w.cases) for w in found]
        if name.endswith("%") and float(name.split()[0]) <= HELD_TO:
            report.checks += wrong_checks([w._replace(what=f"noise {name}: {w.what}") for w in found])
    report.tables.append(Table("Operations that must not be", ("noise", "", ">operated", ">of"), shown))
    faults = every.pick(np.isfinite(every["depth"]))
    inside = faults.pick((faults["depth"] >= 0) & (faults["depth"] <= INSIDE))
    report.tables.append(_times(inside))
    names = _names(inside)
    placed = inside.tagged(number=np.array([names.index(n) for n in inside["noise"]]))
    curves = [
        c
        for k, sir in enumerate(placed.values("sir"))
        for c in times_over(placed.only(sir=sir), "MHO", "number", f"SIR {sir:g}", k)
    ]
    title = f"Operate time, mho, to {100 * INSIDE:g} % of the line"
    cycle, ticks = [Limit("one cycle", 20.0)], range(len(names))
    report.diagrams.append(
        Diagram(title, "noise", "ms", curves, cycle, x_ticks=ticks, x_names=names, y_range=(0, 60))
    )
    quietest = inside.pick(np.isin(inside["noise"], [n for n in names if n in ("0 %", "0.1 %")]))
    what = f"mho, noise to {HELD_TO:g} %, to {100 * INSIDE:g} % of the line: not operated"
    report.checks.append(Check.none_of(what, quietest.times("MHO").missed, len(quietest)))


def _names(rows: Rows) -> list[str]:
    order = [*front_ends(False)]
    return sorted(rows.values("noise"), key=order.index)


def _times(rows: Rows) -> Table:
    shown = [
        (name, f"{sir:g}", *time_cells(rows.only(noise=name, sir=sir).times("MHO")))
        for name in _names(rows)
        for sir in rows.values("sir")
    ]
    return Table(
        f"Operate time, mho, to {100 * INSIDE:g} % of the line", ("noise", ">SIR", *TIME_COLUMNS), shown
    )
