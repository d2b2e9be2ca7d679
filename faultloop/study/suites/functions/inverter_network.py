"""The 230 kV network of Chowdhury and Fischer (IEEE TPWRD 36(4), 2021) with a plant of inverters at bus B3.

Sources at B1 and B2; R1 and R2 are at the ends of L23, at B3 and at B2.  With L13 out of service the plant is
alone at B3.  Faults are at D, in the middle of L23, and at G, which is B2: behind R2, and beyond the line of
R1.  The line's impedance per mile and the place of D are not published and are assumed.

Classical elements beside the relay's, by full-cycle phasors, with the paper's settings before the remedies:

- direction by the negative-sequence impedance, z2 = Re(V2 (I2 1<line)*) / |I2|^2, forward below -0.3 and
  reverse above 0.3 ohm secondary, where 3 I2 is above 0.5 A (forward) or 0.25 A (reverse) and 0.1 of I1; else
  by the positive sequence against the voltage from before the fault;
- phase selection by the angle between I2 and I0 of phase A, in sectors of 60 degrees (of faults to ground).
"""

from __future__ import annotations

import cmath
import math
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from faultloop.loop.scenario import Scenario
from faultloop.plant import Plant
from faultloop.relay import Relay, RelaySettings
from faultloop.study.diagram import Curve, Diagram, Limit
from faultloop.study.report import Table

HZ, KV, MILE = 60.0, 230.0, 1.609344
CT, VT = 200.0, 2000.0
Z1, Z0 = (0.075 + 0.7475j) * 40, (0.35 + 2.25j) * 40
"""Of L23 [ohm]: 40 miles."""
WARM_CYCLES = 40
FAULT_S, END_S = 0.1, 0.2
SEEN_S = 0.01
"""From then on after the fault an element's answer counts."""
PLANTS: dict[str, dict[str, Any]] = {
    "coupled": {"negative_sequence": "none"},
    "coupled, 30 MW": {"negative_sequence": "none", "power_mw": 30.0},
    "decoupled, k2 = 2": {"negative_sequence": "controlled", "k2": 2.0},
    "decoupled, k2 = 6": {"negative_sequence": "controlled", "k2": 6.0},
}
TYPES = ("AG", "ABG", "AB", "ABCG")
LOOPS_OF = {"AG": 0b000001, "ABG": 0b001000, "AB": 0b001000, "ABCG": 0b111000}
SECTOR_OF = {"AG": 0.0, "ABG": -120.0}
"""Degrees by which I2 of phase A leads I0 in a network of synchronous sources."""
ELEMENTS = ("direction", "selection", "zone 1", "zone 2")
SOURCE_OHM = {"R1": 60.0, "R2": 30.0}
"""L23 and the source at B2 with L12 out of service; that source."""


class Fault(NamedTuple):
    """What a case is of."""

    kind: str
    place: str
    """A line, or a bus."""
    at: float = 0.5
    resistance: float = 0.0
    angle_deg: float = 0.0


def line(name: str, ends: tuple[str, str], miles: float) -> dict[str, Any]:
    """A transposed one."""
    ohms = {"r1": 0.075, "x1": 0.7475, "r0": 0.35, "x0": 2.25}
    found: dict[str, Any] = {f"{key}_ohm_per_km": value / MILE for key, value in ohms.items()}
    found |= {"b1_us_per_km": 3.5, "b0_us_per_km": 2.2, "model": "bergeron"}
    return found | {"name": name, "from": ends[0], "to": ends[1], "length_km": miles * MILE}


