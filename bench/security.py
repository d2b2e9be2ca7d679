"""Security and speed of zone 1 over random faults: wrong answers by kind, times to the start of the zone.

    python bench/security.py [--networks 2000] [--faults 1] [--seed 1001] [--kind mixed|long|extreme]
                             [--workers 1] [--first 0] [--antialias 1500] [--order 4]
                             [--estimator METHOD] [--vt ideal|unknown] [--no-charging] [--functions]
                             [--list] [--out FILE.npy] [--keep]

A case is a network X - A - B - C drawn by `security_cases.draw`, a fault in it, and two relays, at both ends
of A - B, in the closed loop that a campaign runs.  Each has a mho and a quadrilateral of 80 % of the line
without delay, a reverse zone of 50 % and one of 120 %.  There are no breakers: they take longer than zone 1.
With ``--faults`` above 1 a network gets so many, four at a place, and a case costs a third (some 8 ms).  The
low-pass is of order 4: one of order 2 lets a tenth through of what short lines ring with near the sampling
frequency, which then is folded to the nominal one and no relay can tell it from the fault.  The seeds up to
100 served for choosing the method and its limits; judge with others.  ``--no-charging``: the relay is not
told the line's charging, as it is where a line has any.  ``--functions``: with every
other function of the relay at work beside the zones, none of which trips.  ``--list`` tells every wrong and
every slow case.  A network's cases depend on the seed, its number and the kind alone: ``--first N --networks
1`` runs one again.  ``--out`` keeps the answers, a row a relay, and goes on where a run of the same was
stopped; ``--table NAME=FILE ...`` prints the table of docs/relay.md from such files; ``--keep`` leaves
them for docs/evidence.md.
"""

from __future__ import annotations

import argparse
import time
from functools import partial
from multiprocessing import Pool
from pathlib import Path
from typing import Any

import numpy as np
from results import keep
from security_cases import KINDS, TYPES, another, draw, fault, scenario, view

from faultloop.loop.case import Cases
from faultloop.loop.recording import MemorySink
from faultloop.loop.scenario import Scenario
from faultloop.relay import RelaySettings

MHO, QUAD, REVERSE, FAR = range(4)
INSIDE, DEPENDABLE, SECURE = 0.6, 0.76, 0.84
"""Of the line: up to here it shall operate soon; up to here, by what a relay measures, at all; from here on
not at all."""
WHERE = ("behind", "inside", "beyond", "parallel")
SLOW_MS = {150: 20.0, 1e9: 30.0}
"""By the line's length [km]: the limits of the time within `INSIDE`."""
WEAK = 3.0
"""SIR from which on a relay that knows nothing of its voltage transformer may wait."""
ANSWER = np.dtype(
    [(name, "i4") for name in ("network", "fault", "end", "where", "type")]
    + [(name, "f4") for name in ("at", "sir", "length", "measured")]
    + [("bolted", "?"), ("before", "?"), ("ms", "f4", 4)]
)
"""What one relay did: its place, and when each zone started after the fault [ms], NaN if it did not."""


class Starts(MemorySink):
    """Keeps when each zone of each relay starts."""

    def __init__(self) -> None:
        super().__init__()
        self.on: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {"RA": [], "RB": []}

    def add_relay(self, name: str, bits: Any, characteristics: Any = None) -> None:
        """The zones are the first four bits."""
        assert [bit.partition(".")[0] for bit in bits[:4]] == [f"PDIS{n}" for n in (1, 2, 3, 4)], bits

    def relay_block(self, name: str, *arrays: np.ndarray) -> None:
        """Only the pickups and their time."""
        self.on[name].append((arrays[0].copy(), arrays[5].copy()))

    def of(self, name: str, fault_ns: int) -> tuple[bool, list[float]]:
        """Whether any zone started before the fault; when each did after it [ms]."""
        t_ns, pickup = (np.concatenate(column) for column in zip(*self.on[name], strict=True))
        after = t_ns >= fault_ns
        times = []
        for zone in (MHO, QUAD, REVERSE, FAR):
            at = np.flatnonzero(after & (pickup >> np.uint64(zone) & np.uint64(1)).astype(bool))
            times.append(1e-6 * (int(t_ns[at[0]]) - fault_ns) if len(at) else np.nan)
        return bool((pickup[~after] & np.uint64(0b1111)).any()), times


