"""Energising a line, without a fault and onto one; load steps."""

from __future__ import annotations

from collections.abc import Mapping

from faultloop.study.diagram import Diagram, Limit
from faultloop.study.report import Check, Report, Table
from faultloop.study.suites.distance.network import Network
from faultloop.study.suites.distance.rows import Rows
from faultloop.study.suites.distance.section import TIME_COLUMNS, time_cells, times_over
from faultloop.study.suites.distance.security import quiet, relays, wrong_checks, wrong_table
from faultloop.study.suites.distance.sweep import TYPES, Sweep

TITLE = "Energising, switch onto fault, load steps"
OPENS_S, FAULTED_S, CLOSES_S = 0.02, 0.15, 0.36
"""The line has been in service; it is opened, and closed again when it is a dead one: PSOF's `dead_ms` is 200
ms, after five cycles in which the estimates die away.  To a relay that has never seen a voltage three phases
without one are no fault."""
AT = "switching.S1.at_s"
DISCHARGE_MW = 2.0
LENGTHS = (20.0, 100.0, 300.0)
PLACES = (0.0, 0.1, 0.3, 0.5, 0.6)
RATIOS = (1.0, 10.0)
LOADS = ((100.0, 0.0), (400.0, 100.0), (700.0, 200.0), (300.0, -100.0))
"""MW, Mvar."""
SLOWEST_MS = 100.0
"""Of switching onto a fault within 60 % of the line; makers' timers alone come to 20 to 60 ms."""


def sweeps(quick: bool) -> dict[str, Sweep]:
    instants = [CLOSES_S + 0.01 * k / 4 for k in range(1 if quick else 4)]
    found = {}
    for side in ("line", "bus"):
        for km in (100.0,) if quick else LENGTHS:
            for sir in (1.0,) if quick else RATIOS:
                network = _energised(sir, km, side)
                own, tags, name = relays(network), {"side": side}, f"energise-{side}-{km:g}-{sir:g}"
                onto = {
                    AT: instants,
                    "at": (0.3,) if quick else PLACES,
                    "type": ("AG", "ABC") if quick else TYPES,
                }
                fault = {"line": "AB", "at_pu": 0.5, "start_s": FAULTED_S}
                if km == 100.0:
                    found[f"{name}-onto"] = Sweep(network, own, onto, fault, tags | {"kind": "onto a fault"})
                found[name] = Sweep(network, own, {AT: instants}, None, tags | {"kind": "energising"})
    for mw, mvar in LOADS[:1] if quick else LOADS:
        for operation in ("close", "open"):
            network = _loaded(mw, mvar, operation)
            tags = {"side": "bus", "kind": "load step"}
            vary = {
                AT: [t - 0.1 for t in instants],
                "source.SA.angle_deg": (8.0,) if quick else (-30.0, 8.0, 30.0),
            }
            found[f"load-{mw:g}-{mvar:g}-{operation}"] = Sweep(network, relays(network), vary, None, tags)
    return found


def _energised(sir: float, km: float, side: str) -> Network:
    """A line that is opened and closed at A; at its far end is a load that its charge leaves through."""
    return Network(
        sir=sir, length_km=km, far_sir=None, beyond_km=0.0, angle_deg=0.0, duration_s=CLOSES_S + 0.14,
        relay={"voltage_at": side},
        more={
            "load": [{"name": "L", "bus": "B", "mw": DISCHARGE_MW, "mvar": 0.0}],
            "switching": [
                {"name": "S1", "breaker": "QA", "operation": "close", "at_s": CLOSES_S},
                {"name": "S0", "breaker": "QA", "operation": "open", "at_s": OPENS_S},
            ]
        },
    )  # fmt: skip


def _loaded(mw: float, mvar: float, operation: str) -> Network:
    """A load beyond B that is switched."""
    line = {"name": "BD", "from": "B", "to": "D", "length_km": 10.0, "model": "rl"} | {
        "r1_ohm_per_km": 0.06, "x1_ohm_per_km": 0.4, "r0_ohm_per_km": 0.24, "x0_ohm_per_km": 1.2,
    }  # fmt: skip
    breaker = {"name": "QD", "line": "BD", "end": "from", "closed": operation == "open"}
    return Network(
        duration_s=0.3,
        more={
            "line": [line],
            "breaker": [breaker],
            "load": [{"name": "L", "bus": "D", "mw": mw, "mvar": mvar}],
            "switching": [{"name": "S1", "breaker": "QD", "operation": operation, "at_s": CLOSES_S}],
        },
    )


def fill(report: Report, rows: Mapping[str, Rows]) -> None:
    every = Rows.joined([_with_at(own) for own in rows.values()])
    every = every.tagged(closes_ns=every[AT] * 1e9)
    onto, none = every.only(kind="onto a fault"), every.pick(every["kind"] != "onto a fault")
    report.text.append(
        "A line that is open at B is opened at A and, dead for a quarter of a second, closed again, at four "
        "points on wave, without a fault "
        "and onto a bolted one; the voltage is measured on the line's side, where a dead line has none, "
        "or at the bus. Loads beyond B are switched on and off. Times count from the closing, whichever "
        "function trips: zone 1, or PSOF."
    )
    found = [w for kind in none.values("kind") for w in quiet(none.only(kind=kind), kind)]
    report.tables += [wrong_table("Operations that must not be", found), _onto(onto)]
    curves = [
        c
        for k, side in enumerate(onto.values("side"))
        for c in times_over(onto.only(side=side), "MHO", "depth", f"voltage at {side}", k, "closes_ns")
    ]
    title = "Switch onto fault, zone 1 mho or PSOF: median, and from least to greatest"
    limits = [Limit(f"{SLOWEST_MS:g} ms", SLOWEST_MS)]
    report.diagrams.append(
        Diagram(
            title,
            "fault's place, per unit of the line",
            "ms from the closing",
            curves,
            limits,
            y_range=(0, 120),
        )
    )
    report.checks += wrong_checks(found)
    for side in onto.values("side"):
        own = onto.only(side=side)
        times = own.times("MHO", "closes_ns")
        report.checks += [
            Check.none_of(f"onto a fault, voltage at {side}: not operated", times.missed, len(own)),
            Check(f"onto a fault, voltage at {side}: longest", times.at(1.0), SLOWEST_MS, "ms"),
        ]


def _with_at(rows: Rows) -> Rows:
    return rows if "at" in rows else rows.tagged(at=float("nan"))


def _onto(rows: Rows) -> Table:
    shown = []
    for side in rows.values("side"):
        for sir in rows.values("sir"):
            own = rows.only(side=side, sir=sir)
            by = own["MHO.function"][own.tripped("MHO")]
            names = ", ".join(f"{name} {int((by == name).sum())}" for name in sorted(set(by.tolist())))
            shown.append((side, f"{sir:g}", *time_cells(own.times("MHO", "closes_ns")), names or "-"))
    columns = ("voltage at", ">SIR", *TIME_COLUMNS, "by")
    return Table("Switch onto fault, to 60 % of the line", columns, shown)
