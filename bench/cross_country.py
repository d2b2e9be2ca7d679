"""Two faults at two places, the second some milliseconds after the first: what zone 1 makes of them.

    python bench/cross_country.py [--cases 400] [--seed 1] [--what on-line|outside|beyond]

Random networks X - A - B - C (sources of 0.1 to 30 times the line, load of -30 to 30 degrees, lines of 20 to
150 km), a relay at A with a mho and a quadrilateral of 80 % of A - B, bolted faults that go on.  ``on-line``:
the first behind the relay or beyond the line, the second on the line to 60 % in phases of which one at least
was healthy; right is a start of zone 1 within 60 ms of the second, and none before it.  ``outside``: one
behind, one beyond; ``beyond``: both beyond; right is none.  Cases that are not right are listed.
"""

from __future__ import annotations

import argparse
import math
from typing import Any, NamedTuple

import numpy as np

from faultloop.loop.scenario import Scenario
from faultloop.plant import Plant
from faultloop.relay import Relay, RelaySettings

RATE, WARM, TOTAL = 4800, 1920, 960
FIRST_S, SOON_MS = 0.06, 60.0
TYPES = ("AG", "BG", "CG", "AB", "BC", "CA", "ABG", "BCG", "CAG", "ABC")
PER_KM = {"r1": 0.06, "x1": 0.40, "b1": 2.8, "r0": 0.24, "x0": 1.20, "b0": 1.8}


class Case(NamedTuple):
    number: int
    sir: tuple[float, float]
    load: float
    km: tuple[float, float, float]
    place: tuple[str, str]
    at: tuple[float, float]
    kind: tuple[str, str]
    after_ms: float
    angle: float


def draw(seed: int, number: int, what: str) -> Case:
    rng = np.random.default_rng([seed, number, len(what)])

    def ratio() -> float:
        return math.exp(rng.uniform(math.log(0.1), math.log(30)))

    sir, load = (ratio(), ratio()), float(rng.uniform(-30, 30))
    near, own, far = (float(x) for x in np.exp(rng.uniform(math.log(20), math.log(150), 3)))
    outside = ("XA", "BC") if rng.random() < 0.5 else ("BC", "XA")
    place = {"on-line": (outside[0], "AB"), "outside": outside, "beyond": ("BC", "BC")}[what]
    at = float(rng.random()), float(rng.uniform(0.02, 0.6) if what == "on-line" else rng.random())
    while True:
        kind = str(rng.choice(TYPES)), str(rng.choice(TYPES))
        if what != "on-line" or set(kind[1]) - set(kind[0]) - {"G"}:
            break
    after, angle = float(rng.uniform(2, 60)), float(rng.uniform(0, 360))
    return Case(number, sir, load, (near, own, far), place, at, kind, after, angle)


def record(case: Case) -> np.ndarray:
    """(n, 6) at A, from `WARM` samples before the beginning on."""
    lengths = dict(zip(("XA", "AB", "BC"), case.km, strict=True))
    line = {f"{k}_{'us' if k[0] == 'b' else 'ohm'}_per_km": x for k, x in PER_KM.items()}
    size = case.km[1] * math.hypot(PER_KM["r1"], PER_KM["x1"])
    sources = []
    for bus, sir, angle in (("X", case.sir[0], case.load), ("C", case.sir[1], 0.0)):
        z = np.array([0.08, 0.9968]) * size * sir
        sources.append({"name": f"S{bus}", "bus": bus, "angle_deg": angle,
                        "z1_ohm": z.tolist(), "z0_ohm": (1.5 * z).tolist()})  # fmt: skip
    faults = [
        {"name": "F1", "line": case.place[0], "at_pu": case.at[0], "type": case.kind[0],
         "start_s": FIRST_S + case.angle / 360 / 50},
        {"name": "F2", "line": case.place[1], "at_pu": case.at[1], "type": case.kind[1],
         "start_s": FIRST_S + case.angle / 360 / 50 + case.after_ms / 1e3},
    ]  # fmt: skip
    tables: dict[str, Any] = {
        "scenario": {"name": "cross-country", "duration_s": TOTAL / RATE},
        "system": {"frequency_hz": 50, "base_kv": 220},
        "source": sources,
        "line": [
            {"name": n, "from": n[0], "to": n[1], "length_km": km, "model": "bergeron", **line}
            for n, km in lengths.items()
        ],
        "fault": faults,
        "relay": [{"name": "R", "line": "AB", "end": "from", "settings": "none"}],
        "front_end": {"antialias_hz": 1500},
    }
    plant = Plant(Scenario.from_dict(tables))
    blocks = [plant.history(WARM)[:, 0]]
    while plant.sample_count < TOTAL:
        done = plant.advance(TOTAL - plant.sample_count)
        blocks.append(plant.samples[:done, 0].copy())
    return np.concatenate(blocks)


def settings(case: Case) -> RelaySettings:
    z1 = [case.km[1] * PER_KM["r1"], case.km[1] * PER_KM["x1"]]
    z0 = [case.km[1] * PER_KM["r0"], case.km[1] * PER_KM["x0"]]
    size = math.hypot(*z1)
    quad = {
        "characteristic": "quad",
        "resistive_reach_ohm": 0.5 * size,
        "resistive_reach_ground_ohm": 0.75 * size,
    }
    return RelaySettings.from_dict(
        {
            "relay": {"frequency_hz": 50, "nominal_kv": 220},
            "vt": {"kind": "ideal"},
            "line": {"z1_ohm": z1, "z0_ohm": z0},
            "pdis": [
                {"zone": 1, "reach_pu": 0.8},
                {"zone": 1, "reach_pu": 0.8, **quad},
                {"zone": 3, "reach_pu": 0.5, "direction": "reverse", "delay_ms": 1000.0},
            ],
            "ptrc": {"zones": [3]},
        }
    )  # fmt: skip


def start_ms(case: Case) -> float:
    """Of zone 1, after the second fault; NaN if it does not."""
    x, relay, done = record(case), Relay(settings(case)), 0
    while done < len(x):
        m = relay.advance(x[done:])
        on = np.flatnonzero(relay.pickup[:m] & np.uint64(0b11))
        if len(on):
            at_s = (done + on[0] - WARM) / RATE
            return 1e3 * (at_s - FIRST_S - case.angle / 360 / 50) - case.after_ms
        done += m
    return math.nan


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--cases", type=int, default=400)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--what", choices=("on-line", "outside", "beyond"), default="on-line")
    given = parser.parse_args()
    times = []
    for number in range(given.cases):
        case = draw(given.seed, number, given.what)
        t = start_ms(case)
        times.append(t)
        if t == t if given.what != "on-line" else not 0.0 < t < SOON_MS:
            print(f"    {t:7.1f} ms", case, flush=True)
    t = np.array(times)
    early, late = int((t < 0).sum()), int((t >= SOON_MS).sum())
    print(f"{given.what}, seed {given.seed}, {given.cases} cases: started {np.isfinite(t).sum()},")
    print(f"  before the second {early}, later than {SOON_MS:g} ms {late}, never {np.isnan(t).sum()}")
    if given.what == "on-line":
        soon = t[(t > 0) & (t < SOON_MS)]
        print(
            f"  median, 95 %, worst {np.median(soon):.1f} {np.percentile(soon, 95):.1f} {soon.max():.1f} ms"
        )


if __name__ == "__main__":
    main()
