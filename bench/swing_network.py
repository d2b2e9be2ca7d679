"""Power swings of a network of travelling waves: lines X - A - B - C, the source at C slips, a relay at A.

    python bench/swing_network.py [--cases 300] [--seed 1] [--kind swing|inside|outside|after|pole]
                                  [--vt ideal|P1|P2|A1|A2]

Bergeron lines of 50, 100 and 50 km; sources of 0.3 to 3 times 12 ohm and 18 ohm; settings, slips and stable
swings as in ``bench/functions.py``.  `inside`: a bolted fault of any type within 80 % of A - B during the
swing; `outside`: one on X - A or B - C, which goes 150 ms later; `after`: one there, in half of the cases of
three phases, that makes the swing as in ``bench/functions.py``, and lines of 50 to 300 km beside A - B, which
ring; `pole`: a swing while pole A of A - B is open.  ``--vt``: of a capacitive one the relay knows the
circuit.
"""

from __future__ import annotations

import argparse
import math
from collections import Counter
from typing import Any

import numpy as np
from functions import BOXES, FS, LIMIT_MS, ZONES, accelerated

from faultloop.loop.scenario import Scenario
from faultloop.plant import Plant
from faultloop.relay import Relay, RelaySettings
from tests.relay import swings
from tests.relay.network import TYPES, Network, play

LINE = {
    "model": "bergeron", "r1_ohm_per_km": 0.03, "x1_ohm_per_km": 0.3, "b1_us_per_km": 3.5,
    "r0_ohm_per_km": 0.12, "x0_ohm_per_km": 0.9, "b0_us_per_km": 2.2,
}  # fmt: skip
OPENS_S = 0.2
POINTS = 24
"""Samples between two points of the angle's curve."""


def tables(
    near: float, far: float, angle: np.ndarray, beside_km: tuple[float, float], vt: str
) -> dict[str, Any]:
    """Of a scenario without a fault; ``near`` and ``far``: parts of the sources, ``beside_km``: length of the
    lines on either side."""
    seconds = len(angle) / FS
    points = range(0, len(angle), POINTS)
    sources = [
        ("SX", "X", (1 + 12j) * near, (1.5 + 15j) * near),
        ("SC", "C", (1.5 + 18j) * far, (3 + 30j) * far),
    ]
    data: dict[str, Any] = {
        "scenario": {"name": "swing", "duration_s": seconds},
        "system": {"frequency_hz": 50, "base_kv": 230, "sampling_hz": FS},
        "source": [
            {"name": name, "bus": bus, "z1_ohm": [z1.real, z1.imag], "z0_ohm": [z0.real, z0.imag]}
            for name, bus, z1, z0 in sources
        ],
        "swing": [
            {"source": "SC", "at_s": [k / FS for k in points], "angle_deg": [float(angle[k]) for k in points]}
        ],
        "line": [
            {"name": "XA", "from": "X", "to": "A", "length_km": beside_km[0], **LINE},
            {"name": "AB", "from": "A", "to": "B", "length_km": 100.0, **LINE},
            {"name": "BC", "from": "B", "to": "C", "length_km": beside_km[1], **LINE},
        ],
        "relay": [{"name": "RA", "line": "AB", "end": "from", "settings": "none"}],
        "front_end": {"antialias_hz": 1500},
    }  # fmt: skip
    if vt != "ideal":
        data["vt"] = [{"name": "V", "ratio": [230000, 110], "model": "cvt", "circuit": vt}]
        data["relay"][0]["vt"] = "V"
    return data


def after(rng: np.random.Generator, vt: str) -> tuple[dict[str, Any], float]:
    """A fault beside A - B that makes the swing, and goes."""
    near, far = np.exp(rng.uniform(np.log(0.3), np.log(3), 2))
    first_km, second_km = np.exp(rng.uniform(np.log(50), np.log(300), 2))
    start, stands = 0.3 + float(rng.uniform(0, 0.02)), float(rng.uniform(0.06, 0.2))
    angle = accelerated(rng, start, stands)
    fault = {
        "type": str(rng.choice(TYPES if rng.random() < 0.5 else ["ABC", "ABCG"])),
        "line": str(rng.choice(["XA", "BC"])),
        "at_pu": float(rng.uniform(0.02, 0.98)),
        "start_s": start,
        "duration_s": stands,
    }
    data = tables(near, far, angle, (float(first_km), float(second_km)), vt)
    return data | {"fault": [fault]}, start