def tables(fault: Fault, inverter: dict[str, Any], radial: bool = True, **network: float) -> dict[str, Any]:
    """The scenario.  ``network``: ``z_b1``, ``z_b2`` of the sources [ohm], ``angle_deg`` of that at B2."""
    sources = [
        ("S1", "B1", network.get("z_b1", 10.0), 0.0),
        ("S2", "B2", network.get("z_b2", 30.0), network.get("angle_deg", 0.0)),
    ]
    turn = cmath.rect(1.0, math.radians(85))
    place: dict[str, Any] = {"bus": fault.place}
    if fault.place.startswith("L"):
        place = {"line": fault.place, "at_pu": fault.at}
    kind = fault.kind
    key = "ground_ohm" if kind in ("AG", "BG", "CG") else "resistance_ohm"
    place |= {key: fault.resistance} if fault.resistance else {}
    lines = [line("L12", ("B1", "B2"), 100), line("L23", ("B3", "B2"), 40)]
    if not radial:
        lines.insert(1, line("L13", ("B1", "B3"), 60))
    return {
        "scenario": {"name": "inverter", "duration_s": END_S + 0.1},
        "system": {"frequency_hz": int(HZ), "base_kv": KV},
        "source": [
            {
                "name": name, "bus": bus, "angle_deg": angle, "z1_ohm": [(z * turn).real, (z * turn).imag],
                "z0_ohm": [(3 * z * turn).real, (3 * z * turn).imag],
            }
            for name, bus, z, angle in sources
        ],
        "line": lines,
        "transformer": [
            {"name": "T", "bus": "B3", "delta_bus": "B34", "rated_mva": 70, "x_pu": 0.09, "r_pu": 0.003},
            {"name": "U", "bus": "B34", "delta_bus": "G", "rated_mva": 110, "x_pu": 0.06, "r_pu": 0.006},
        ],
        "inverter": [{"name": "I", "bus": "G", "rated_mva": 100, "power_mw": 90.0} | inverter],
        "relay": [
            {"name": name, "line": "L23", "end": end, "settings": "none.toml"}
            for name, end in (("R1", "from"), ("R2", "to"))
        ],
        "front_end": {"antialias_hz": 1500},
        "fault": [{"type": kind, "angle_deg": fault.angle_deg, "after_s": FAULT_S, **place}],
    }  # fmt: skip


def record(data: dict[str, Any]) -> tuple[NDArray[np.float64], int, int]:
    """(relays, n, 6) samples with a warm-up of the cycle before the fault in front, the fault's sample,
    rate."""
    plant = Plant(Scenario.from_dict(data))
    hz = plant.sampling_hz
    rows: list[NDArray[np.float64]] = []
    count, start = round(END_S * hz) + round(0.017 * hz), 0
    while (done := sum(map(len, rows))) < count:
        plant.advance(count - done)
        rows.append(plant.samples.copy())
        for change in plant.changes:
            start = start or math.ceil(change.t_ns * hz / 1e9 - 1e-6)
    samples = np.concatenate(rows)
    cycle = round(hz / HZ)
    quiet = start // cycle * cycle
    warm = np.tile(samples[quiet - cycle : quiet], (WARM_CYCLES, 1, 1))
    return np.concatenate([warm, samples[quiet:]]).transpose(1, 0, 2), len(warm) + start - quiet, hz


def settings(name: str, with_inverters: bool) -> RelaySettings:
    """Of R1 or R2: as anywhere, or those for inverters."""
    zones: list[dict[str, Any]] = [
        {"zone": 1, "reach_pu": 0.8},
        {"zone": 2, "reach_pu": 1.3, "delay_ms": 350.0},
        {"zone": 3, "reach_pu": 0.5, "direction": "reverse", "delay_ms": 1000.0},
    ]
    more: dict[str, Any] = {}
    if with_inverters:
        own = {"characteristic": "quad", "polarization": "loop"}
        near, far = {"resistive_reach_ohm": 6.0}, {"resistive_reach_ohm": 15.0}
        zones = [zone | own | (near if zone["zone"] == 1 else far) for zone in zones]
        zones[0] |= {"tilt_deg": 10.0, "resistive_reach_ground_ohm": 20.0}
        for zone in zones[1:]:
            zone["resistive_reach_ground_ohm"] = 50.0
        side = "behind" if name == "R1" else "ahead"
        more = {"rdir": {"inverters": side, "source_ohm": SOURCE_OHM[name]}}
    return RelaySettings.from_dict(
        {
            "relay": {"frequency_hz": int(HZ), "nominal_kv": KV},
            "line": {"z1_ohm": [Z1.real, Z1.imag], "z0_ohm": [Z0.real, Z0.imag]},
            "vt": {"kind": "ideal"},
            "pdis": zones,
            "ptrc": {"zones": [3]},
            **more,
        }
    )


class Said(NamedTuple):
    """What an element has said at every sample from the fault on."""

    direction: NDArray[np.int64]
    """1 forward, -1 reverse, 0 nothing."""
    selection: NDArray[np.int64]
    """Mask of the loops AG BG CG AB BC CA; 0: nothing."""
    zones: NDArray[np.bool_]
    """(n, 2) zone 1 and 2 have started."""


