"""Current transformers that saturate 3 to 20 ms after the fault."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cache

import numpy as np

from faultloop.plant.ct import Ct, core_constants, core_step
from faultloop.study.diagram import Curve, Diagram
from faultloop.study.report import Check, Report, Table
from faultloop.study.suites.distance.network import BASE_KV, Network
from faultloop.study.suites.distance.rows import Rows
from faultloop.study.suites.distance.section import TIME_COLUMNS, angles, time_cells
from faultloop.study.suites.distance.security import ZONES, relays, wrong, wrong_table
from faultloop.study.suites.distance.sweep import Sweep

TITLE = "Saturation of the current transformer"
TIMES_MS = (3.0, 4.0, 5.0, 7.0, 10.0, 15.0)
"""From the fault to the first error of 10 % of the peak, of a fully offset current."""
RATIOS = (0.5, 3.0)
CLOSE_IN, INSIDE, FAR = (0.0, 0.02), (0.3, 0.5, 0.6), (0.84, 0.9, 1.0)
REMANENCES = (0.0, 0.5)
STEPS_PER_S = 19200
BURDEN_OHM, WINDING_OHM, RATIO = (2.0, 0.5), 0.5, (1200.0, 5.0)
HIGH_V = 5000.0
CLOSE_IN_MS = 60.0
CARRIES = 1.25
"""Times the voltage that the load needs, with its charging: a core of less is in no service."""


def transformer(vs_v: float, remanence: float) -> dict[str, object]:
    """A ``[[ct]]``."""
    return {
        "name": "C", "ratio": list(RATIO), "model": "saturating", "class": "TPX", "vs_v": vs_v,
        "rw_ohm": WINDING_OHM, "burden_ohm": list(BURDEN_OHM), "remanence_pu": remanence,
    }  # fmt: skip


def time_to_saturation_ms(vs_v: float, remanence: float, primary_a: float, x_over_r: float) -> float:
    """Of a fully offset current of this symmetrical RMS; inf where it does not saturate within 60 ms."""
    ct = Ct.model_validate(transformer(vs_v, remanence))
    core = np.array(core_constants(ct, 50.0, STEPS_PER_S))
    peak = math.sqrt(2) * primary_a * RATIO[1] / RATIO[0]
    omega = 2 * math.pi * 50.0
    state = np.array([remanence * ct.flux_at_vs(50.0), 0.0])
    for n in range(1, STEPS_PER_S * 60 // 1000):
        t = n / STEPS_PER_S
        ideal = peak * (math.exp(-t * omega / x_over_r) - math.cos(omega * t))
        if abs(core_step(core, state, ideal) - ideal) > 0.1 * peak:
            return 1e3 * t
    return math.inf


@cache
def voltage_for(ms: float, remanence: float, primary_a: float, x_over_r: float) -> float:
    """The `vs_v` at which it takes so long, by bisection; HIGH_V where none is as slow."""
    low, high = 1.0, HIGH_V
    for _ in range(30):
        middle = math.sqrt(low * high)
        if time_to_saturation_ms(middle, remanence, primary_a, x_over_r) < ms:
            low = middle
        else:
            high = middle
    return round(high, 2)


def fault_current_a(network: Network, place: float) -> float:
    """Through the transformer at A, of a three-phase fault; behind it is the far source's."""
    line = network.z1_ohm
    if place < 0:
        z = line * (1 + network.beyond_km / network.length_km + (network.far_sir or 0.0))
    else:
        z = line * (network.sir + place)
    return BASE_KV * 1e3 / math.sqrt(3) / abs(z)


def load_v(network: Network) -> float:
    """At the secondary winding, of the current that flows before the fault."""
    parts = network.sir + 1 + network.beyond_km / network.length_km + (network.far_sir or math.inf)
    driving = 2 * math.sin(math.radians(network.angle_deg) / 2) * BASE_KV * 1e3 / math.sqrt(3)
    amperes = driving / (abs(network.z1_ohm) * parts) * RATIO[1] / RATIO[0]
    return amperes * math.hypot(BURDEN_OHM[0] + WINDING_OHM, BURDEN_OHM[1])