def scenario(rng: np.random.Generator, kind: str, vt: str) -> tuple[dict[str, Any], float | None]:
    """Tables, and when the fault begins [s]."""
    if kind == "after":
        return after(rng, vt)
    near, far = np.exp(rng.uniform(np.log(0.3), np.log(3), 2))
    hz = float(np.exp(rng.uniform(np.log(0.5), np.log(7))))
    if rng.random() < 0.5:
        angle = swings.slipping(
            Network(), hz, 0.3 + max(1.4 / hz, 0.7), load_deg=float(rng.choice([-20, 20]))
        )
    else:
        hz = min(hz, 3.0)
        angle = swings.stable(Network(), hz, float(rng.uniform(60, 140)), 0.3 + max(1.4 / hz, 0.7))
        angle = angle * rng.choice([-1, 1])
    seconds = len(angle) / FS
    data = tables(near, far, angle, (50.0, 50.0), vt)
    if kind in ("swing", "pole"):
        return data, None
    start = float(rng.uniform(0.36, seconds - (0.12 if kind == "inside" else 0.2)))
    fault: dict[str, Any] = {"type": str(rng.choice(TYPES)), "start_s": start}
    if kind == "inside":
        fault |= {"line": "AB", "at_pu": float(rng.uniform(0.02, 0.8))}
    else:
        fault |= {
            "line": str(rng.choice(["XA", "BC"])),
            "at_pu": float(rng.uniform(0.02, 0.98)),
            "duration_s": 0.15,
        }
    return data | {"fault": [fault]}, start


def samples(data: dict[str, Any], pole: bool) -> np.ndarray:
    """(n, 6) of the relay; with a ``pole`` open, that of phase A."""
    if pole:
        data = data | {
            "breaker": [{"name": "QA", "line": "AB", "end": "from", "operate_ms": 0}],
            "switching": [{"breaker": "QA", "operation": "open", "poles": "A", "at_s": OPENS_S}],
        }
    plant = Plant(Scenario.from_dict(data))
    total, rows = round(data["scenario"]["duration_s"] * FS), []
    rows.append(plant.history(20 * FS // 50)[:, 0].copy())
    while plant.sample_count < total:
        plant.advance(total - plant.sample_count)
        rows.append(plant.samples[:, 0].copy())
    return np.concatenate(rows)


def settings(vt: str) -> RelaySettings:
    known = {"kind": "ideal"} if vt == "ideal" else {"kind": "cvt", "circuit": vt}
    return RelaySettings.from_dict(
        {
            "relay": {"frequency_hz": 50, "sampling_hz": FS, "nominal_kv": 230},
            "line": {"z1_ohm": [3.0, 30.0], "z0_ohm": [12.0, 90.0]},
            "vt": known,
            "pdis": ZONES,
            "rpsb": BOXES,
        }
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--cases", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kind", choices=("swing", "inside", "outside", "after", "pole"), default="inside")
    parser.add_argument("--vt", choices=("ideal", "P1", "P2", "A1", "A2"), default="ideal")
    given = parser.parse_args()
    told, counts, times = settings(given.vt), Counter[str](), []
    for case in range(given.cases):
        data, start_s = scenario(np.random.default_rng([given.seed, case]), given.kind, given.vt)
        x = samples(data, given.kind == "pole")
        before_s = (len(x) - round(data["scenario"]["duration_s"] * FS)) / FS
        relay, opens = Relay(told), round((before_s + OPENS_S + 0.02) * FS)
        events = play(relay, x[:opens])
        if given.kind == "pole":
            relay.inputs = relay.inputs._replace(breaker_closed=0b110)
        events += play(relay, x[opens:])
        found = [event.sample_count / FS - before_s for event in events if event.trip]
        if given.kind != "inside":
            verdict, ms = ("trip" if found else "right"), math.nan
        else:
            ms = 1e3 * (found[0] - (start_s or 0.0)) if found else math.inf
            verdict = "early" if ms < 0 else "right" if ms <= LIMIT_MS else "late" if found else "none"
            times.append(ms)
        counts[verdict] += 1
        if verdict != "right":
            print(f"    case {case}: {verdict}, {ms:.1f} ms, {data.get('fault')}")
    print(f"{given.kind}, VT {given.vt}, {given.cases} cases, seed {given.seed}: {dict(counts)}")
    if times:
        shown = ", ".join(f"{p} % {np.percentile(times, p, method='lower'):.1f}" for p in (50, 95, 99))
        print(f"{shown}, worst {max(times):.1f} ms; limit {LIMIT_MS:g}")


if __name__ == "__main__":
    main()
