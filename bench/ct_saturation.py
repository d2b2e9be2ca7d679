"""Zones without delay over random faults that saturate the current transformers: wrong starts, and times.

    python bench/ct_saturation.py [--cases 2000] [--first 0] [--seed 1] [--workers 1] [--reach 0.8]
                                  [--antialias 1500] [--order 4] [--list] [--keep]

A case is a network X - A - B - C of `security_cases.draw`, its lines of 20 to 200 km and its sources 0.3 to
10 times the line, with a bolted fault of any type at any angle: beyond an end by up to 10 % of the line (a
fault behind the other end), close to an end, or in the middle.  Each of the two relays has a core of its own,
TPX with a remanence of up to 80 % or TPY with up to 10 %, whose knee is where the flux of its ideal currents
stands 3 to 15 ms after the fault.  Where that could not carry the load it has the least that does.  A case
depends on the seed and its number alone.  ``--list`` tells every wrong case; ``--keep`` leaves the figures
for docs/evidence.md.
"""

from __future__ import annotations

import argparse
import math
import time
from functools import partial
from multiprocessing import Pool
from typing import Any

import numpy as np
from results import keep
from security import FAR, MHO, QUAD, REVERSE, Starts, settings
from security_cases import draw, draw_source, fault, log_uniform, record, tables, z1_of

from faultloop.loop.case import Cases
from faultloop.loop.scenario import Scenario
from faultloop.relay import RelaySettings

Tables = dict[str, Any]
PLACES = {"beyond": 0.5, "close": 0.25, "middle": 0.25}
"""Of the fault, as one of the relays sees it, and how often."""
CLOSE, MIDDLE = 0.02, (0.3, 0.6)
CLOSE_MS = 60.0
CARRIES = 1.25
"""Times the flux of the load: a core of less is in no service."""
REMANENCE = {"TPX": 0.8, "TPY": 0.1}
BURDEN_OHM, WINDING_OHM, RATIO = (2.0, 0.5), 0.5, (1200.0, 5.0)
ANSWER = np.dtype(
    [("number", "i4"), ("end", "i4"), ("depth", "f4"), ("saturates", "f4"), ("ms", "f4", 4), ("text", "U120")]
)
"""What one relay did; ``depth``: of the fault, -1 behind; when each zone started after the fault [ms]."""


def network(seed: int, number: int) -> Tables:
    """A case as `security_cases` has them."""
    case, rng = draw(seed, number, "mixed"), np.random.default_rng([seed, number])
    case["length"] = log_uniform(rng, 20, 200)
    case["near"], case["far"] = log_uniform(rng, 20, 100), log_uniform(rng, 20, 100)
    case |= {"parallel": False, "resistance": 0.0, "load": float(rng.uniform(-30, 30))}
    z1, whole = z1_of(case), case["length"] + case["near"] + case["far"]
    for name in "XC":
        while not 0.3 * z1 <= math.hypot(*case[name]["z1_ohm"]) <= 10 * z1:
            case[name] = draw_source(rng, z1, whole)
    place = str(rng.choice(list(PLACES), p=list(PLACES.values())))
    if place == "beyond":
        beyond = float(rng.choice([0.0, rng.uniform(0.0, 0.1)])) * case["length"]
        ahead = bool(rng.random() < 0.5)
        case["where"] = "beyond" if ahead else "behind"
        at = min(beyond / case["far" if ahead else "near"], 1.0)
        case["at"] = at if ahead else 1 - at
    else:
        at = float(rng.uniform(0, CLOSE) if place == "close" else rng.uniform(*MIDDLE))
        case |= {"where": "inside", "at": at if rng.random() < 0.5 else 1 - at}
    return case


def depth(case: Tables, end: int) -> float:
    """Of the fault, from A (0) or B (1)."""
    if case["where"] == "inside":
        return 1 - case["at"] if end else case["at"]
    if (case["where"] == "behind") == (end == 0):
        return -1.0
    past = (1 - case["at"]) * case["near"] if end else case["at"] * case["far"]
    return 1 + past / case["length"]


def transformer(
    rng: np.random.Generator, case: Tables, x: np.ndarray, start: int, end: int
) -> tuple[Tables, float]:
    """A ``[[ct]]`` whose core is full a drawn time [ms] after the fault, and that; ``x``: the samples (n, 6)
    without it."""
    saturates, core = float(rng.uniform(3, 15)), str(rng.choice(list(REMANENCE)))
    remanence = float(rng.choice([0.0, rng.uniform(0, REMANENCE[core])]) * rng.choice([-1, 1]))
    rate, omega = case["sampling"], 2 * math.pi * case["f0"]
    i = x[:, 3:] * RATIO[1] / RATIO[0]
    flux = (WINDING_OHM + BURDEN_OHM[0]) * np.cumsum(i, axis=0) / rate + BURDEN_OHM[1] / omega * i
    cycle = rate // case["f0"]
    before = flux[start - cycle : start]
    flux -= before.mean(axis=0)
    load = float(abs(flux[start - cycle : start]).max())
    after = flux[start : start + round(rate * saturates * 1e-3) + 1]
    full = max(after.max() / (1 - remanence), -after.min() / (1 + remanence))
    full = max(float(full), CARRIES * load / (1 - abs(remanence)))
    ct = {
        "name": f"C{end}", "ratio": list(RATIO), "model": "saturating", "class": core,
        "vs_v": round(full * omega / math.sqrt(2), 3), "rw_ohm": WINDING_OHM,
        "burden_ohm": list(BURDEN_OHM), "remanence_pu": remanence,
    }  # fmt: skip
    return ct, saturates


