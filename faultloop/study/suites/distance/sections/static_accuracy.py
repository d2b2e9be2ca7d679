"""Static accuracy: the characteristic by a ramp of shots at its points, and by a pseudo-continuous ramp."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from faultloop.study.diagram import Curve, Diagram, Limit
from faultloop.study.report import Check, Report, Table
from faultloop.study.suites.distance.closed_form import resistance_at
from faultloop.study.suites.distance.makers import STATIC
from faultloop.study.suites.distance.network import REACH, Network
from faultloop.study.suites.distance.ramp import Ramp, ramp
from faultloop.study.suites.distance.rows import Rows
from faultloop.study.suites.distance.section import claims_table
from faultloop.study.suites.distance.security import relays
from faultloop.study.suites.distance.sweep import Sweep

TITLE = "Static accuracy"
RATIOS = (0.5, 1.0, 5.0, 15.0, 30.0, 60.0)
TYPES = ("AG", "BC", "ABC")
STEP, WIDTH = 0.5, 8.0
"""Of the ramp of shots, and how far it goes to either side [% of the boundary]."""
PLACES = (0.0, 0.16, 0.32, 0.48, 0.64)
"""Of the points off the angle, per unit of the line."""
OFF_ANGLE_RATIOS = (1.0, 15.0)
QUAD_OHM = {"AG": 30.0, "BC": 20.0, "ABC": 20.0}
"""Resistive reach of the quadrilateral, half and three quarters of the line's reactance."""
NO_OFFSET_DEG = 81.5
"""Point on wave at which the current begins without an offset, at the line's angle."""
ON_ANGLE_LIMIT = {30.0: 3.0, 60.0: 5.0}
"""SIR up to which the error is at most so much: SEL-421's claim."""
OFF_ANGLE_LIMIT = 10.0
RAMP_LIMIT, RESET_LIMIT = 5.0, 110.0
RELAYS = {"MHO": "mho", "QUAD": "quadrilateral"}
STATIC_MS = 100.0
"""Delay of the zones that are judged as static: only what stays inside so long operates."""
AT_ONCE = "-0"
"""Ending of the relays with the same zones without delay: told beside them."""


def _network(sir: float) -> Network:
    """Fed from A alone, without load, of R and L: so that the closed form holds."""
    return Network(sir=sir, model="rl", far_sir=None, beyond_km=0.0, angle_deg=0.0, duration_s=0.3)


def _pair(network: Network, relay: str) -> dict[str, dict[str, Any]]:
    """A relay whose zone is delayed, and one whose is not."""
    at_once = relays(network, relay)[relay]
    (zone,) = at_once["pdis"]
    return {relay: at_once | {"pdis": [zone | {"delay_ms": STATIC_MS}]}, f"{relay}{AT_ONCE}": at_once}


def _shots(about: float, quick: bool) -> list[float]:
    step = 2.0 if quick else STEP
    return [float(about * (1 + e / 100)) for e in np.arange(-WIDTH, WIDTH + step / 2, step)]


def sweeps(quick: bool) -> dict[str, Sweep]:
    found = {}
    fault = {"line": "AB", "at_pu": 0.5, "angle_deg": NO_OFFSET_DEG, "after_s": 0.06}
    kinds = TYPES[:2] if quick else TYPES
    for sir in (1.0, 30.0) if quick else RATIOS:
        network = _network(sir)
        own = {name: own for relay in RELAYS for name, own in _pair(network, relay).items()}
        vary = {"type": kinds, "at": _shots(REACH, quick)}
        found[f"static-angle-{sir:g}"] = Sweep(network, own, vary, fault, {"point": 0.0, "theory": REACH})
    for sir in OFF_ANGLE_RATIOS[:1] if quick else OFF_ANGLE_RATIOS:
        network = _network(sir)
        for kind in kinds:
            for place in PLACES[1:2] if quick else PLACES:
                for relay, name in RELAYS.items():
                    theory = _resistance(network, name, kind, place)
                    vary = {"resistance": _shots(theory, quick)}
                    tags = {"point": place, "theory": theory, "type": kind, "relay": relay}
                    found[f"static-{relay}-{kind}-{sir:g}-{place:g}"] = Sweep(
                        network, _pair(network, relay), vary, fault | {"type": kind, "at_pu": place}, tags
                    )
    return found


def _resistance(network: Network, characteristic: str, kind: str, place: float) -> float:
    """Of the boundary at a place [ohm]."""
    by_reach = resistance_at(network, "mho" if characteristic == "mho" else "quad", kind, REACH, place)
    return by_reach if characteristic == "mho" else min(by_reach, QUAD_OHM[kind])


