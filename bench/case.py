"""What a case costs: 200 ms, two relays with the default estimator, bus and breakers, no log; one core.

    python bench/case.py [--cases 40]

Ratios to `faultloop.run(keep=False)` of the same tree, taken in turns; CPU time, the median.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable
from pathlib import Path

from faultloop.loop.case import Cases
from faultloop.loop.runner import run
from faultloop.loop.scenario import load_scenario

AG = Path(__file__).resolve().parents[1] / "scenarios" / "ag-zone1.toml"
SHORT = ["scenario.duration_s=0.2", "fault.F1.after_s=0.05"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--cases", type=int, default=40)
    count = parser.parse_args().cases
    cases = Cases()
    scenario = load_scenario(AG, SHORT)
    places = [load_scenario(AG, [*SHORT, f"fault.F1.at_pu={0.1 + 0.7 * i / count}"]) for i in range(count)]
    kinds: dict[str, Callable[[int], object]] = {
        "run(path, keep=False)": lambda i: run(AG, overrides=SHORT, keep=False),
        "run(scenario, keep=False)": lambda i: run(scenario, keep=False),
        "Cases, one place": lambda i: cases.prepare(scenario).run(),
        "Cases, a place each": lambda i: cases.prepare(places[i]).run(),
    }
    spent: dict[str, list[float]] = {name: [] for name in kinds}
    for kind in kinds.values():
        kind(0)  # what is compiled and kept
    for i in range(count):
        for name, kind in kinds.items():
            started = time.process_time()
            kind(i)
            spent[name].append(time.process_time() - started)
    first = statistics.median(spent["run(path, keep=False)"])
    for name, times in spent.items():
        median = statistics.median(times)
        print(f"{name:28} {1e3 * median:7.2f} ms  {first / median:5.2f} x")


if __name__ == "__main__":
    main()
