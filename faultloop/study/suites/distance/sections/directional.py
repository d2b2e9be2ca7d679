"""Direction: close-in faults on either side, faults behind at any distance, with load either way."""

from __future__ import annotations

from collections.abc import Mapping

from faultloop.study.diagram import Diagram, Limit
from faultloop.study.report import Check, Report, Table
from faultloop.study.suites.distance.network import Network
from faultloop.study.suites.distance.rows import Rows
from faultloop.study.suites.distance.section import TIME_COLUMNS, angles, time_cells, times_over
from faultloop.study.suites.distance.security import ZONES, relays, wrong, wrong_checks, wrong_table
from faultloop.study.suites.distance.sweep import TYPES, Sweep

TITLE = "Direction and close-in faults"
RATIOS = (0.2, 1.0, 5.0, 15.0)
LOADS_DEG = (-30.0, 8.0, 30.0)
SLOWEST_MS = 20.0
"""Of a close-in fault ahead."""


def sweeps(quick: bool) -> dict[str, Sweep]:
    types = ("AG", "BC", "ABC") if quick else TYPES
    vary = {"type": types, "angle": angles(1 if quick else 4)}
    found = {}
    for sir in (1.0,) if quick else RATIOS:
        for load in (-30.0,) if quick else LOADS_DEG:
            tags = {"load_deg": load}
            at_the_bus = Network(sir=sir, angle_deg=load)
            own = relays(at_the_bus)
            name = f"sir-{sir:g}-load-{load:g}"
            bus = {"bus": "A"}
            found[f"reverse-bus-{name}"] = Sweep(at_the_bus, own, vary, bus, tags)
            ahead = (0.0,) if quick else (0.0, 0.01, 0.03)
            found[f"close-in-{name}"] = Sweep(at_the_bus, own, {"at": ahead, **vary}, tags=tags)
            behind = Network(sir=sir, angle_deg=load, behind_km=60.0)
            places = (0.5,) if quick else (0.02, 0.3, 0.6, 0.9, 0.99)
            on_the_line = {"line": "XA", "at_pu": 0.5}
            found[f"reverse-line-{name}"] = Sweep(behind, own, {"at": places, **vary}, on_the_line, tags)
    return found


def fill(report: Report, rows: Mapping[str, Rows]) -> None:
    every = Rows.joined([own.tagged(at=own["depth"]) for own in rows.values()])
    report.text.append(
        "Bolted faults at bus A, along 60 km behind it, and within 3 % of A - B (a fault at 0 lies on the"
        f" line's side of the current transformer); load of {', '.join(f'{x:g}' for x in LOADS_DEG)} "
        "degrees. Four relays with one zone each, without delay."
    )
    found = wrong(every)
    ahead, behind = every.pick(every["depth"] >= 0), every.pick(every["depth"] < 0)
    report.tables += [wrong_table("Operations that must not be", found), _close_in(ahead), _reverse(behind)]
    curves = [
        curve
        for colour, (relay, name) in enumerate(ZONES.items())
        for curve in times_over(behind if relay == "REV" else ahead, relay, "sir", name, colour)
    ]
    title = "Close-in faults; the reverse zone's behind: median, and from least to greatest"
    limits, ticks = [Limit("one cycle", 20.0)], every.values("sir")
    report.diagrams.append(
        Diagram(title, "SIR", "ms", curves, limits, log_x=True, x_ticks=ticks, y_range=(0, 40))
    )
    report.checks += wrong_checks(found)
    for relay in ("MHO", "QUAD", "FWD"):
        times = ahead.times(relay)
        report.checks += [
            Check.none_of(f"{ZONES[relay]}, close-in ahead: not operated", times.missed, len(ahead)),
            Check(
                f"{ZONES[relay]}, close-in ahead: worst", times.at(1.0), SLOWEST_MS, "ms", cases=len(ahead)
            ),
        ]
    near = behind.pick(behind["depth"] > -0.3)
    missed = near.times("REV").missed
    report.checks.append(Check.none_of("reverse zone, within 30 % behind: not operated", missed, len(near)))


def _close_in(rows: Rows) -> Table:
    shown = [
        (ZONES[relay], f"{sir:g}", *time_cells(rows.only(sir=sir).times(relay)))
        for relay in ("MHO", "QUAD", "FWD")
        for sir in rows.values("sir")
    ]
    return Table("Close-in faults ahead, to 3 % of the line", ("zone", ">SIR", *TIME_COLUMNS), shown)


def _reverse(rows: Rows) -> Table:
    shown = []
    for place in rows.values("depth"):
        own = rows.only(depth=place)
        shown.append((f"{100 * place:.0f} %", *time_cells(own.times("REV"))))
    note = "The far source feeds these faults through A - B; the reverse zone reaches to -50 % of the line."
    return Table("Reverse zone, faults behind", (">place", *TIME_COLUMNS), shown, note)
