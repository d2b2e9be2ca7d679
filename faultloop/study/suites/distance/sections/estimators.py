"""Every estimator that a relay takes, side by side on the same faults."""

from __future__ import annotations

from collections.abc import Mapping

from faultloop.relay.estimators import estimator_methods
from faultloop.relay.estimators.protection import refusal
from faultloop.study.diagram import Curve, Diagram, Limit
from faultloop.study.report import Check, Report, Table
from faultloop.study.suites.distance.network import Network
from faultloop.study.suites.distance.rows import Mask, Rows, Times
from faultloop.study.suites.distance.section import TIME_COLUMNS, angles, time_cells
from faultloop.study.suites.distance.sweep import Sweep

TITLE = "Estimators side by side"
RATIOS = {1.0: 100.0, 15.0: 25.0}
"""SIR, and the length of the line [km]."""
INSIDE = (0.0, 0.2, 0.4, 0.6)
FAR = (0.84, 0.9, 1.0)
QUICK = ("kalman-bank", "fourier")


def methods(quick: bool) -> tuple[dict[str, str], dict[str, str]]:
    """Those that a relay takes, by the name of a relay that has it; and the others with why not."""
    taken, refused = {}, {}
    for method in QUICK if quick else estimator_methods():
        why = refusal(method)
        if why is None:
            taken[method.replace("-", "_")] = method
        else:
            refused[method] = why
    return taken, refused


def sweeps(quick: bool) -> dict[str, Sweep]:
    vary = {"type": ("BC",) if quick else ("AG", "BC", "ABC"), "angle": angles(1 if quick else 4)}
    found = {}
    for sir in (1.0,) if quick else RATIOS:
        network = Network(sir=sir, length_km=RATIOS[sir])
        behind = Network(sir=sir, length_km=RATIOS[sir], behind_km=60.0)
        own = {
            relay: network.settings(network.mho(), estimator={"method": method})
            for relay, method in methods(quick)[0].items()
        }
        places = (0.4, 1.0) if quick else (*INSIDE, *FAR)
        found[f"estimators-{sir:g}"] = Sweep(network, own, {"at": places, **vary})
        found[f"estimators-{sir:g}-bus"] = Sweep(network, own, vary, {"bus": "A"})
        if not quick:
            found[f"estimators-{sir:g}-beyond"] = Sweep(
                network, own, {"at": (0.2,), **vary}, {"line": "BC", "at_pu": 0.2}
            )
            found[f"estimators-{sir:g}-behind"] = Sweep(
                behind, own, {"at": (0.2, 0.8), **vary}, {"line": "XA", "at_pu": 0.5}
            )
    return found


def fill(report: Report, rows: Mapping[str, Rows]) -> None:
    every = Rows.joined([own.tagged(at=own["depth"]) for own in rows.values()])
    quick = "kalman_bank.tripped" in every and "cosine.tripped" not in every
    taken, refused = methods(quick)
    report.text.append(
        "A mho of 80 % without delay behind each estimator with its default parameters, all on the same "
        "samples; SIR 1 on 100 km and 15 on 25 km. Times are those of the decision: so many relays at "
        "once would wait for the bus."
    )
    if refused:
        report.tables.append(Table("Refused for protection", ("estimator", "why"), list(refused.items())))
    inside = every.between("depth", 0, INSIDE[-1])
    report.tables.append(_table(every, inside, taken))
    curves = []
    order = sorted(taken, key=lambda relay: _times(inside, relay).at(0.5))
    for colour, relay in enumerate(order):
        x = inside.values("depth")
        y = [_times(inside.only(depth=place), relay).at(0.5) for place in x]
        curves.append(Curve(taken[relay], [100 * place for place in x], y, colour=colour))
    title = "Median time of the decision"
    cycle = [Limit("one cycle", 20.0)]
    report.diagrams.append(Diagram(title, "% of the line", "ms", curves, cycle, y_range=(0, 60)))
    for relay, method in taken.items():
        for name, mask in _places(every).items():
            own = every.pick(mask)
            what = f"{method}: zone 1 for a fault {name}: operated"
            report.checks.append(Check.none_of(what, own.tripped(relay).sum(), len(own)))
        missed = _times(inside, relay).missed
        report.checks.append(
            Check.none_of(f"{method}: to 60 % of the line: not operated", missed, len(inside))
        )


def _places(rows: Rows) -> dict[str, Mask]:
    depth = rows["depth"]
    return {"behind": depth < 0, "at 84 % or beyond": depth >= FAR[0] - 1e-9}


def _times(rows: Rows, relay: str) -> Times:
    return rows.times(relay, until="decided_ns")


def _table(every: Rows, inside: Rows, taken: Mapping[str, str]) -> Table:
    shown = []
    for relay, method in sorted(taken.items(), key=lambda item: _times(inside, item[0]).at(0.5)):
        own = [
            f"{int(every.pick(mask).tripped(relay).sum())} of {int(mask.sum())}"
            for mask in _places(every).values()
        ]
        right = inside.pick(inside.tripped(relay))
        loops = int((right[f"{relay}.loop"] == right["type"]).sum())
        shown.append((method, *time_cells(_times(inside, relay)), *own, f"{loops} of {len(right)}"))
    columns = ("estimator", *TIME_COLUMNS, *(f">{name}" for name in _places(every)), ">loop named right")
    note = "Times to 60 % of the line; the two columns of places count operations, where none may be."
    return Table("Zone 1 of 80 %, mho", columns, shown, note)