def fill(report: Report, rows: Mapping[str, Rows]) -> None:
    on = Rows.joined(own for name, own in rows.items() if name.startswith("static-angle"))
    off = [own for name, own in rows.items() if not name.startswith("static-angle")]
    quick = len(on.values("sir")) < len(RATIOS)
    report.text.append(
        "A line of R and L fed from A alone, no load: what the relay should measure is a closed form. A "
        "ramp of shots at each point: bolted faults along the line about the reach, in steps of 0.5 % of "
        "it; faults through a resistance about the boundary of the mho (polarized by the voltage before "
        "the fault, so it grows with the SIR) and of the quadrilateral. The boundary is half-way between "
        "the last shot that operated and the next. The zones have a delay of 100 ms: what moves first is "
        "over by then."
    )
    report.tables += [_on_angle(on), _off_angle(off)]
    ramps = [
        ramp(_network(sir), kind, name)
        for sir in ((1.0,) if quick else OFF_ANGLE_RATIOS)
        for kind in (TYPES[:1] if quick else TYPES)
        for name in ("mho", "quad")
    ]
    report.tables += [_ramp_table(ramps), _makers(on, off, ramps)]
    report.diagrams += [_error_diagram(on)]
    report.diagrams += [_plane(off, sir) for sir in sorted({float(own["sir"][0]) for own in off})]
    _check(report, on, off, ramps)


def _error(rows: Rows, relay: str, column: str) -> tuple[float, bool]:
    """Error of the boundary [%], and whether no shot beyond one that did not operate did; inf: not met."""
    order = np.argsort(rows[column])
    yes, value = rows.tripped(relay)[order], rows[column][order]
    theory = float(rows["theory"][0])
    if yes.all() or not yes.any():
        return (math.inf if yes.all() else -math.inf), True
    last = int(np.flatnonzero(yes)[-1])
    middle = (value[last] + value[last + 1]) / 2 if last + 1 < len(value) else value[last]
    return float(100 * (middle / theory - 1)), bool(yes[: last + 1].all())


def _on_angle(rows: Rows) -> Table:
    shown = []
    for sir in rows.values("sir"):
        cells = [
            _told(_error(rows.only(sir=sir, type=kind), f"{relay}{ending}", "at")[0])
            for ending in ("", AT_ONCE)
            for relay in RELAYS
            for kind in rows.values("type")
        ]
        shown.append((f"{sir:g}", *cells))
    kinds = [f"{relay.lower()} {kind}" for relay in RELAYS for kind in rows.values("type")]
    columns = (">SIR", *(f">{kind}" for kind in kinds), *(f">{kind}, at once" for kind in kinds))
    note = "At once: the same zone without its delay of 100 ms, on the same shots."
    return Table("Error of the reach on the line's angle, percent", columns, shown, note)


def _told(error: float) -> str:
    return f"{error:+.2f}" if math.isfinite(error) else f"{'>' if error > 0 else '<-'}{WIDTH:g}"


def _off_angle(parts: list[Rows]) -> Table:
    shown = []
    for own in parts:
        relay = str(own["relay"][0])
        error, whole = _error(own, relay, "resistance")
        place, theory = float(own["point"][0]), float(own["theory"][0])
        point = (RELAYS[relay], f"{own['sir'][0]:g}", own["type"][0], f"{100 * place:g} %")
        at_once = _told(_error(own, f"{relay}{AT_ONCE}", "resistance")[0])
        shown.append((*point, f"{theory:.2f}", _told(error), at_once, "yes" if whole else "no"))
    columns = ("zone 1", ">SIR", "fault", ">place", ">boundary ohm", ">error %", ">at once %", "one boundary")
    note = (
        "At once: without the delay of 100 ms. What it has more is overreach while the phasors move. A zone "
        "drops out beyond 105 % only: what has overshot may stay inside for as much."
    )
    return Table("Points off the angle: fault resistance at the boundary", columns, shown, note)


def _ramp_table(ramps: list[Ramp]) -> Table:
    shown = []
    for r in ramps:
        errors = [f"{100 * place / REACH - 100:+.2f}" for place in (r.operates, r.resets)]
        shown.append((r.characteristic, f"{r.sir:g}", r.kind, *errors, f"{100 * r.resets / r.operates:.1f}"))
    columns = ("zone 1", ">SIR", "fault", ">operates at, error %", ">resets at, error %", ">reset ratio %")
    note = (
        "The place goes from 120 % of the reach towards A by 0.1 % of it each 25 ms, and back, as phasors "
        "from the closed form; a starter zone of 200 % keeps the disturbance alive."
    )
    return Table("Pseudo-continuous ramp along the line", columns, shown, note)


