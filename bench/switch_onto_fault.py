"""A line that was in service is closed onto a fault: the relay shall trip for what is near, and soon.

    python bench/switch_onto_fault.py [--cases 3000] [--seed 1] [--list] [--keep]

A line of 15 to 350 km from a source of 0.5 to 30 times its impedance to a load of at most 0.3 of what such a
source can feed; a source whose voltage the line's charge would raise by more than 30 % is none.  A's breaker
opens, the fault begins on the dead line, of any type, and the breaker closes onto it; B's is open in half of
the cases, with which the line keeps its charge.  The voltage is measured at the bus or on the line's side.
Zone 1 is 80 % of the line: within 60 % a trip is due in 100 ms, from 88 % on no zone shall trip (PSOF may:
it reaches beyond the line).
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np
from results import keep

from faultloop.loop.case import Cases
from faultloop.loop.scenario import Scenario
from faultloop.relay import RelaySettings

TYPES = ("AG", "BG", "CG", "AB", "BC", "CA", "ABG", "BCG", "CAG", "ABC", "ABCG")
Z1, Z0, B1, B0 = complex(0.06, 0.4), complex(0.24, 1.2), 2.8, 1.8
"""Of the line, per km [ohm, us]."""
KV = 220.0
HIGHEST_RISE, LARGEST_LOAD, LARGEST_MW = 0.3, 0.3, 200.0
WITHIN, BEYOND, DUE_MS = 0.6, 0.88, 100.0
OPENS_S, FAULT_S = 0.08, 0.15

Case = dict[str, Any]


def draw(rng: np.random.Generator) -> Case:
    """One case."""
    length = float(np.exp(rng.uniform(np.log(15), np.log(350))))
    sir = float(np.exp(rng.uniform(np.log(0.5), np.log(30))))
    sir = min(sir, HIGHEST_RISE / (Z1.imag * B1 * 1e-6 * length**2))
    feeds = KV**2 / abs(sir * Z1 * length)
    return {
        "length": length,
        "sir": sir,
        "mw": min(float(rng.uniform(0, LARGEST_LOAD)) * feeds, LARGEST_MW),
        "type": str(rng.choice(TYPES)),
        "at": float(rng.uniform(0, WITHIN) if rng.random() < WITHIN else rng.uniform(BEYOND, 1)),
        "side": str(rng.choice(["line", "bus"])),
        "charged": bool(rng.integers(2)),
        "closes_s": float(rng.uniform(0.40, 0.44)),
    }


def tables(case: Case) -> dict[str, Any]:
    """The scenario."""
    z = case["sir"] * Z1 * case["length"]
    breaker = {"name": "QA", "line": "AB", "end": "from", "closed": True}
    return {
        "scenario": {"name": "switch onto fault", "duration_s": 0.6},
        "system": {"frequency_hz": 50, "base_kv": KV},
        "source": [
            {"name": "SA", "bus": "A", "z1_ohm": [z.real, z.imag], "z0_ohm": [1.5 * z.real, 1.5 * z.imag]}
        ],
        "line": [
            {
                "name": "AB", "from": "A", "to": "B", "length_km": case["length"],
                "r1_ohm_per_km": Z1.real, "x1_ohm_per_km": Z1.imag, "b1_us_per_km": B1,
                "r0_ohm_per_km": Z0.real, "x0_ohm_per_km": Z0.imag, "b0_us_per_km": B0,
            }
        ],
        "breaker": [breaker, breaker | {"name": "QB", "end": "to", "closed": not case["charged"]}],
        "relay": [
            {
                "name": "RA", "line": "AB", "end": "from", "breaker": "QA", "settings": "none",
                "voltage_at": case["side"],
            }
        ],
        "load": [{"name": "L", "bus": "B", "mw": max(case["mw"], 0.1), "mvar": 0.0}],
        "switching": [
            {"name": "S1", "breaker": "QA", "operation": "open", "at_s": OPENS_S},
            {"name": "S2", "breaker": "QA", "operation": "close", "at_s": case["closes_s"]},
        ],
        "fault": [{"line": "AB", "at_pu": case["at"], "type": case["type"], "start_s": FAULT_S}],
        "front_end": {"antialias_hz": 1500.0, "antialias_order": 4},
    }  # fmt: skip


def settings(case: Case) -> RelaySettings:
    """Of the relay at A."""
    z1, z0 = Z1 * case["length"], Z0 * case["length"]
    return RelaySettings.from_dict(
        {
            "relay": {"frequency_hz": 50, "nominal_kv": KV},
            "vt": {"kind": "ideal"},
            "line": {"z1_ohm": [z1.real, z1.imag], "z0_ohm": [z0.real, z0.imag]},
            "pdis": [{"zone": 1, "reach_pu": 0.8}],
        }
    )


def trips(case: Case) -> list[tuple[str, float]]:
    """Function and time from the closing [ms] of each trip; before it, negative."""
    done = Cases().prepare(Scenario.from_dict(tables(case)), {"RA": settings(case)}).run()
    return [(trip.function, trip.t_ns / 1e6 - 1e3 * case["closes_s"]) for trip in done.trips]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--cases", type=int, default=3000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--list", action="store_true", help="every wrong case")
    parser.add_argument("--keep", action="store_true", help="leave the figures for docs/evidence.md")
    given = parser.parse_args()
    rng = np.random.default_rng(given.seed)
    due = beyond = late = wrong = 0
    times = []
    for _ in range(given.cases):
        case = draw(rng)
        found = trips(case)
        if case["at"] <= WITHIN:
            due += 1
            bad = not found or not 0 <= found[0][1] <= DUE_MS
            late += bad
            times += [found[0][1]] if found else []
        else:
            beyond += 1
            bad = any(function.startswith("PDIS") or ms < 0 for function, ms in found)
            wrong += bad
        if given.list and bad:
            print({key: round(x, 4) if isinstance(x, float) else x for key, x in case.items()}, found)
    figure = (
        f"within 60 % of the line {late} of {due} not within {DUE_MS:g} ms, median {np.median(times):.1f}, "
        f"95 % {np.percentile(times, 95):.1f}, worst {max(times):.1f} ms; from 88 % on "
        f"a zone trips in {wrong} of {beyond}"
    )
    print(figure)
    if given.keep:
        line = (
            f"Closed onto a fault, voltage at the bus or the line, {given.cases} cases of seed {given.seed}"
        )
        keep("Security and instrument transformers", [(line, figure)], beside=True)


if __name__ == "__main__":
    main()
