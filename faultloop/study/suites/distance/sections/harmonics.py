"""Harmonics in voltage and current, before and during the fault."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

import numpy as np

from faultloop.loop.case import Cases
from faultloop.loop.recording import MemorySink
from faultloop.study.diagram import Diagram, Limit
from faultloop.study.report import Check, Report, Table
from faultloop.study.suites.distance.network import FAULT_S, Network
from faultloop.study.suites.distance.rows import Rows
from faultloop.study.suites.distance.section import TIME_COLUMNS, angles, time_cells, times_over
from faultloop.study.suites.distance.security import quiet, relays, wrong, wrong_checks, wrong_table
from faultloop.study.suites.distance.sweep import Sweep

TITLE = "Harmonics"
ORDERS = {0: 0.0, 2: 0.05, 3: 0.10, 5: 0.10, 7: 0.05, 11: 0.035, 13: 0.03}
"""Of the voltage at A before the fault, about; 0: none, to compare."""
INSIDE = 0.6
FEEDER_SIR = 20.0
"""Impedance behind which a harmonic is fed into bus A, of the line's at system frequency."""


def sweeps(quick: bool) -> dict[str, Sweep]:
    vary = {"type": ("AG", "BC") if quick else ("AG", "BC", "CAG", "ABC"), "angle": angles(1 if quick else 4)}
    found = {}
    for order in (0, 3) if quick else ORDERS:
        network, tags = _network(order), {"order": order}
        own = relays(network)
        places = (0.4, 1.0) if quick else (0.0, 0.2, 0.4, 0.6, 0.84, 0.9, 1.0)
        found[f"harmonic-{order}"] = Sweep(network, own, {"at": places, **vary}, tags=tags)
        found[f"harmonic-{order}-behind"] = Sweep(network, own, vary, {"bus": "A"}, tags)
        loads = (8.0,) if quick else (-30.0, 0.0, 30.0)
        found[f"harmonic-{order}-none"] = Sweep(network, own, {"source.SA.angle_deg": loads}, None, tags)
    return found


def _network(order: int) -> Network:
    """With a source of the harmonic behind a large impedance at bus A, as a converter's current."""
    plain = Network()
    if not order:
        return plain
    # At bus A about half of the source's impedance is left beside that of line and far source.
    left = order * abs(plain.z1_ohm) * plain.sir * 0.7
    behind = order * FEEDER_SIR * abs(plain.z1_ohm)
    z = [0.0, FEEDER_SIR * abs(plain.z1_ohm)]
    feeder = {
        "name": "H", "bus": "A", "voltage_pu": ORDERS[order] * (behind + left) / left,
        "frequency_hz": 50.0 * order, "z1_ohm": z, "z0_ohm": z,
    }  # fmt: skip
    return Network(more={"source": [feeder]})


@cache
def content(order: int) -> tuple[float, float]:
    """The harmonic's part of the fundamental of voltage and current at the relay before the fault [%]."""
    sweep = sweeps(order in (0, 3))[f"harmonic-{order}-none"]
    case = sweep.plan("content").case(0)
    sink = MemorySink()
    Cases().prepare(case.scenario, case.settings).run([sink])
    rows = sink.array("MHO", "samples")
    count = int(FAULT_S * 4800) // 96 * 96
    found = []
    for name in ("va", "ia"):
        spectrum = np.abs(np.fft.rfft(rows[name][:count]))
        cycles = count // 96
        found.append(100.0 * spectrum[cycles * order] / spectrum[cycles] if order else 0.0)
    return found[0], found[1]


def fill(report: Report, rows: Mapping[str, Rows]) -> None:
    every = Rows.joined(rows.values())
    faults, none = every.pick(np.isfinite(every["depth"])), every.pick(np.isnan(every["depth"]))
    inside = faults.pick((faults["depth"] >= 0) & (faults["depth"] <= INSIDE))
    report.text.append(
        "One harmonic at a time, fed into bus A from behind a large reactance, before and during the "
        "fault, with positive sequence; SIR 1. What of it is in the relay's voltage and current before "
        "the fault is measured."
    )
    found = [*wrong(faults), *quiet(none)]
    report.tables += [wrong_table("Operations that must not be", found), _times(inside)]
    curves = [c for k, r in enumerate(("MHO", "QUAD")) for c in times_over(inside, r, "order", r.lower(), k)]
    title = f"Operate time against the order of the harmonic, to {100 * INSIDE:g} % of the line"
    ticks = inside.values("order")
    names = ["none" if not order else f"{order}" for order in ticks]
    cycle = [Limit("one cycle", 20.0)]
    report.diagrams.append(
        Diagram(title, "harmonic", "ms", curves, cycle, x_ticks=ticks, x_names=names, y_range=(0, 40))
    )
    report.checks += wrong_checks(found)
    for relay in ("MHO", "QUAD"):
        what = f"{relay.lower()}, to {100 * INSIDE:g} % of the line: not operated"
        report.checks.append(Check.none_of(what, inside.times(relay).missed, len(inside)))


def _times(rows: Rows) -> Table:
    shown = []
    for order in rows.values("order"):
        voltage, current = content(int(order))
        cells = time_cells(rows.only(order=order).times("MHO"))
        shown.append((f"{order}" if order else "none", f"{voltage:.1f}", f"{current:.1f}", *cells))
    columns = (">harmonic", ">of voltage %", ">of current %", *TIME_COLUMNS)
    return Table(f"Operate time, mho, to {100 * INSIDE:g} % of the line", columns, shown)
