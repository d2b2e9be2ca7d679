"""A voltage or current that reaches the relay no more, with a fault and without: zone 1 shall not start.

    python bench/lost_inputs.py [--networks 200] [--cases 20] [--seed 1] [--kind mixed|long|extreme]
                                [--workers 1] [--first 0] [--estimator METHOD] [--list] [--keep]

The networks and the relays are those of bench/security.py.  In a case each relay of A - B loses

    voltage     one to three phases of its voltage transformer's circuit
    current     one to three phases of its current transformer's
    both        one after the other, up to 50 ms apart, in either order

in load, or 5 to 110 ms after a fault has begun behind or beyond it, which goes on or ends after 60 to 150 ms.
A network's cases depend on the seed, its number and the kind alone.
"""

from __future__ import annotations

import argparse
import math
import time
from collections import Counter
from functools import partial
from multiprocessing import Pool
from typing import Any

import numpy as np
from results import keep
from security import FAR, MHO, QUAD, Starts, settings
from security_cases import KINDS, another, draw, fault, tables, view

from faultloop.loop.case import Cases
from faultloop.loop.scenario import Scenario

LOSSES = ("voltage", "current", "both")
FAULT_S, DURATION_S = 0.03, 0.3
PHASES = ("A", "B", "C", "AB", "BC", "CA", "ABC")
Tables = dict[str, Any]


def lose(rng: np.random.Generator, case: Tables, data: Tables, loss: str, begins_s: float) -> str:
    """Put what each relay loses into the scenario's tables; what it was."""
    told = []
    for relay in data["relay"]:
        first = begins_s + float(rng.uniform(0.005, 0.09))
        second = first + float(rng.uniform(0.0, 0.05)) * (loss == "both")
        voltage_s, current_s = (first, second) if rng.random() < 0.5 else (second, first)
        ratios = {"vt": [case["kv"] * 1e3, 100.0], "ct": [1000.0, 1.0]}
        for kind, at_s in (("vt", voltage_s), ("ct", current_s)):
            phases = str(rng.choice(PHASES))
            if loss in ("both", {"vt": "voltage", "ct": "current"}[kind]):
                own = {"name": f"{kind}-{relay['name']}", "ratio": ratios[kind]}
                own |= {"open_at_s": round(at_s, 6), "open_phases": phases}
                data.setdefault(kind, []).append(own)
                relay[kind] = own["name"]
                told.append(f"{relay['name']} {kind} {phases} {1e3 * (at_s - begins_s):.1f}")
    return ", ".join(told)


def network(number: int, given: argparse.Namespace) -> list[tuple[str, str, bool, str]]:
    """Of each relay of each case: what it lost, where the fault is, whether a zone was wrong, a text."""
    case, found, cases = draw(given.seed, number, given.kind), [], Cases()
    told = settings(case, given.estimator)
    for n in range(given.cases):
        rng = np.random.default_rng([given.seed, number, KINDS.index(given.kind), 7, n])
        this, loss = another(case, n), LOSSES[int(rng.integers(3))]
        data, with_fault = tables(this, 1500.0, 4), rng.random() < 0.75
        data["scenario"]["duration_s"] = DURATION_S
        if with_fault:
            data["fault"] = [fault(this) | {"after_s": FAULT_S}]
            if rng.random() < 0.5:
                data["fault"][0]["duration_s"] = float(rng.uniform(0.06, 0.15))
        text = lose(rng, case, data, loss, FAULT_S + 1.0 / case["f0"])  # it waits for its angle
        sink = Starts()
        cases.prepare(Scenario.from_dict(data), {"RA": told, "RB": told}).run([sink], texts=False)
        for end, name in enumerate(("RA", "RB")):
            seen = view(this, end)
            where = seen.where if with_fault else "load"
            if where == "inside":
                continue
            ms = sink.of(name, 0)[1]
            wrong = not (math.isnan(ms[MHO]) and math.isnan(ms[QUAD]))
            wrong |= where in ("behind", "load") and not math.isnan(ms[FAR])
            what = f"    network {number} case {n} {name}: {this['type'] if with_fault else 'load'} {where}"
            what += f" at {seen.at:.2f}, {seen.length:.0f} km, SIR {seen.sir:.2g}; {text}; starts {ms} ms"
            found.append((loss, where, wrong, what))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--networks", type=int, default=200)
    parser.add_argument("--cases", type=int, default=20)
    parser.add_argument("--first", type=int, default=0, help="number of the first network")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--kind", choices=KINDS, default="mixed")
    parser.add_argument("--estimator", default="kalman-bank")
    parser.add_argument("--list", action="store_true", help="every case that is wrong")
    parser.add_argument("--keep", action="store_true", help="leave the figures for docs/evidence.md")
    given = parser.parse_args()
    cases, wrongs = Counter[tuple[str, str]](), Counter[tuple[str, str]]()
    begun = time.monotonic()
    with Pool(given.workers) as pool:
        numbers = range(given.first, given.first + given.networks)
        for found in pool.imap(partial(network, given=given), numbers):
            for loss, where, wrong, text in found:
                cases[loss, where] += 1
                wrongs[loss, where] += wrong
                if given.list and wrong:
                    print(text, flush=True)
    what = (
        f"{given.kind}, seed {given.seed}, {given.networks} networks from {given.first}, {given.cases} cases"
        f" in each, {given.estimator}"
    )
    print(f"{what}, {time.monotonic() - begun:.0f} s")
    print("lost       fault       relays  zone 1, or forward for a fault behind")
    for loss, where in sorted(cases):
        print(f"{loss:10s} {where:10s} {cases[loss, where]:7d} {wrongs[loss, where]:8d}")
    if given.keep:
        figures = []
        for loss in LOSSES:
            own = {where: count for (of, where), count in sorted(cases.items()) if of == loss}
            figures.append(f"{loss}: " + ", ".join(f"{w} {wrongs[loss, w]} of {n:,}" for w, n in own.items()))
        line = f"Zone 1, or a forward zone for a fault behind, where inputs are lost: {what}"
        keep("Security and instrument transformers", [(line, "; ".join(figures))], beside=True)


if __name__ == "__main__":
    main()
