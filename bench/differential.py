"""What line differential costs: the closed loop of two ends with and without ``[pdif]``, in turn.

    python bench/differential.py [--seconds 4] [--runs 7]

Microseconds per sample and relay: the function (a Fourier filter and the rules at each twelfth sample) with
its node, its frames, the channel and the bus model.  The ratio is of the two medians.
"""

from __future__ import annotations

import argparse
import os
import statistics
import time
import tomllib
from pathlib import Path
from typing import Any

from faultloop.loop.case import Cases
from faultloop.loop.scenario import Scenario
from faultloop.relay import RelaySettings

SCENARIOS = Path(__file__).resolve().parents[1] / "scenarios"


def scenario(seconds: float) -> Scenario:
    """The two ends, a channel of 5 ms, and no fault."""
    tables: dict[str, Any] = tomllib.loads((SCENARIOS / "line-differential.toml").read_text(encoding="utf-8"))
    tables["scenario"]["duration_s"] = seconds
    del tables["fault"], tables["expect"]
    return Scenario.from_dict(tables, path=SCENARIOS / "line-differential.toml")


def settings(compares: bool) -> RelaySettings:
    """Of both ends."""
    path = SCENARIOS / "settings" / "ab-differential.toml"
    tables = tomllib.loads(path.read_text(encoding="utf-8"))
    if not compares:
        del tables["pdif"]
    return RelaySettings.from_dict(tables)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=4.0)
    parser.add_argument("--runs", type=int, default=7)
    wanted = parser.parse_args()
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    cases, network = Cases(), scenario(wanted.seconds)
    own = {compares: settings(compares) for compares in (True, False)}
    samples = wanted.seconds * network.system.sampling_hz * len(network.relay)
    found: dict[bool, list[float]] = {True: [], False: []}
    for run in range(wanted.runs + 1):
        for compares, table in own.items():
            case = cases.prepare(network, dict.fromkeys(("RA", "RB"), table))
            started = time.perf_counter()
            case.run()
            if run:  # the first one compiles, and warms up
                found[compares].append((time.perf_counter() - started) / samples * 1e6)
    for compares, us in found.items():
        which = "with" if compares else "without"
        print(
            f"{which} [pdif]: median {statistics.median(us):.3f} us per sample and relay, best {min(us):.3f}"
        )
    medians = {compares: statistics.median(us) for compares, us in found.items()}
    print(
        f"difference {medians[True] - medians[False]:.3f} us per sample and relay, "
        f"ratio {medians[True] / medians[False]:.2f}"
    )


if __name__ == "__main__":
    main()
