"""Frequency off the nominal one: operate time, reach, direction, and no operation without a fault."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from faultloop.study.diagram import Curve, Diagram, Limit
from faultloop.study.report import Check, Report, Table
from faultloop.study.suites.distance.network import REACH, Network
from faultloop.study.suites.distance.rows import Rows
from faultloop.study.suites.distance.section import TIME_COLUMNS, angles, time_cells, times_over
from faultloop.study.suites.distance.security import (
    quiet,
    relays,
    wrong,
    wrong_checks,
    wrong_table,
)
from faultloop.study.suites.distance.sweep import Sweep

TITLE = "Frequency"
DEVIATIONS = (-0.1, -0.06, -0.04, -0.02, -0.01, 0.0, 0.01, 0.02, 0.04, 0.06, 0.1)
"""Of the nominal frequency: 45 to 55 Hz, 54 to 66 Hz."""
INSIDE = (0.3, 0.5, 0.6)
NEAR_REACH = (0.68, 0.7, 0.72, 0.74, 0.76, 0.78, 0.82, 0.84, 0.86, 0.88, 0.9, 0.92)
"""Of the line; zone 1 reaches to 0.8."""


def sweeps(quick: bool) -> dict[str, Sweep]:
    vary = {"type": ("BC",) if quick else ("AG", "BC", "ABC"), "angle": angles(1 if quick else 2)}
    found = {}
    for nominal in (50,) if quick else (50, 60):
        for deviation in (-0.1, 0.1) if quick else DEVIATIONS:
            hz = nominal * (1 + deviation)
            network, tags = Network(frequency_hz=nominal, source_hz=hz), {"hz": hz}
            own, name = relays(network), f"frequency-{nominal}-{hz:g}"
            places = (0.3, 1.0) if quick else (*INSIDE, *NEAR_REACH, 1.0)
            found[name] = Sweep(network, own, {"at": places, **vary}, tags=tags)
            found[f"{name}-behind"] = Sweep(network, own, vary, {"bus": "A"}, tags)
            found[f"{name}-none"] = Sweep(
                network, own, {"source.SA.angle_deg": (-30.0,) if quick else (-30.0, 0.0, 30.0)}, None, tags
            )
    return found


def fill(report: Report, rows: Mapping[str, Rows]) -> None:
    every = Rows.joined(rows.values())
    faults, none = every.pick(np.isfinite(every["depth"])), every.pick(np.isnan(every["depth"]))
    inside = faults.pick((faults["depth"] >= 0) & (faults["depth"] <= INSIDE[-1] + 1e-9))
    report.text.append(
        "All sources at the frequency told; the relay is set to the nominal one, its reach in ohm at the "
        "nominal frequency. A line's reactance is proportional to frequency, so a fixed reach in ohm "
        "comes to 80 % f0/f of the line: the diagram has that curve beside what was measured."
    )
    found = [*wrong(faults.pick(~_close_to_reach(faults))), *quiet(none)]
    report.tables += [wrong_table("Operations that must not be", found), _times(inside), _reach(faults)]
    for nominal in inside.values("frequency_hz"):
        own = inside.only(frequency_hz=nominal)
        curves = [c for k, r in enumerate(("MHO", "QUAD")) for c in times_over(own, r, "hz", r.lower(), k)]
        title = f"Operate time at {nominal:g} Hz nominal, to {100 * INSIDE[-1]:g} % of the line"
        cycle = [Limit("one nominal cycle", 1e3 / nominal)]
        report.diagrams.append(Diagram(title, "Hz", "ms", curves, cycle, y_range=(0, 40)))
    report.diagrams.append(_reach_diagram(faults))
    report.checks += wrong_checks(found)
    for relay in ("MHO", "QUAD"):
        what = f"{relay.lower()}, to {100 * INSIDE[-1]:g} % of the line: not operated"
        report.checks.append(Check.none_of(what, inside.times(relay).missed, len(inside)))


def _close_to_reach(rows: Rows) -> np.ndarray:
    """Whether a fault is so near the reach that frequency alone may put it on the other side."""
    return (rows["depth"] >= NEAR_REACH[0]) & (rows["depth"] <= NEAR_REACH[-1] + 1e-9)


def _times(rows: Rows) -> Table:
    shown = []
    for nominal in rows.values("frequency_hz"):
        own = rows.only(frequency_hz=nominal)
        for hz in own.values("hz"):
            shown.append((f"{nominal:g}", f"{hz:g}", *time_cells(own.only(hz=hz).times("MHO"))))
    title = f"Operate time, mho, to {100 * INSIDE[-1]:g} % of the line"
    return Table(title, (">nominal Hz", ">Hz", *TIME_COLUMNS), shown)


def _measured(rows: Rows, relay: str) -> tuple[float, float]:
    """Farthest fault up to which all operated, and the nearest beyond which none did, of the line."""
    places = [p for p in rows.values("depth") if p >= NEAR_REACH[0]]
    parts = [rows.only(depth=p).tripped(relay) for p in places]
    all_to = max((p for p, t in zip(places, parts, strict=True) if t.all()), default=float("nan"))
    last = max((p for p, t in zip(places, parts, strict=True) if t.any()), default=0.0)
    none_from = min((p for p in places if p > last), default=float("nan"))
    return all_to, none_from


def _reach(rows: Rows) -> Table:
    shown = []
    ahead = rows.pick(rows["depth"] >= 0)
    for nominal in ahead.values("frequency_hz"):
        for hz in ahead.only(frequency_hz=nominal).values("hz"):
            own = ahead.only(frequency_hz=nominal, hz=hz)
            cells = [f"{100 * value:.0f}" for relay in ("MHO", "QUAD") for value in _measured(own, relay)]
            shown.append((f"{nominal:g}", f"{hz:g}", f"{100 * REACH * nominal / hz:.1f}", *cells))
    columns = (
        ">nominal Hz",
        ">Hz",
        ">80 % f0/f",
        ">mho: all to",
        ">none from",
        ">quadrilateral: all to",
        ">none from",
    )
    return Table("Reach, percent of the line, steps of 2 %, every type and angle", columns, shown)


def _reach_diagram(rows: Rows) -> Diagram:
    ahead = rows.pick((rows["depth"] >= 0) & (rows["frequency_hz"] == rows.values("frequency_hz")[0]))
    x = ahead.values("hz")
    nominal = float(ahead["frequency_hz"][0])
    pairs = np.array([_measured(ahead.only(hz=hz), "MHO") for hz in x])
    curves = [
        Curve("80 % f0/f", x, [100 * REACH * nominal / hz for hz in x], colour=7, dash="dash"),
        Curve("mho: every fault operated for to", x, 100 * pairs[:, 0], colour=0),
        Curve("mho: none operated for from", x, 100 * pairs[:, 1], colour=1),
    ]
    limits = [Limit("reach at nominal frequency", 80.0)]
    return Diagram("Reach against frequency", "Hz", "% of the line", curves, limits, y_range=(60, 105))
