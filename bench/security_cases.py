"""Random networks X - A - B - C with one fault; a case depends on the seed, its number and the kind alone.

``mixed``: every line of 10 to 300 km; ``long``: A - B of 200 to 400 km; ``extreme``: mixed, with sources of
up to 60 times the line whatever the length: networks that resonate near the nominal frequency are in it.
"""

from __future__ import annotations

import cmath
import math
from typing import Any, NamedTuple

import numpy as np

from faultloop.loop.scenario import Scenario
from faultloop.plant import Plant

KINDS = ("mixed", "long", "extreme")
TYPES = ("AG", "BG", "CG", "AB", "BC", "CA", "ABG", "BCG", "CAG", "ABC", "ABCG")
SAMPLING_HZ = 4800
WARM_CYCLES = 20
DURATION_S = 0.26
FAULT_LINE = {"behind": "XA", "inside": "AB", "beyond": "BC", "parallel": "PP"}
VOLTAGE_RISE = 0.2
PER_PLACE = 4


class View(NamedTuple):
    """A fault as the relay at one end of A - B sees it.

    ``sir``: the drop from the source to the relay over that along the line, for a fault at the far bus (IEEE
    C37.113; Thompson and Somani 2015): all behind the relay over the line's |Z1|, and twice that beside a
    parallel line, which takes as much of the source's current as the line.
    """

    where: str
    at: float
    """Along its line, per unit; 0 behind."""
    sir: float
    length: float
    bolted: bool
    measured: float
    """What its loop measures at most, per unit of the line's R and X; ``at`` where it is not on the line."""


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return math.exp(rng.uniform(math.log(low), math.log(high)))


def draw_line(rng: np.random.Generator, f0: int) -> dict[str, Any]:
    x1 = rng.uniform(0.26, 0.45)
    line = {
        "model": str(rng.choice(["bergeron", "pi", "rl"], p=[0.5, 0.3, 0.2])),
        "r1_ohm_per_km": x1 / rng.uniform(5, 18),
        "x1_ohm_per_km": x1,
        "r0_ohm_per_km": x1 * rng.uniform(0.4, 1.0),
        "x0_ohm_per_km": x1 * rng.uniform(2.4, 3.6),
    }
    if line["model"] != "rl":
        speed = 3e5 * rng.uniform(0.93, 0.995)  # of waves [km/s]
        b1 = 1e6 * (2 * math.pi * f0 / speed) ** 2 / x1
        line |= {"b1_us_per_km": b1, "b0_us_per_km": b1 * rng.uniform(0.5, 0.7)}
    return line


def draw_source(rng: np.random.Generator, z1: float, limit_km: float) -> dict[str, Any]:
    """0.1 to 60 times the line, but able alone to energise ``limit_km`` with 20 % of voltage rise."""
    zero = rng.uniform(0.6, 3)
    size = z1 * log_uniform(rng, 0.1, 60)
    size = min(size, VOLTAGE_RISE / (3e-6 * limit_km), VOLTAGE_RISE / (1.8e-6 * limit_km * zero))
    angle = math.atan(rng.uniform(5, 30))
    z = [size * math.cos(angle), size * math.sin(angle)]
    return {"z1_ohm": z, "z0_ohm": [z[0] * zero, z[1] * zero]}


def draw(seed: int, number: int, kind: str) -> dict[str, Any]:
    """One case: numbers and names only."""
    rng = np.random.default_rng([seed, number, KINDS.index(kind)])
    low, high = (200, 400) if kind == "long" else (10, 300)
    f0 = int(rng.choice([50, 60]))
    part = 0.1 if rng.random() < 0.2 else 0.02
    case: dict[str, Any] = {"seed": seed, "number": number, "f0": f0, "sampling": SAMPLING_HZ}
    case |= {"kind": KINDS.index(kind), "fault": 0}
    case["frequency"] = f0 * (1 + float(rng.uniform(-part, part)))
    case["length"] = log_uniform(rng, low, high)
    case["near"], case["far"] = log_uniform(rng, 10, high), log_uniform(rng, 10, high)
    case["line"] = draw_line(rng, f0)
    case["kv"] = float(rng.choice([110, 220, 380, 500]))
    z1 = z1_of(case)
    limit = 1.0 if kind == "extreme" else case["length"] + case["near"] + case["far"]
    case["X"], case["C"] = draw_source(rng, z1, limit), draw_source(rng, z1, limit)
    case["load"] = float(rng.uniform(-40, 40))
    case["parallel"] = bool(rng.random() < 0.2)
    draw_place(rng, case)
    draw_fault(rng, case)
    case["noise"] = 0.001 if rng.random() < 0.5 else 0.0
    return case


def z1_of(case: dict[str, Any]) -> float:
    """|Z1| of the line A - B [ohm]."""
    return math.hypot(case["line"]["r1_ohm_per_km"], case["line"]["x1_ohm_per_km"]) * case["length"]


def another(case: dict[str, Any], fault: int) -> dict[str, Any]:
    """The same network with another fault, `PER_PLACE` at a place in turn; number 0 is the case's own."""
    case = {**case, "fault": fault}
    place, here = divmod(fault, PER_PLACE)
    seed = [case["seed"], case["number"], case["kind"], place]
    if place:
        draw_place(np.random.default_rng(seed), case)
    if fault:
        draw_fault(np.random.default_rng([*seed, here]), case)
    return case


