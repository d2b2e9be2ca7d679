"""Cases an hour of a campaign, against `run(keep=False)` of the same cases in the same minutes.

    python bench/campaign.py [CASES] [--workers N]

200 ms cases of two relays with the default estimator and the bus model, at one place and at random places;
set-up and warm-up are counted, compilation is not (one case of each kind runs before).
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path
from typing import Any

import faultloop

ROOT = Path(__file__).resolve().parents[1]
PLACES: dict[str, dict[str, Any]] = {
    "one place": {"key": "fault.F1.at_pu", "values": [0.4]},
    "random places": {"key": "fault.F1.at_pu", "uniform": [0.02, 0.98]},
}


def tables(place: dict[str, Any], cases: int, seed: int) -> dict[str, Any]:
    """A campaign of 200 ms cases."""
    scenario = str(ROOT / "scenarios" / "ag-zone1.toml")
    head = {"name": "bench", "scenario": scenario, "sampling": "random", "cases": cases, "seed": seed}
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


def by_campaign(campaign: faultloop.Campaign, out: Path, workers: int) -> float:
    begin = time.perf_counter()
    campaign.run(out, workers=workers)
    return (time.perf_counter() - begin) / campaign.cases


def by_run(campaign: faultloop.Campaign, cases: int) -> float:
    begin = time.perf_counter()
    for number in range(cases):
        faultloop.run(campaign.case(number).scenario, keep=False)
    return (time.perf_counter() - begin) / cases


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("cases", type=int, nargs="?", default=1000)
    parser.add_argument("--workers", type=int, default=1)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        for name, place in PLACES.items():
            warm = faultloop.Campaign.from_dict(tables(place, 2, 1))
            by_campaign(warm, Path(folder) / f"{name}-warm.parquet", 1)
            by_run(warm, 1)
            campaign = faultloop.Campaign.from_dict(tables(place, options.cases, 2))
            count = max(options.cases // 20, 5)
            before = by_run(campaign, count)
            own = by_campaign(campaign, Path(folder) / f"{name}.parquet", options.workers)
            after = by_run(campaign, count)
            run_s = (before + after) / 2
            print(
                f"{name}: {1e3 * own:.2f} ms a case, {3600 / own:,.0f} an hour, {options.workers} worker(s); "
                f"run(keep=False) {1e3 * run_s:.1f} ms: {run_s / own:.1f} times"
            )


if __name__ == "__main__":
    main()