def by_relay(samples: NDArray[np.float64], start: int, given: RelaySettings) -> Said:
    """A relay's own."""
    relay, words, done = Relay(given), np.empty(len(samples), np.uint64), 0
    while done < len(samples):
        m = relay.advance(np.ascontiguousarray(samples[done:]))
        words[done : done + m] = relay.pickup
        done += m
    words = words[start:]
    bit = {name: np.uint64(k) for k, name in enumerate(relay.bits)}

    def on(name: str) -> NDArray[np.int64]:
        return ((words >> bit[name]) & np.uint64(1)).astype(np.int64)

    loops = sum(on(f"PHS1.{loop}") << k for k, loop in enumerate(("AG", "BG", "CG", "AB", "BC", "CA")))
    zones = np.stack([on("PDIS1"), on("PDIS2")], 1).astype(bool)
    return Said(on("RDIR1.DirFwd") - on("RDIR1.DirRev"), np.asarray(loops), zones)


def classical(samples: NDArray[np.float64], start: int, hz: int) -> Said:
    """By full-cycle phasors."""
    cycle = round(hz / HZ)
    turn = np.exp(-2j * np.pi * HZ / hz * np.arange(len(samples)))[:, None]
    sums = np.cumsum(samples * turn, 0)
    x = np.zeros_like(sums)
    x[cycle:] = math.sqrt(2) / cycle * (sums[cycle:] - sums[:-cycle])
    a = cmath.rect(1.0, 2 * math.pi / 3)
    fortescue = np.array([[1, 1, 1], [1, a, a**2], [1, a**2, a]]) / 3
    _, v1, v2 = fortescue @ x[:, :3].T
    i0, i1, i2 = fortescue @ x[:, 3:].T
    axis = Z1 / abs(Z1)
    z2 = ((v2 * (i2 * axis).conj()).real / np.maximum(abs(i2), 1e-9) ** 2) * CT / VT
    forward = (z2 < -0.3) & (3 * abs(i2) / CT > 0.5) & (abs(i2) > 0.1 * abs(i1))
    reverse = (z2 > 0.3) & (3 * abs(i2) / CT > 0.25) & (abs(i2) > 0.1 * abs(i1))
    enabled = (3 * abs(i2) / CT > 0.25) & (abs(i2) > 0.1 * abs(i1))
    power = (v1[start - cycle] * (i1 * axis).conj()).real
    positive = np.sign(power) * (abs(i1) / CT > 0.5)
    direction = np.where(enabled, forward.astype(int) - reverse.astype(int), positive).astype(np.int64)
    lead = np.degrees(np.angle(i2 * i0.conj()))
    selection = np.zeros(len(samples), np.int64)
    there = (3 * abs(i0) / CT > 0.25) & enabled
    for kind, centre in SECTOR_OF.items():
        off = abs((lead - centre + 180) % 360 - 180)
        selection[there & (off <= 30)] = LOOPS_OF[kind]
    none = np.zeros((len(samples) - start, 2), bool)
    return Said(direction[start:], selection[start:], none)


def score(said: Said, fault: Fault, forward: bool, hz: int, zone: tuple[bool, bool]) -> dict[str, str]:
    """``right``, ``wrong`` or ``none`` of each element.  Wrong is what says something wrong for an eighth of
    a cycle; right what says the right thing at the end."""
    first, least = round(SEEN_S * hz), round(hz / HZ / 8)

    def judged(right: NDArray[np.bool_], wrong: NDArray[np.bool_]) -> str:
        run = np.convolve(wrong[first:].astype(int), np.ones(least, int), "valid")
        if (run >= least).any():
            return "wrong"
        return "right" if right[-1] else "none"

    true = 1 if forward else -1
    wanted = LOOPS_OF.get(fault.kind, 0)
    found = {
        "direction": judged(said.direction == true, said.direction == -true),
        "selection": judged(said.selection == wanted, (said.selection & ~wanted) != 0),
    }
    for k, should in enumerate(zone):
        did = bool(said.zones[:, k].any())
        found[f"zone {k + 1}"] = "right" if did == should else "wrong" if did else "none"
    return found


Row = tuple[str, str, str, Fault, str, dict[str, str]]
"""Who, relay, place, fault, plant, its scores."""
WHO = ("classical", "ours", "ours, set for inverters")


@cache
def scores() -> tuple[Row, ...]:
    """The 48 cases by every element."""
    rows: list[Row] = []
    for plant, inverter in PLANTS.items():
        for kind in TYPES:
            for place, resistance in (("D", 0.0), ("D", 5.0), ("G", 0.0)):
                fault = Fault(kind, "L23" if place == "D" else "B2", 0.5, resistance)
                both, start, hz = record(tables(fault, inverter))
                for k, name in enumerate(("R1", "R2")):
                    if name == "R2" and place == "D":
                        continue
                    forward = name == "R1"
                    zone = (place == "D", forward)
                    answers = (
                        classical(both[k], start, hz),
                        by_relay(both[k], start, settings(name, False)),
                        by_relay(both[k], start, settings(name, True)),
                    )
                    for who, said in zip(WHO, answers, strict=True):
                        judged = score(said, fault, forward, hz, zone)
                        if who == "classical":
                            judged = {key: judged[key] for key in ("direction", "selection")}
                            if kind not in SECTOR_OF:
                                judged.pop("selection")
                        rows.append((who, name, place, fault, plant, judged))
    return tuple(rows)


