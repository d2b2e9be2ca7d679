"""Faults that inverters feed: does the direction set for inverters ever say the wrong side, does zone 1
overreach?

    python bench/inverters.py [--cases 10000] [--seed 2001] [--plain]

The 230 kV network of ``faultloop/study/suites/functions/inverter_network.py``: a plant of 20 to 100 MW at
B3, its control's negative sequence free or controlled (k2 2 to 6), k1 2 to 6, limit 1.1 to 1.4, filter 0.1
to 0.25; sources at B1 and B2 of 5 to 10 and 10 to 30 ohm, 15 degrees apart at most; L13 out of service in
two thirds of the cases. A fault of any type at any angle: on L23 (R1 and R2 look at it), at B3 (behind R1),
at B2 or on L12 within 80 % of it (behind R2), bolted in half, else of 0.1 to 100 ohm.  ``--plain``: the same
without the settings for inverters.
"""

from __future__ import annotations

import argparse
from collections import Counter

import numpy as np

from faultloop.study.suites.functions.inverter_network import Fault, by_relay, record, settings, tables

TYPES = ("AG", "BG", "CG", "AB", "BC", "CA", "ABG", "BCG", "CAG", "ABC", "ABCG")
PLACES = ("L23", "B3", "B2", "L12")
SECURE = 0.85
"""Of the line: from here on zone 1 of 80 % must not operate."""


def draw(seed: int, number: int) -> tuple[Fault, dict, bool, dict]:
    rng = np.random.default_rng([seed, number])
    inverter = {
        "power_mw": float(rng.uniform(20, 100)),
        "negative_sequence": str(rng.choice(["none", "controlled"])),
        "k1": float(rng.uniform(2, 6)),
        "k2": float(rng.uniform(2, 6)),
        "current_limit_pu": float(rng.uniform(1.1, 1.4)),
        "filter_pu": float(rng.uniform(0.1, 0.25)),
    }
    place = str(rng.choice(PLACES, p=[0.5, 0.15, 0.15, 0.2]))
    at = float(rng.uniform(0.02, 0.98)) if place == "L23" else float(rng.uniform(0.2, 0.98))
    ohm = 0.0 if rng.random() < 0.5 else float(np.exp(rng.uniform(np.log(0.1), np.log(100))))
    fault = Fault(str(rng.choice(TYPES)), place, at, ohm, float(rng.uniform(0, 360)))
    network = {
        "z_b1": float(rng.uniform(5, 10)),
        "z_b2": float(rng.uniform(10, 30)),
        "angle_deg": float(rng.uniform(-15, 15)),
    }
    return fault, inverter, bool(rng.random() < 2 / 3), network


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--cases", type=int, default=10000)
    parser.add_argument("--seed", type=int, default=2001)
    parser.add_argument("--plain", action="store_true")
    given = parser.parse_args()
    told = {name: settings(name, not given.plain) for name in ("R1", "R2")}
    counts: Counter[tuple[str, ...]] = Counter()
    times = []
    for number in range(given.cases):
        fault, inverter, radial, network = draw(given.seed, number)
        both, start, hz = record(tables(fault, inverter, radial, **network))
        for k, name in enumerate(("R1", "R2")):
            forward = fault.place != ("B3" if name == "R1" else "B2")
            if name == "R2" and fault.place == "L12":
                forward = False
            said = by_relay(both[k], start, told[name])
            true = 1 if forward else -1
            group = (name, "radial" if radial else "meshed", "ahead" if forward else "behind")
            counts[*group, "cases"] += 1
            counts[*group, "wrong direction"] += bool((said.direction == -true).any())
            counts[*group, "right direction"] += bool((said.direction == true).any())
            where = fault.at if name == "R1" else 1 - fault.at
            inside = fault.place == "L23"
            outside = not inside or where > SECURE
            counts[*group, "zone 1 outside"] += bool(outside and said.zones[:, 0].any())
            counts[*group, "zone 2 behind"] += bool(not forward and said.zones[:, 1].any())
            if inside and where < 0.7 and fault.resistance == 0.0:
                counts[*group, "bolted within 70 %"] += 1
                counts[*group, "zone 1 of them"] += bool(said.zones[:, 0].any())
                times += [1e3 * np.flatnonzero(said.zones[:, 0])[0] / hz] if said.zones[:, 0].any() else []
            bad = (said.direction == -true).any() or (outside and said.zones[:, 0].any())
            if bad and sum(counts[key] for key in counts if key[3] == "told") < 25:
                counts[*group, "told"] += 1
                print("   ", number, group, fault, inverter, network, said.zones.any(0))
    print(f"{given.cases} cases, seed {given.seed}, {'plain' if given.plain else 'set for inverters'}")
    for group in sorted({key[:3] for key in counts}):
        print(*group, {key[3]: n for key, n in counts.items() if key[:3] == group and key[3] != "told"})
    if times:
        median, late = np.percentile(times, [50, 95])
        print(f"zone 1, bolted within 70 %: median {median:.1f}, 95 % {late:.1f} ms")


if __name__ == "__main__":
    main()