def others(case: dict, z1: float, resistive: float) -> dict:
    """Tables of all that may block a zone, or runs beside it."""
    volts, f0 = case["kv"] * 1e3 / np.sqrt(3), case["f0"]
    inner, stage = 1.1 * max(0.6 * z1, resistive), {"pickup_a": 1e4, "trip": False}
    return {
        "tvtr": {},
        "rpsb": {"inner_resistance_ohm": inner, "outer_resistance_ohm": 1.4 * inner},
        "zload": {"resistance_ohm": 1.5 * inner},
        "pioc": [stage | {"direction": "forward"}],
        "ptoc": [stage | {"curve": "iec-normal-inverse", "direction": "forward"}],
        "ptuv": [{"start_v": 0.5 * volts, "trip": False}],
        "ptov": [{"start_v": 1.5 * volts, "trip": False}],
        "ptuf": [{"start_hz": 0.94 * f0, "trip": False}],
        "ptof": [{"start_hz": 1.06 * f0, "trip": False}],
        "pfrc": [{"start_hz_per_s": 5.0, "trip": False}],
        "rbrf": {"current_a": 100.0},
        "rrec": {},
    }


def settings(
    case: dict, method: str, vt: str = "ideal", functions: bool = False, charging: bool = True
) -> RelaySettings:
    line, length = case["line"], case["length"]
    z1 = [line["r1_ohm_per_km"] * length, line["x1_ohm_per_km"] * length]
    z0 = [line["r0_ohm_per_km"] * length, line["x0_ohm_per_km"] * length]
    told = {"z1_ohm": z1, "z0_ohm": z0}
    if charging and "b1_us_per_km" in line:
        told |= {f"b{n}_us": line[f"b{n}_us_per_km"] * length for n in (1, 0)}
    resistive = float(np.clip(np.hypot(*z1), 2, 40))
    return RelaySettings.from_dict(
        {
            "relay": {"frequency_hz": case["f0"], "nominal_kv": case["kv"]},
            "estimator": {"method": method, "unsafe": True},
            "line": told,
            "vt": {} if vt == "unknown" else {"kind": vt},
            "pdis": [
                {"zone": 1, "reach_pu": 0.8},
                {"zone": 2, "reach_pu": 0.8, "characteristic": "quad", "resistive_reach_ohm": resistive},
                {"zone": 3, "reach_pu": 0.5, "direction": "reverse", "delay_ms": 1000.0},
                {"zone": 4, "reach_pu": 1.2, "delay_ms": 1000.0},
            ],
            "ptrc": {"zones": [4]},
            **(others(case, float(np.hypot(*z1)), resistive) if functions else {}),
        }
    )


def network(number: int, given: argparse.Namespace) -> np.ndarray:
    """All faults of a network, (2 * faults,) ANSWER."""
    case, cases = draw(given.seed, number, given.kind), Cases()
    base = scenario(case, given.antialias, given.order)
    tables = {name: getattr(base, name) for name in type(base).model_fields}
    told = settings(case, given.estimator, given.vt, given.functions, not given.no_charging)
    answers = np.zeros(2 * given.faults, ANSWER)
    for n in range(given.faults):
        this = another(case, n)
        sink = Starts()
        ready = Scenario.of_named(tables | {"fault": [{"name": "F1"} | fault(this)]})
        done = cases.prepare(ready, {"RA": told, "RB": told}).run([sink], texts=False)
        start = done.fault_start_ns
        assert start is not None
        for end, name in enumerate(("RA", "RB")):
            seen, row = view(this, end), answers[2 * n + end]
            row["network"], row["fault"], row["end"] = number, n, end
            row["where"], row["type"] = WHERE.index(seen.where), TYPES.index(this["type"])
            for key in ("at", "sir", "length", "measured", "bolted"):
                row[key] = getattr(seen, key)
            row["before"], row["ms"] = sink.of(name, start)
    return answers


def told(row: np.ndarray) -> str:
    """A case for a person."""
    times = "/".join(f"{ms:.1f}" for ms in row["ms"])
    return (
        f"    network {row['network']} fault {row['fault']} end {row['end']}: {WHERE[row['where']]}"
        f" at {row['at']:.3f}, {TYPES[row['type']]}{'' if row['bolted'] else ' with resistance'},"
        f" {row['length']:.0f} km, SIR {row['sir']:.2g}, measured {row['measured']:.3f}; {times} ms"
    )