def sweeps(quick: bool) -> dict[str, Sweep]:
    vary = {"type": ("BC",) if quick else ("AG", "BC", "CAG", "ABC"), "angle": angles(1 if quick else 4)}
    found = {}
    places = (0.02, 1.0) if quick else (-1.0, *CLOSE_IN, *INSIDE, *FAR)
    x_over_r = Network().z1_ohm.imag / Network().z1_ohm.real
    for sir in (0.5,) if quick else RATIOS:
        for ms in (3.0,) if quick else TIMES_MS:
            for remanence in REMANENCES[:1] if quick else REMANENCES:
                for place in places:
                    plain = Network(sir=sir)
                    vs = voltage_for(ms, remanence, fault_current_a(plain, place), x_over_r)
                    if vs < CARRIES * load_v(plain):
                        continue
                    network = Network(sir=sir, more={"ct": [transformer(vs, remanence)]}, relay={"ct": "C"})
                    fault = {"bus": "A"} if place < 0 else {"line": "AB", "at_pu": place}
                    tags = {"saturates_ms": ms, "remanence": remanence, "vs_v": vs}
                    name = f"ct-{sir:g}-{ms:g}-{remanence:g}-{place:g}"
                    found[name] = Sweep(network, relays(network), vary, fault, tags)
    return found


def fill(report: Report, rows: Mapping[str, Rows]) -> None:
    every = Rows.joined(rows.values()).tagged()
    report.text.append(
        "A closed core (TPX) of 1200/5 A behind 2.5 + 0.5j ohm, whose knee is chosen for each place of "
        "the fault so that a fully offset three-phase fault current of it saturates the core after the "
        "time told (10 % error), without remanence and with 50 %. Bolted faults at four angles: some have "
        "the full offset, some none. Cores that could not carry the load before the fault are left out."
    )
    found = wrong(every)
    beyond = every.pick(every["depth"] >= 1)
    report.tables += [wrong_table("Operations by place", found), _times(every), _wrong_by_time(every)]
    report.diagrams.append(_diagram(every))
    behind, ahead = every.pick(every["depth"] < 0), every.pick(every["depth"] >= 0)
    for relay in ("MHO", "QUAD"):
        told = ZONES[relay]
        report.checks += [
            Check.none_of(f"{told}, fault at the far bus: operated", _count(beyond, relay), len(beyond)),
            Check.none_of(f"{told}, fault behind: operated", _count(behind, relay), len(behind)),
        ]
        close = every.between("depth", 0, CLOSE_IN[-1])
        times = close.times(relay)
        report.checks += [
            Check.none_of(f"{told}, close-in fault: not operated", times.missed, len(close)),
            Check(f"{told}, close-in fault: longest", times.at(1.0), CLOSE_IN_MS, "ms", cases=len(close)),
        ]
    report.checks += [
        Check.none_of(f"{ZONES['FWD']}, fault behind: operated", _count(behind, "FWD"), len(behind)),
        Check.none_of(f"{ZONES['REV']}, fault ahead: operated", _count(ahead, "REV"), len(ahead)),
    ]


def _count(rows: Rows, relay: str) -> float:
    return float(rows.tripped(relay).sum())


def _times(rows: Rows) -> Table:
    shown = []
    for ms in rows.values("saturates_ms"):
        for name, low, high in (("close-in, to 2 %", 0.0, 0.02), ("30 to 60 %", 0.3, 0.6)):
            own = rows.only(saturates_ms=ms).between("depth", low, high)
            shown.append((f"{ms:g}", name, *time_cells(own.times("MHO"))))
    columns = (">saturates after ms", "place", *TIME_COLUMNS)
    return Table("Operate time, mho", columns, shown)


def _wrong_by_time(rows: Rows) -> Table:
    shown = []
    for ms in rows.values("saturates_ms"):
        found = wrong(rows.only(saturates_ms=ms))
        shown.append((f"{ms:g}", *(f"{w.operated} of {w.cases}" for w in found)))
    columns = (">saturates after ms", *(f">{w.what}" for w in wrong(rows)))
    return Table("Operations by time to saturation", columns, shown)


def _diagram(rows: Rows) -> Diagram:
    x = rows.values("saturates_ms")
    curves = []
    groups = (("close-in", 0.0, 0.02), ("30 to 60 % of the line", 0.3, 0.6))
    for colour, (name, low, high) in enumerate(groups):
        own = rows.between("depth", low, high)
        for part, told, dash in ((0.5, "median", "solid"), (1.0, "maximum", "dot")):
            y = [own.only(saturates_ms=ms).times("MHO").at(part) for ms in x]
            curves.append(
                Curve(f"{name}: {told}", x, np.where(np.isfinite(y), y, np.nan), colour=colour, dash=dash)
            )
    title = "Operate time, mho, against the time to saturation"
    return Diagram(title, "ms from the fault to saturation", "ms", curves, y_range=(0, 100))