def _worst(rows: Rows, most: float) -> float:
    own = rows.between("sir", 0, most)
    return max(
        abs(_error(own.only(sir=sir, type=kind), relay, "at")[0])
        for relay in RELAYS
        for sir in own.values("sir")
        for kind in own.values("type")
    )


def _worst_off(parts: list[Rows], relay: str) -> float:
    return max(abs(_error(own, relay, "resistance")[0]) for own in parts if own["relay"][0] == relay)


def _makers(on: Rows, off: list[Rows], ramps: list[Ramp]) -> Table:
    angle30, angle60 = f"{_worst(on, 30):.2f} %", f"{_worst(on, 60):.2f} %"
    both = max(_worst_off(off, relay) for relay in RELAYS)
    ours = [
        (angle30, "SIR to 30"), (angle60, "SIR to 60"), (angle60, "shots, SIR to 60"), (angle30, "SIR to 30"),
        (f"{both:.2f} %", "resistance, SIR 1 and 15"), (f"{both:.2f} %", "resistance, SIR 1 and 15"),
    ]  # fmt: skip
    shown = [(claim, *own) for claim, own in zip(STATIC, ours, strict=True)]
    return claims_table(
        "Makers' accuracy beside ours", shown, "The step of the shots is 0.5 %: as much is unknown."
    )


def _error_diagram(rows: Rows) -> Diagram:
    x = rows.values("sir")
    curves = []
    for colour, kind in enumerate(rows.values("type")):
        for relay, name in RELAYS.items():
            y = [_error(rows.only(sir=sir, type=kind), relay, "at")[0] for sir in x]
            dash = "solid" if relay == "MHO" else "dash"
            curves.append(Curve(f"{name} {kind}", x, y, colour=colour, dash=dash))
    limits = [Limit("+5 %", 5.0), Limit("+3 %", 3.0), Limit("-3 %", -3.0), Limit("-5 %", -5.0)]
    title = "Error of the reach on the line's angle"
    return Diagram(title, "SIR", "%", curves, limits, log_x=True, x_ticks=x, y_range=(-8, 8))


def _plane(parts: list[Rows], sir: float) -> Diagram:
    """Boundaries by the closed form, and every shot, over fault resistance and place."""
    curves = []
    network = _network(sir)
    own = [part for part in parts if part["sir"][0] == sir]
    combinations = sorted({(str(p["relay"][0]), str(p["type"][0])) for p in own})
    places = np.linspace(0, REACH, 33)
    for colour, (relay, kind) in enumerate(combinations):
        edge = [_resistance(network, RELAYS[relay], kind, float(x)) for x in places]
        told = f"{RELAYS[relay]} {kind}"
        curves.append(Curve(f"{told}: closed form", edge, 100 * places, "smooth", colour, "dot"))
        found = [p for p in own if (str(p["relay"][0]), str(p["type"][0])) == (relay, kind)]
        r = [float(p["theory"][0]) * (1 + _error(p, relay, "resistance")[0] / 100) for p in found]
        curves.append(
            Curve(f"{told}: measured", r, [100 * float(p["point"][0]) for p in found], "points", colour)
        )
    title = f"Characteristic at SIR {sir:g}: resistance of each faulted phase at the boundary"
    return Diagram(title, "ohm", "place, % of the line", curves)


def _check(report: Report, on: Rows, off: list[Rows], ramps: list[Ramp]) -> None:
    for most, limit in ON_ANGLE_LIMIT.items():
        what = f"on the angle, SIR to {most:g}: largest error"
        report.checks.append(Check(what, _worst(on, most), limit, "%"))
    for relay, name in RELAYS.items():
        what = f"{name}, fault resistance: largest error"
        report.checks.append(Check(what, _worst_off(off, relay), OFF_ANGLE_LIMIT, "%"))
    ragged = sum(not _error(part, str(part["relay"][0]), "resistance")[1] for part in off)
    report.checks.append(Check.none_of("points with more than one boundary", ragged, len(off)))
    worst = max((abs(100 * r.operates / REACH - 100) for r in ramps), default=np.nan)
    report.checks += [
        Check("pseudo-continuous ramp: largest error", float(worst), RAMP_LIMIT, "%"),
        Check("reset ratio", max(100 * r.resets / r.operates for r in ramps), RESET_LIMIT, "%"),
    ]