def tell(a: np.ndarray, listed: bool) -> None:
    """The figures of (n,) ANSWER."""
    first = np.fmin(a["ms"][:, MHO], a["ms"][:, QUAD])
    started = ~np.isnan(a["ms"])
    any_zone_1 = ~np.isnan(first)
    at = {name: a["where"] == number for number, name in enumerate(WHERE)}

    def share(name: str, chosen: np.ndarray, wrong: np.ndarray) -> None:
        wrong = chosen & wrong
        print(f"{name:52s} {wrong.sum():5d} of {chosen.sum()}")
        for row in a[wrong] if listed else ():
            print(told(row))

    for bolted in (True, False):
        kind = "bolted" if bolted else "with resistance"
        for where in ("behind", "beyond", "parallel"):
            share(f"zone 1 for a fault {where}, {kind}", at[where] & (a["bolted"] == bolted), any_zone_1)
    inside = at["inside"] & a["bolted"]
    share(f"zone 1 beyond {SECURE:.0%} of the line, bolted", inside & (a["at"] > SECURE), any_zone_1)
    share("forward zone of 120 % for a fault behind", at["behind"], started[:, FAR])
    share("reverse zone for a fault ahead", at["inside"] | at["beyond"], started[:, REVERSE])
    share("any start before the fault", np.ones(len(a), bool), a["before"])
    near = inside & (a["measured"] <= DEPENDABLE)
    for zone, name in ((MHO, "mho"), (QUAD, "quadrilateral")):
        share(f"no zone 1 ({name}) for {DEPENDABLE:.0%} of the line, bolted", near, ~started[:, zone])
    within = inside & (a["at"] <= INSIDE)
    for length, limit in SLOW_MS.items():
        of_length = within & (a["length"] <= length) & (a["sir"] <= 30) & any_zone_1
        if limit == SLOW_MS[1e9]:
            of_length &= a["length"] > min(SLOW_MS)
        share(f"within {INSIDE:.0%}, SIR to 30, later than {limit:g} ms", of_length, first > limit)
    print(f"\nbolted within {INSIDE:.0%}: start of zone 1 [ms]        median   95 %  worst  missed")
    for name, low, high, least, most in (
        ("to 150 km, SIR 0.1 to 30", 0, 150, 0, 30),
        ("longer, SIR 0.1 to 30", 150, 1e9, 0, 30),
        ("SIR to 3", 0, 1e9, 0, 3),
        ("SIR 3 to 10", 0, 1e9, 3, 10),
        ("SIR 10 to 30", 0, 1e9, 10, 30),
        ("SIR above 30", 0, 1e9, 30, 1e9),
    ):
        chosen = (
            within & (a["length"] > low) & (a["length"] <= high) & (a["sir"] > least) & (a["sir"] <= most)
        )
        t = first[chosen & any_zone_1]
        if len(t):
            figures = f"{np.median(t):6.1f} {np.percentile(t, 95):6.1f} {t.max():6.1f}"
            print(f"  {name:28s} {chosen.sum():6d}           {figures} {chosen.sum() - len(t):7d}")


def column(a: np.ndarray) -> dict[str, str]:
    """The figures of (n,) ANSWER as docs/relay.md has them, by the row's name."""
    first = np.fmin(a["ms"][:, MHO], a["ms"][:, QUAD])
    started, at = ~np.isnan(a["ms"]), {name: a["where"] == number for number, name in enumerate(WHERE)}
    zone_1 = ~np.isnan(first)

    def share(chosen: np.ndarray, wrong: np.ndarray) -> str:
        count = int((chosen & wrong).sum())
        text = f"{count} of {chosen.sum():,}"
        return f"**{text}**" if count else text

    def times(chosen: np.ndarray) -> str:
        t = first[chosen & zone_1]
        if not len(t):
            return ""
        return f"{np.median(t):.1f}, {np.percentile(t, 95):.1f}, {t.max():.1f} ({len(t):,})"

    bolted, inside = a["bolted"], at["inside"] & a["bolted"]
    near, within = inside & (a["measured"] <= DEPENDABLE), inside & (a["at"] <= INSIDE) & (a["sir"] <= 30)
    short = a["length"] <= min(SLOW_MS)
    return {
        "bolted fault behind": share(at["behind"] & bolted, zone_1),
        "bolted, beyond the far bus": share(at["beyond"] & bolted, zone_1),
        "bolted, on the parallel line": share(at["parallel"] & bolted, zone_1),
        f"bolted, beyond {SECURE:.0%} of the line": share(inside & (a["at"] > SECURE), zone_1),
        "with resistance, behind": share(at["behind"] & ~bolted, zone_1),
        "with resistance, beyond": share(at["beyond"] & ~bolted, zone_1),
        "with resistance, parallel": share(at["parallel"] & ~bolted, zone_1),
        "a forward zone for a fault behind": share(at["behind"], started[:, FAR]),
        "a reverse zone for a fault ahead": share(at["inside"] | at["beyond"], started[:, REVERSE]),
        "start before the fault": share(np.ones(len(a), bool), a["before"]),
        f"bolted within {DEPENDABLE:.0%}, the mho does not": share(near, ~started[:, MHO]),
        "the quadrilateral does not": share(near, ~started[:, QUAD]),
        f"within {INSIDE:.0%}, SIR to 30, to 150 km: median, 95 %, worst [ms]": times(within & short),
        "later than 20 ms": share(within & short & zone_1, first > SLOW_MS[150]),
        "the same, SIR to 3": times(within & short & (a["sir"] <= WEAK)),
        "longer lines": times(within & ~short),
        "later than 30 ms": share(within & ~short & zone_1, first > SLOW_MS[1e9]),
    }