def draw_place(rng: np.random.Generator, case: dict[str, Any]) -> None:
    case["where"] = str(rng.choice(["behind", "inside", "beyond"], p=[0.35, 0.3, 0.35]))
    if case["parallel"] and rng.random() < 0.5:
        case["where"] = "parallel"
    at = float(rng.random() if rng.random() < 0.75 else rng.random() ** 4)  # close to A or B more often
    case["at"] = 1 - at if case["where"] == "behind" else at


def draw_fault(rng: np.random.Generator, case: dict[str, Any]) -> None:
    """Which, when, through what."""
    case["type"], case["angle"] = str(rng.choice(TYPES)), float(rng.uniform(0, 360))
    case["resistance"] = 0.0 if rng.random() < 0.7 else log_uniform(rng, 0.02, 0.5) * z1_of(case)


def measured(case: dict[str, Any], at: float) -> float:
    """Impedance of a bolted fault at ``at`` of the line, per unit of the line's R and X: at most.

    A line with capacitance, shorted at x, shows Zc tanh(gamma x) in every sequence and not z x.  A phase loop
    measures the positive sequence's; a ground loop a mean of positive and zero sequence's, weighted by their
    currents (docs/relay.md), so the zero sequence's at most.
    """
    line, length = case["line"], case["length"] * at
    if line["model"] == "rl":
        return at
    sequence = "0" if case["type"] in ("AG", "BG", "CG") else "1"
    turn = case["frequency"] / case["f0"]
    z = complex(line[f"r{sequence}_ohm_per_km"], turn * line[f"x{sequence}_ohm_per_km"]) * length
    y = 1e-6j * turn * line[f"b{sequence}_us_per_km"] * length
    gamma = cmath.sqrt(z * y)
    return at * abs(cmath.tanh(gamma) / gamma) if at else 0.0


def view(case: dict[str, Any], end: int) -> View:
    """From A (0) or from B (1)."""
    z = math.hypot(case["line"]["r1_ohm_per_km"], case["line"]["x1_ohm_per_km"])
    source = math.hypot(*case["XC"[end]]["z1_ohm"]) + case[("near", "far")[end]] * z
    sir = source / (z * case["length"]) * (2 if case["parallel"] else 1)
    at = 1 - case["at"] if end else case["at"]
    where = case["where"]
    if where in ("behind", "beyond"):
        where, at = ("behind", 0.0) if (where == "behind") == (end == 0) else ("beyond", 1 + at)
    seen = measured(case, at) if where == "inside" else at
    return View(where, at, sir, case["length"], case["resistance"] == 0.0, seen)


def fault(case: dict[str, Any]) -> dict[str, Any]:
    """Its table."""
    table = {"line": FAULT_LINE[case["where"]], "at_pu": case["at"], "type": case["type"]}
    table |= {"angle_deg": case["angle"], "after_s": 0.02}
    if case["resistance"]:
        key = "ground_ohm" if case["type"] in ("AG", "BG", "CG") else "resistance_ohm"
        table[key] = case["resistance"]
    return table


def scenario(case: dict[str, Any], antialias_hz: float, order: int = 2) -> Scenario:
    return Scenario.from_dict(tables(case, antialias_hz, order) | {"fault": [fault(case)]})


def tables(case: dict[str, Any], antialias_hz: float, order: int) -> dict[str, Any]:
    """Of the scenario, without a fault."""
    line, frequency = case["line"], case["frequency"]
    lines = [
        {"name": "XA", "from": "X", "to": "A", "length_km": case["near"], **line},
        {"name": "AB", "from": "A", "to": "B", "length_km": case["length"], **line},
        {"name": "BC", "from": "B", "to": "C", "length_km": case["far"], **line},
    ]
    if case["parallel"]:
        lines.append({"name": "PP", "from": "A", "to": "B", "length_km": case["length"], **line})
    source = {"bus": "X", "voltage_pu": 1.02, "frequency_hz": frequency}
    far = {"bus": "C", "angle_deg": -case["load"], "frequency_hz": frequency}
    return {
        "scenario": {"name": "security", "duration_s": DURATION_S, "seed": case["number"]},
        "system": {"frequency_hz": case["f0"], "base_kv": case["kv"], "sampling_hz": case["sampling"]},
        "source": [{"name": "SX", **source, **case["X"]}, {"name": "SC", **far, **case["C"]}],
        "line": lines,
        "relay": [
            {"name": "RA", "line": "AB", "end": "from", "settings": "none"},
            {"name": "RB", "line": "AB", "end": "to", "settings": "none"},
        ],
        "front_end": {
            "antialias_hz": antialias_hz,
            "antialias_order": order,
            "voltage_noise_v": case["noise"] * 1e3 * case["kv"] / math.sqrt(3),
            "current_noise_a": case["noise"] * 1e3,
        },
    }


def record(case: dict[str, Any], antialias_hz: float, order: int = 2) -> tuple[np.ndarray, int]:
    """(2, n, 6) samples of both relays, and the number of the first one of the fault."""
    plant = Plant(scenario(case, antialias_hz, order))
    rate = case["sampling"]
    warm = WARM_CYCLES * rate // case["f0"]
    total = round(DURATION_S * rate)
    out = np.empty((2, warm + total, 6))
    out[:, :warm] = plant.history(warm).transpose(1, 0, 2)
    start = warm + total
    while plant.sample_count < total:
        at = warm + plant.sample_count
        done = plant.advance(warm + total - at)
        out[:, at : at + done] = plant.samples.transpose(1, 0, 2)
        for change in plant.changes:
            if change.kind == "fault" and change.value:
                start = min(start, warm - (-change.t_ns * rate // 10**9))
    return out, start
