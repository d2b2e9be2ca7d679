"""What a case of a campaign costs, and a `run` without a log, against `run(keep=False)` of an earlier tree.

    python bench/campaign.py [CASES] [--before TREE] [--rounds 3] [--keep]

200 ms cases of two relays with the default estimator and the bus model: at one place, at random places, and
of a network of ten buses with four relays; set-up and warm-up are counted, compilation is not.  Then `run`:
the first of its network, and a further one, of a `Scenario` and of a file.  CPU time of one process, the
least of the rounds, taken in turns with the tree before (by default this one: its own `run`).
"""

# ruff: noqa: E402
from __future__ import annotations

import os

for key in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(key, "1")

import argparse
import itertools
import statistics
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import faultloop
from faultloop.config.toml_text import toml_text
from faultloop.loop.scenario import load_scenario

ROOT = Path(__file__).resolve().parents[1]
AG = ROOT / "scenarios" / "ag-zone1.toml"
PLACES: dict[str, dict[str, Any]] = {
    "one place": {"key": "fault.F1.at_pu", "values": [0.4]},
    "random places": {"key": "fault.F1.at_pu", "uniform": [0.02, 0.98]},
}
LIMITS = {"one place": 15.0, "random places": 7.0}
FIRST_MS, FURTHER_MS = 15.0, 6.0
BEFORE_MS = 39.0
"""`run(keep=False)` of before, when these limits were set."""
BEFORE = """
import sys, time
import faultloop
try:
    from faultloop.loop.scenario import load_scenario
except ImportError:
    from faultloop import load_scenario
short = ["scenario.duration_s=0.2"]
made = [load_scenario(sys.argv[1], [*short, f"fault.F1.angle_deg={18 * k}"]) for k in range(20)]
for one in made[:2]:
    faultloop.run(one, keep=False)
begin = time.process_time()
for one in made:
    faultloop.run(one, keep=False)
print((time.process_time() - begin) / len(made) * 1e3)
"""


def tables(place: dict[str, Any], cases: int, seed: int, scenario: Path = AG) -> dict[str, Any]:
    """A campaign of 200 ms cases."""
    head = {"name": "bench", "scenario": str(scenario), "sampling": "random", "cases": cases, "seed": seed}
    return {
        "campaign": head,
        "vary": [
            place,
            {"key": "fault.F1.angle_deg", "uniform": [0.0, 360.0]},
            {"key": "fault.F1.resistance_ohm", "uniform": [0.0, 10.0]},
            {"key": "scenario.duration_s", "values": [0.2]},
        ],
        "judge": [{"relay": "RA", "trip": True}],
    }


def ten_buses(folder: Path) -> Path:
    """Nine lines of 100 km between two sources; relays at both ends of the fourth and the fifth."""
    data = tomllib.loads(AG.read_text(encoding="utf-8"))
    line, settings = data["line"][0], str(AG.parent / "settings" / "ab-mho.toml")
    names = "ABCDEFGHIJ"
    data["line"] = [line | {"name": a + b, "from": a, "to": b} for a, b in itertools.pairwise(names)]
    data["source"][1]["bus"] = "J"
    ends = [("A", "DE", "from"), ("B", "DE", "to"), ("C", "EF", "from"), ("D", "EF", "to")]
    data["breaker"] = [{"name": f"Q{n}", "line": own, "end": end, "operate_ms": 40} for n, own, end in ends]
    data["relay"] = [
        {"name": f"R{n}", "line": own, "end": end, "breaker": f"Q{n}", "settings": settings}
        for n, own, end in ends
    ]
    data["fault"][0]["line"] = "DE"
    del data["expect"]
    path = folder / "ten-buses.toml"
    path.write_text(toml_text(data), encoding="utf-8")
    return path


def by_campaign(campaign: faultloop.Campaign, out: Path) -> float:
    """CPU time of a case [ms]."""
    begin = time.process_time()
    campaign.run(out)
    return (time.process_time() - begin) / campaign.cases * 1e3


def by_run(tree: Path) -> float:
    """CPU time of `run(keep=False)` of a tree, in a process of its own [ms]."""
    command = [sys.executable, "-c", BEFORE, str(tree / "scenarios" / AG.name)]
    own = os.environ | {"PYTHONPATH": str(tree)}
    told = subprocess.run(command, check=True, capture_output=True, text=True, cwd=tree, env=own)
    return float(told.stdout.split()[-1])


def each(run: Callable[[int], object], count: int) -> tuple[float, float]:
    """Least and median CPU time [ms]."""
    spent = []
    for number in range(count):
        begin = time.process_time()
        run(number)
        spent.append((time.process_time() - begin) * 1e3)
    return min(spent), statistics.median(spent)


def runs() -> dict[str, tuple[float, float]]:
    """`run` without a log, everything compiled: of new networks, and of one that was there before."""
    angles = [f"fault.F1.angle_deg={6 * k}" for k in range(60)]
    short = ["scenario.duration_s=0.2"]
    new = [load_scenario(AG, [*short, f"fault.F1.at_pu={0.05 + 0.015 * k}"]) for k in range(60)]
    same = [load_scenario(AG, [*short, angle]) for angle in angles]
    for scenario in (new[0], same[0], same[1]):
        faultloop.run(scenario, keep=False)
    return {
        "first of its network": each(lambda k: faultloop.run(new[k], keep=False), len(new)),
        "a further one": each(lambda k: faultloop.run(same[k], keep=False), len(same)),
        "a further one, of a file": each(
            lambda k: faultloop.run(AG, overrides=[*short, angles[k]], keep=False), len(angles)
        ),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("cases", type=int, nargs="?", default=1000)
    parser.add_argument("--before", type=Path, default=ROOT)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--keep", action="store_true", help="leave the figures for docs/evidence.md")
    options = parser.parse_args()
    rows: list[tuple[str, str]] = []
    before: list[float] = []
    spent: dict[str, list[float]] = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        kinds = {kind: (place, AG) for kind, place in PLACES.items()}
        kinds["ten buses, four relays, random places"] = (PLACES["random places"], ten_buses(folder))
        for kind, (place, scenario) in kinds.items():
            faultloop.Campaign.from_dict(tables(place, 2, 1, scenario)).run(folder / f"{kind}.parquet")
        for number in range(options.rounds):
            before.append(by_run(options.before))
            for kind, (place, scenario) in kinds.items():
                campaign = faultloop.Campaign.from_dict(tables(place, options.cases, 2 + number, scenario))
                own = by_campaign(campaign, folder / f"{kind}-{number}.parquet")
                spent.setdefault(kind, []).append(own)
    least = min(before)
    for kind, own in spent.items():
        limit = f"; limit {LIMITS[kind]:g}" if kind in LIMITS else ""
        ratio = f": {least / min(own):.1f} times less than `run(keep=False)` of before, {least:.1f} ms{limit}"
        rows.append((f"A case of 200 ms, {kind}, CPU time", f"{min(own):.2f} ms{ratio}"))
    for kind, (best, median) in runs().items():
        limit = FIRST_MS if kind.startswith("first") else FURTHER_MS
        rows.append(
            (
                f"`run` without a log, {kind}, CPU time",
                f"{best:.1f} ms, median {median:.1f}: {least / best:.1f} times less than before; limit "
                f"{limit:g} ms where that takes {BEFORE_MS:g}: {best * BEFORE_MS / least:.1f} ms",
            )
        )
    for line, figure in rows:
        print(f"{line}: {figure}")
    if options.keep:
        from results import keep

        keep("Campaigns", rows)


if __name__ == "__main__":
    main()