def table(files: list[str]) -> None:
    """A table in Markdown of files of answers, each NAME=FILE."""
    named = dict(text.split("=", 1) for text in files)
    columns = {name: column(np.load(file)) for name, file in named.items()}
    print("| zone 1 of 80 %, mho or quadrilateral, operates | " + " | ".join(named) + " |")
    print("|" + "---|" * (1 + len(named)))
    for row in next(iter(columns.values())):
        print(f"| {row} | " + " | ".join(one[row] for one in columns.values()) + " |")


def answers(given: argparse.Namespace) -> np.ndarray:
    """Of all networks in order; what `--out` already has is not run again."""
    done = np.load(given.out) if given.out and given.out.exists() else np.zeros(0, ANSWER)
    parts, kept = [done], len(done) // (2 * given.faults)
    numbers = range(given.first + kept, given.first + given.networks)
    begun = saved = time.monotonic()
    with Pool(given.workers) as pool:
        for n, part in enumerate(pool.imap(partial(network, given=given), numbers), 1):
            parts.append(part)
            if given.out and (time.monotonic() - saved > 60 or n == len(numbers)):
                parts, saved = [np.concatenate(parts)], time.monotonic()
                np.save(given.out.with_suffix(".part.npy"), parts[0])
                given.out.with_suffix(".part.npy").replace(given.out)
                print(f"{n} of {len(numbers)} networks, {saved - begun:.0f} s", flush=True)
    return np.concatenate(parts)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--networks", "--cases", type=int, default=2000)
    parser.add_argument("--faults", type=int, default=1)
    parser.add_argument("--first", type=int, default=0, help="number of the first network")
    parser.add_argument("--seed", type=int, default=1001)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--kind", choices=KINDS, default="mixed")
    parser.add_argument("--antialias", type=float, default=1500.0)
    parser.add_argument("--order", type=int, choices=(2, 4), default=4, help="of the low-pass")
    parser.add_argument("--estimator", default="kalman-bank")
    parser.add_argument("--vt", choices=("ideal", "unknown"), default="ideal", help="what the relay is told")
    parser.add_argument("--no-charging", action="store_true", help="the relay is not told the line's")
    parser.add_argument("--functions", action="store_true", help="with every other function")
    parser.add_argument("--list", action="store_true", help="every wrong and every slow case")
    parser.add_argument("--out", type=Path, help="a file of answers, to go on with")
    parser.add_argument("--table", nargs="+", metavar="NAME=FILE", help="of files of answers, in Markdown")
    parser.add_argument("--keep", action="store_true", help="leave the figures for docs/evidence.md")
    given = parser.parse_args()
    if given.table:
        table(given.table)
        return
    found = answers(given)
    what = (
        f"{given.kind}, seed {given.seed}, {given.networks} networks from {given.first}, {given.faults}"
        f" faults in each, {given.antialias:g} Hz of order {given.order}, {given.estimator}, VT {given.vt}"
        f"{', with every function' if given.functions else ''}"
        f"{', not told the charging' if given.no_charging else ''}"
    )
    print(what)
    tell(found, given.list)
    if given.keep:
        figures = "; ".join(f"{name}: {figure.replace('*', '')}" for name, figure in column(found).items())
        line = f"Zone 1 of 80 %, mho or quadrilateral: {what}"
        keep("Security and instrument transformers", [(line, figures)], beside=True)


if __name__ == "__main__":
    main()
