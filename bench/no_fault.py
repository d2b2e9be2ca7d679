"""Networks without a fault in which something is switched: zone 1 shall not start, and nothing trip.

    python bench/no_fault.py [--networks 200] [--operations 20] [--seed 1] [--kind mixed|long|extreme]
                             [--workers 1] [--first 0] [--vt ideal|unknown] [--estimator METHOD] [--list]
                             [--keep]

The networks and the relays are those of bench/security.py, with PSOF and a breaker at either end of A - B,
45 to 55 or 54 to 66 Hz.  An operation is one of

    load        a load beyond A or B is switched on or off, alone larger than what A - B carries mostly
    parallel    a line beside A - B is opened or closed, one end after the other
    opening     a breaker of A - B opens, or both do, one up to 60 ms after the other
    energising  A - B is closed at A, and at B later, or the other way round; dead for 260 ms before
    neighbour   the line before A, or the one beyond B, opens: with it a source is gone
    frequency   that of both sources steps by up to 2.5 Hz

with poles that open or close up to 3 ms apart, and the voltage measured on either side of the breaker.  A
network has one of them at so many instants, and so one state before; it depends on the seed, its number and
the kind alone.
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
from security import MHO, QUAD, Starts, settings
from security_cases import KINDS, draw, log_uniform, tables

from faultloop.errors import InputError
from faultloop.loop.case import Cases
from faultloop.loop.scenario import Scenario
from faultloop.relay import RelaySettings

OPERATIONS = ("load", "parallel", "opening", "energising", "neighbour", "frequency")
AT_S, CLOSES_S, AFTER_S = 0.04, 0.26, 0.2
"""When it happens; when a dead line is closed; how long the run goes on."""
SCATTER_S = 0.003
LEAST_LOAD = 4.0
"""Impedance of a load over that of the source behind its bus, at least: a fifth of the voltage."""


def switching(rng: np.random.Generator, breaker: str, operation: str, at_s: float) -> list[dict[str, Any]]:
    """Three poles, one after the other."""
    late = rng.uniform(0, SCATTER_S, 3) if rng.random() < 0.7 else np.zeros(3)
    return [
        {"breaker": breaker, "operation": operation, "poles": pole, "at_s": round(at_s + wait, 6)}
        for pole, wait in zip("ABC", late.tolist(), strict=True)
    ]


def breaker(name: str, line: str, end: str, closed: bool = True) -> dict[str, Any]:
    return {"name": name, "line": line, "end": end, "closed": closed}


Tables = dict[str, Any]
Random = np.random.Generator


def load(own: Random, case: Tables, data: Tables, operation: str) -> None:
    """Behind a short line at A or B."""
    source, near = (("X", "near"), ("C", "far"))[int(own.integers(2))]
    per_km = math.hypot(case["line"]["r1_ohm_per_km"], case["line"]["x1_ohm_per_km"])
    behind = math.hypot(*case[source]["z1_ohm"]) + case[near] * per_km
    size, angle = behind * LEAST_LOAD * log_uniform(own, 1, 20), own.uniform(-0.3, 0.6)
    mva = case["kv"] ** 2 / size
    plain = {key: value for key, value in case["line"].items() if not key.startswith("b")} | {"model": "rl"}
    data["line"].append({"name": "AD", "from": "AB"[source == "C"], "to": "D", "length_km": 5.0, **plain})
    data["load"] = [{"name": "L", "bus": "D", "mw": mva * math.cos(angle), "mvar": mva * math.sin(angle)}]
    data["breaker"].append(breaker("QD", "AD", "from", operation == "open"))


def in_turn(rng: np.random.Generator, names: tuple[str, str], operation: str, at_s: float) -> list[dict]:
    """Both ends, in either order, up to 60 ms apart."""
    first, second = names if rng.random() < 0.5 else names[::-1]
    wait = float(rng.uniform(0.0, 0.06))
    return switching(rng, first, operation, at_s) + switching(rng, second, operation, at_s + wait)


def operate(own: Random, rng: Random, case: Tables, data: Tables, kind: str) -> None:
    """Put the operation into the scenario's tables; ``own``: the network's numbers."""
    at_s = (CLOSES_S if kind == "energising" else AT_S) + float(rng.uniform(0, 0.02))
    data["scenario"]["duration_s"] = at_s + AFTER_S
    operation, one = str(own.choice(["open", "close"])), int(own.integers(2))
    closed = kind != "energising"
    data["breaker"] = [breaker("QA", "AB", "from", closed), breaker("QB", "AB", "to", closed)]
    side = str(own.choice(["bus", "line"]))
    for relay, name in zip(data["relay"], ("QA", "QB"), strict=True):
        relay |= {"breaker": name, "voltage_at": side}
    if kind == "load":
        load(own, case, data, operation)
        data["switching"] = switching(rng, "QD", operation, at_s)
    elif kind == "parallel":
        before = operation == "open"
        data["breaker"] += [breaker("PA", "PP", "from", before), breaker("PB", "PP", "to", before)]
        data["switching"] = in_turn(rng, ("PA", "PB"), operation, at_s)
    elif kind in ("opening", "energising"):
        both = in_turn(rng, ("QA", "QB"), "close" if kind == "energising" else "open", at_s)
        data["switching"] = both if rng.random() < 0.6 else both[:3]
    elif kind == "neighbour":
        data["breaker"].append(breaker("QN", *(("XA", "to"), ("BC", "from"))[one]))
        data["switching"] = switching(rng, "QN", "open", at_s)
    else:
        turned = 360 * float(rng.uniform(-2.5, 2.5)) * AFTER_S
        data["swing"] = [
            {"source": name, "at_s": [0.0, at_s, at_s + AFTER_S], "angle_deg": [angle, angle, angle + turned]}
            for name, angle in (("SX", 0.0), ("SC", -case["load"]))
        ]


def network(number: int, given: argparse.Namespace) -> list[tuple[str, bool, bool, str]]:
    """Of each operation its kind, whether zone 1 started and anything tripped, and what it was."""
    case, found, cases = draw(given.seed, number, given.kind), [], Cases()
    kind, seed = OPERATIONS[number % len(OPERATIONS)], [given.seed, number, KINDS.index(given.kind)]
    case["parallel"] |= kind == "parallel"
    told = settings(case, given.estimator, given.vt)
    told = RelaySettings.from_dict(told.model_dump(exclude_unset=True) | {"psof": {}})
    for n in range(given.operations):
        data = tables(case, 1500.0, 4)
        operate(np.random.default_rng(seed), np.random.default_rng([*seed, n]), case, data, kind)
        sink = Starts()
        text = f"network {number} operation {n}: {kind}, {case['length']:.0f} km, {case['line']['model']}"
        try:
            ready = cases.prepare(Scenario.from_dict(data), {"RA": told, "RB": told})
            done = ready.run([sink], texts=False)
        except InputError as error:
            raise SystemExit(f"{text}: {error}") from error
        times = [sink.of(name, 0)[1] for name in ("RA", "RB")]
        started = any(not math.isnan(ms[zone]) for ms in times for zone in (MHO, QUAD))
        trips = [f"{trip.relay} {trip.function}" for trip in done.trips]
        found.append((kind, started, bool(trips), f"    {text}; starts {times} ms, trips {trips}"))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--networks", type=int, default=200)
    parser.add_argument("--operations", type=int, default=20)
    parser.add_argument("--first", type=int, default=0, help="number of the first network")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--kind", choices=KINDS, default="mixed")
    parser.add_argument("--estimator", default="kalman-bank")
    parser.add_argument("--vt", choices=("ideal", "unknown"), default="ideal", help="what the relay is told")
    parser.add_argument("--list", action="store_true", help="every case that is wrong")
    parser.add_argument("--keep", action="store_true", help="leave the figures for docs/evidence.md")
    given = parser.parse_args()
    cases, starts, trips = Counter[str](), Counter[str](), Counter[str]()
    begun = time.monotonic()
    with Pool(given.workers) as pool:
        numbers = range(given.first, given.first + given.networks)
        for found in pool.imap(partial(network, given=given), numbers):
            for kind, started, tripped, text in found:
                cases[kind] += 1
                starts[kind] += started
                trips[kind] += tripped
                if given.list and (started or tripped):
                    print(text, flush=True)
    what = (
        f"{given.kind}, seed {given.seed}, {given.networks} networks from {given.first}, {given.operations}"
        f" operations in each, VT {given.vt}, {given.estimator}"
    )
    print(f"{what}, {time.monotonic() - begun:.0f} s")
    print("operation        cases  zone 1 started  tripped")
    for kind in OPERATIONS:
        print(f"{kind:12s} {cases[kind]:9d} {starts[kind]:15d} {trips[kind]:8d}")
    print(f"{'all':12s} {cases.total():9d} {starts.total():15d} {trips.total():8d}")
    if given.keep:
        figure = f"zone 1 starts in {starts.total()}, trips in {trips.total()} of {cases.total():,}"
        line = f"Without a fault, something switched: {what}"
        keep("Security and instrument transformers", [(line, figure)], beside=True)


if __name__ == "__main__":
    main()