def relay_settings(case: Tables, reach: float) -> RelaySettings:
    """Those of bench/security.py, every zone without delay."""
    told = settings(case, "kalman-bank").model_dump(exclude_unset=True)
    for zone in told["pdis"]:
        zone["delay_ms"] = 0.0
    for zone in (MHO, QUAD):
        told["pdis"][zone]["reach_pu"] = reach
    return RelaySettings.from_dict(told)


def one(number: int, given: argparse.Namespace) -> np.ndarray:
    """(2,) ANSWER."""
    case, answers = network(given.seed, number), np.zeros(2, ANSWER)
    rng = np.random.default_rng([given.seed, number, 1])
    x, start = record(case, given.antialias, given.order)
    data, cts = tables(case, given.antialias, given.order), []
    for end in range(2):
        ct, answers[end]["saturates"] = transformer(rng, case, x[end], start, end)
        data["relay"][end]["ct"] = ct["name"]
        cts.append(ct)
    told, sink = relay_settings(case, given.reach), Starts()
    data |= {"ct": cts, "fault": [{"name": "F1"} | fault(case)]}
    done = Cases().prepare(Scenario.from_dict(data), {"RA": told, "RB": told}).run([sink], texts=False)
    assert done.fault_start_ns is not None
    for end, name in enumerate(("RA", "RB")):
        row = answers[end]
        row["number"], row["end"], row["depth"] = number, end, depth(case, end)
        row["ms"] = sink.of(name, done.fault_start_ns)[1]
        ct, source = cts[end], math.hypot(*case["XC"[end]]["z1_ohm"]) / z1_of(case)
        row["text"] = (
            f"{case['type']} at {row['depth']:.3f}, {case['angle']:.0f} degrees, {case['length']:.0f} km"
            f" {case['line']['model']}, source {source:.2g}, {ct['class']} {ct['vs_v']:.1f} V,"
            f" remanence {ct['remanence_pu']:.2f}"
        )
    return answers


def told_of(row: np.ndarray) -> str:
    """A case for a person."""
    times = "/".join(f"{ms:.1f}" for ms in row["ms"])
    place = f"case {row['number']} end {row['end']}"
    return f"    {place}: {row['text']}, full after {row['saturates']:.1f} ms; {times} ms"


def figures(a: np.ndarray, listed: bool) -> list[tuple[str, str]]:
    """Of (n,) ANSWER, told as well."""
    started = ~np.isnan(a["ms"])
    beyond, behind = a["depth"] > 1 - CLOSE - 1e-6, a["depth"] < 0
    close, found = (a["depth"] >= 0) & (a["depth"] <= CLOSE), []

    def share(name: str, chosen: np.ndarray, wrong: np.ndarray) -> None:
        wrong = chosen & wrong
        found.append((name, f"{wrong.sum()} of {chosen.sum():,}"))
        print(f"{name:52s} {wrong.sum():5d} of {chosen.sum()}", flush=True)
        for row in a[wrong] if listed else ():
            print(told_of(row))

    for zone, name in ((MHO, "mho"), (QUAD, "quadrilateral")):
        share(f"zone 1 ({name}) from {1 - CLOSE:.0%} of the line on", beyond, started[:, zone])
        share(f"zone 1 ({name}) for a fault behind", behind, started[:, zone])
    share("forward zone of 120 % for a fault behind", behind, started[:, FAR])
    share("reverse zone for a fault ahead", ~behind, started[:, REVERSE])
    for zone, name in ((MHO, "mho"), (QUAD, "quadrilateral")):
        late = np.nan_to_num(a["ms"][:, zone], nan=np.inf)
        share(f"close in, {name} not within {CLOSE_MS:g} ms", close, late > CLOSE_MS)
    middle = (a["depth"] >= MIDDLE[0]) & (a["depth"] <= MIDDLE[1])
    for name, chosen in (("close in", close), (f"{MIDDLE[0]:.0%} to {MIDDLE[1]:.0%}", middle)):
        for zone, kind in ((MHO, "mho"), (QUAD, "quadrilateral")):
            t = a["ms"][chosen & started[:, zone], zone]
            text = f"{np.median(t):.1f}, {np.percentile(t, 95):.1f}, {t.max():.1f}" if len(t) else "none"
            text += f" ({len(t)} of {chosen.sum()})"
            found.append((f"{name}, {kind}: median, 95 %, worst [ms]", text))
            print(f"{found[-1][0]:52s} {text}")
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--cases", type=int, default=2000)
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--reach", type=float, default=0.8, help="of zone 1, per unit of the line")
    parser.add_argument("--antialias", type=float, default=1500.0, help="low-pass before sampling [Hz]")
    parser.add_argument("--order", type=int, default=4, help="of the low-pass")
    parser.add_argument("--list", action="store_true", help="every case that is wrong")
    parser.add_argument("--keep", action="store_true", help="leave the figures for docs/evidence.md")
    given = parser.parse_args()
    begun = time.monotonic()
    with Pool(given.workers) as pool:
        numbers = range(given.first, given.first + given.cases)
        a = np.concatenate(list(pool.imap(partial(one, given=given), numbers)))
    what = f"seed {given.seed}, {given.cases} cases from {given.first}, reach {given.reach:g}"
    what += f", low-pass {given.antialias:g} Hz of order {given.order}"
    print(f"{what}, {time.monotonic() - begun:.0f} s")
    found = figures(a, given.list)
    if given.keep:
        line = f"Current transformers that saturate after 3 to 15 ms: {what}"
        figure = "; ".join(": ".join(one) for one in found)
        keep("Security and instrument transformers", [(line, figure)], beside=True)


if __name__ == "__main__":
    main()
