"""Operate time against the fault's position, a curve for each source impedance ratio."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from faultloop.study.diagram import Diagram, Limit
from faultloop.study.report import Check, Report, Table
from faultloop.study.suites.distance.makers import Claim
from faultloop.study.suites.distance.network import REACH, Network
from faultloop.study.suites.distance.rows import Rows, Times
from faultloop.study.suites.distance.section import (
    TIME_COLUMNS,
    angles,
    claims_table,
    time_cells,
    times_over,
)
from faultloop.study.suites.distance.sweep import TYPES, Sweep

TITLE = "Operate time against position"
RATIOS = {0.5: 100.0, 1.0: 100.0, 5.0: 100.0, 15.0: 25.0, 30.0: 25.0, 60.0: 25.0}
"""SIR, and the length of the line [km]: weak sources feed short ones."""
POSITIONS = (0, 10, 20, 30, 40, 50, 60, 70, 75, 80, 90, 95)
"""Percent of the reach."""
RELAYS = {"MHO": "mho", "QUAD": "quadrilateral", "UNTOLD": "mho, transformer unknown"}
"""The last is not told that the voltage transformer is ideal, and may wait behind a weak source."""
MEDIAN_MS, NEARLY_ALL_MS, WORST_MS = 10.0, 15.0, 20.0
"""Of bolted faults within 60 % of the line."""
CYCLE_MS = 20.0


def sweeps(quick: bool) -> dict[str, Sweep]:
    ratios = (1.0, 30.0) if quick else RATIOS
    positions = (0, 50, 75) if quick else POSITIONS
    found = {}
    for sir in ratios:
        network = Network(sir=sir, length_km=RATIOS[sir])
        found[f"operate-time-sir-{sir:g}"] = Sweep(
            network,
            {
                "MHO": network.settings(network.mho()),
                "QUAD": network.settings(network.quad()),
                "UNTOLD": network.settings(network.mho(), vt=None),
            },
            {
                "at": [REACH * p / 100 for p in positions],
                "type": ("AG", "BC") if quick else TYPES,
                "angle": angles(1 if quick else 8),
            },
        )
    return found


def fill(report: Report, rows: Mapping[str, Rows]) -> None:
    every = Rows.joined(rows.values())
    every = every.tagged(percent=np.round(100 * every["depth"] / REACH, 6))
    report.text.append(
        "Zone 1 of 80 % of the line without delay, a mho and a quadrilateral; bolted faults, ideal "
        "transformers. From the fault's inception to the trip at the breaker."
    )
    report.tables += [_by_ratio(every), _by_type(every), _makers(every)]
    for relay, name in RELAYS.items():
        curves = [
            curve
            for colour, sir in enumerate(every.values("sir"))
            for curve in times_over(every.only(sir=sir), relay, "percent", f"SIR {sir:g}", colour)
        ]
        limits = [Limit("one cycle", CYCLE_MS)]
        title = f"Operate time, {name}: median, and from least to greatest"
        position = "fault position [% of the reach]"
        report.diagrams.append(Diagram(title, position, "ms", curves, limits, y_range=(0, 60)))
    _check(report, every)


def _times(rows: Rows, relay: str, low: float, high: float) -> Times:
    """Of the faults between these parts of the reach [%]."""
    return rows.between("percent", low, high).times(relay)


def _by_ratio(rows: Rows) -> Table:
    shown = []
    for relay, name in RELAYS.items():
        for sir in rows.values("sir"):
            own = rows.only(sir=sir)
            for low, high in ((0, 75), (80, 95)):
                shown.append(
                    (name, f"{sir:g}", f"{low} to {high} %", *time_cells(_times(own, relay, low, high)))
                )
    return Table("By SIR and part of the reach", ("zone 1", ">SIR", "position", *TIME_COLUMNS), shown)


def _by_type(rows: Rows) -> Table:
    shown = []
    inside = rows.between("percent", 0, 75)
    for kind in [kind for kind in TYPES if kind in inside.values("type")]:
        own = inside.only(type=kind)
        named = own.pick(own.tripped("MHO"))
        right = sum(loop in _loops(kind) for loop in named["MHO.loop"])
        shown.append((kind, *time_cells(own.times("MHO")), f"{right} of {len(named)}"))
    columns = ("fault", *TIME_COLUMNS, ">loop named right")
    return Table("By type of fault, mho, to 75 % of the reach, every SIR", columns, shown)


def _loops(kind: str) -> tuple[str, ...]:
    """The loops in which a trip for this fault is right."""
    if kind.startswith("ABC"):
        return ("ABC",)
    phases = kind.removesuffix("G")
    return (kind,) if len(phases) == 1 else (phases,)


MAKERS = (
    (Claim("SEL-421-5", "maximum", "SIR 1, to 70 % of reach", "0.8 cycle: 16 ms"), 1.0, 70, (3,)),
    (Claim("MiCOM P442, P444", "minimum/typical/maximum", "SIR 5", "13/17/18 ms"), 5.0, 75, (0, 1, 3)),
    (Claim("MiCOM P442, P444", "minimum/typical/maximum", "SIR 30", "14/17.5/21 ms"), 30.0, 75, (0, 1, 3)),
    (Claim("REL670 ZMFPDIS", "typical", "", "16 ms"), 5.0, 75, (1,)),
    (Claim("RED650 ZMFPDIS", "typical", "", "24 ms"), 5.0, 75, (1,)),
    (Claim("7SA522", "minimum", "50 Hz", "17 ms"), 1.0, 75, (0,)),
    (Claim("7SA87", "minimum", "", "9 ms"), 1.0, 75, (0,)),
)
"""A claim, and which of ours stands beside it: SIR, percent of the reach, which of `Times.figures`."""


def _makers(rows: Rows) -> Table:
    shown = []
    for claim, sir, high, which in MAKERS:
        if sir in rows.values("sir"):
            figures = _times(rows.only(sir=sir), "MHO", 0, high).figures
            own = "/".join(f"{figures[k]:.1f}" if np.isfinite(figures[k]) else "-" for k in which)
            shown.append((claim, f"{own} ms", f"SIR {sir:g}, 0 to {high:g} % of the reach"))
    note = "Typical: our median. Ours is the mho. Makers' times include the output contact, ours do not."
    return claims_table("Makers' times beside ours", shown, note)


def _check(report: Report, rows: Rows) -> None:
    for relay, name in RELAYS.items():
        most = 3 if relay == "UNTOLD" else 30
        times = rows.between("depth", 0, 0.6).between("sir", 0.1, most).times(relay)
        what = f"{name}, bolted, to 60 % of the line, SIR to {most}"
        report.checks += [
            Check(f"{what}: median", times.at(0.5), MEDIAN_MS, "ms"),
            Check(f"{what}: 95 %", times.at(0.95), NEARLY_ALL_MS, "ms"),
            Check(f"{what}: worst", times.at(1.0), WORST_MS, "ms"),
        ]
        for sir, part in () if relay == "UNTOLD" else ((5.0, 100.0), (30.0, 99.0)):
            own = rows.only(sir=sir)
            if len(own):
                within = _times(own, relay, 0, 75).within(CYCLE_MS)
                report.checks.append(
                    Check(
                        f"{name}: within a cycle to 75 % of the reach, SIR {sir:g}", within, part, "%", True
                    )
                )