def counted(who: str, relay: str, element: str, verdict: str) -> tuple[int, int]:
    """How many of how many."""
    found = [row[5][element] for row in scores() if row[:2] == (who, relay) and element in row[5]]
    return found.count(verdict), len(found)


def element_scores(given: dict[str, Any]) -> dict[str, Any]:
    """For a case: wrong and right answers, as parts of all."""
    names = given["who"], given["relay"], given["element"]
    wrong, total = counted(*names, "wrong")
    return {"wrong": wrong / total, "right": counted(*names, "right")[0] / total}


def table(quick: bool) -> Table:
    """Of all."""
    rows = []
    for relay in ("R1", "R2"):
        for who in WHO:
            cells = []
            for element in ELEMENTS:
                right, total = counted(who, relay, element, "right")
                wrong = counted(who, relay, element, "wrong")[0]
                cells.append(f"{right}, {wrong} wrong, of {total}" if total else "")
            rows.append((relay, who, *cells))
    note = (
        "R1, at the plant: faults in the middle of the line (0 and 5 ohm) and at its far bus; R2, at the "
        "other end: at its own bus, behind it; L13 out of service; four plants, A-G, A-B-G, A-B, A-B-C-G. "
        "Published, of 32, before / after new settings: direction R1 68 / 56 %, R2 68 / 100 %; selection 87 "
        "/ 100 % both; zone 1 R1 89 / 100, R2 75 / 100 %; zone 2 R1 56 / 38, R2 75 / 100 %. The makers' "
        "models are not public: the pattern is to be compared, not the digits."
    )
    return Table("Elements with inverter-fed faults: right answers", ("", "", *ELEMENTS), rows, note)


def ratio(samples: NDArray[np.float64], hz: int) -> NDArray[np.float64]:
    """|dV| / |dI| of positive and negative sequence [ohm], by full-cycle phasors."""
    cycle = round(hz / HZ)
    turn = np.exp(-2j * np.pi * HZ / hz * np.arange(len(samples)))[:, None]
    sums = np.cumsum(samples * turn, 0)
    x = sums[cycle:] - sums[:-cycle]
    x = x - x[0]
    a = cmath.rect(1.0, 2 * math.pi / 3)
    both = np.array([[1, a, a**2], [1, a**2, a]])
    v, i = both @ x[:, :3].T, both @ x[:, 3:].T
    return np.sqrt((abs(v) ** 2).sum(0) / np.maximum((abs(i) ** 2).sum(0), 1e-12))


def diagrams(quick: bool) -> list[Diagram]:
    """What the direction for inverters rests on: the ratio of the changes, of both relays."""
    drawn: list[Curve] = []
    for colour, (said, fault, k) in enumerate(
        (
            ("R2: ahead, A-B", Fault("AB", "L23", 0.5), 1),
            ("R2: behind, A-B", Fault("AB", "B2"), 1),
            ("R2: behind, A-B-C-G", Fault("ABCG", "B2"), 1),
            ("R1: ahead, A-B", Fault("AB", "L23", 0.5), 0),
            ("R1: ahead, A-G", Fault("AG", "L23", 0.5), 0),
            ("R1: behind, A-B", Fault("AB", "B3"), 0),
        )
    ):
        both, start, hz = record(tables(fault, PLANTS["coupled"]))
        rows = both[k][start - 2 * round(hz / HZ) :]
        y = ratio(rows, hz)
        t = 1e3 * (np.arange(len(y)) / hz - 1 / HZ)
        shown = t > 2
        drawn.append(Curve(said, t[shown], y[shown], "smooth", colour))
    limits = [Limit(f"{name}: source_ohm, with its margin", 1.25 * ohm) for name, ohm in SOURCE_OHM.items()]
    title = "What the change of voltages is over that of currents"
    note = "Above its limit a relay's current is the inverters', and the fault on the other side of it."
    return [
        Diagram(
            title,
            "ms after the fault",
            "ohm",
            drawn,
            limits,
            log_y=True,
            y_range=(10, 2000),
            wide=True,
            note=note,
        )
    ]
