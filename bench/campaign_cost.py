"""The rates that `check` tells a campaign's time by: CPU time of a case, a relay and second, a new state.

    python bench/campaign_cost.py [--cases 60]

Campaigns of the shipped scenario in this process, one after the other; to be copied into
faultloop/study/campaign/cost.py when the loop has become quicker or slower.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq

import faultloop
from faultloop.study.campaign.cost import cost_of, yardstick_s

ROOT = Path(__file__).resolve().parents[1]
SHORT_S, LONG_S = 0.15, 0.55
RELAYS = 2


def campaign(cases: int, duration_s: float, place: dict[str, Any]) -> faultloop.Campaign:
    scenario = str(ROOT / "scenarios" / "ag-zone1.toml")
    head = {"name": "cost", "scenario": scenario, "sampling": "random", "cases": cases}
    vary = [
        {"key": "fault.F1.at_pu", **place},
        {"key": "fault.F1.type", "values": ["AG", "BC", "BCG", "ABC"]},
        {"key": "fault.F1.angle_deg", "uniform": [0.0, 360.0]},
        {"key": "fault.F1.resistance_ohm", "uniform": [0.0, 10.0]},
        {"key": "fault.F1.after_s", "values": [0.05]},
        {"key": "scenario.duration_s", "values": [duration_s]},
    ]
    judge = [{"relay": "RA", "where": "inside", "trip": True, "within_ms": 60}]
    return faultloop.Campaign.from_dict({"campaign": head, "vary": vary, "judge": judge})


def case_s(cases: int, duration_s: float, place: dict[str, Any], folder: Path) -> float:
    """CPU time of a case."""
    made, out = campaign(cases, duration_s, place), folder / "cost.parquet"
    out.unlink(missing_ok=True)
    begin = time.process_time()
    made.run(out)
    spent = (time.process_time() - begin) / cases
    assert pq.read_table(out, columns=["error"])["error"].null_count == cases
    return spent


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--cases", type=int, default=60)
    cases = parser.parse_args().cases
    one, many = {"values": [0.4]}, {"uniform": [0.02, 0.98]}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        case_s(2, SHORT_S, many, folder)  # what is compiled
        short, long, places = (
            case_s(cases, duration_s, place, folder)
            for duration_s, place in ((SHORT_S, one), (LONG_S, one), (SHORT_S, many))
        )
        size = (folder / "cost.parquet").stat().st_size
    relay_s = (long - short) / (LONG_S - SHORT_S) / RELAYS
    print(f"YARDSTICK_S = {yardstick_s():.4f}")
    print(f"CASE_S = {short - RELAYS * relay_s * SHORT_S:.5f}")
    print(f"RELAY_S = {relay_s:.5f}")
    print(f"NEW_STATE_S = {(places - short) / RELAYS:.5f}")
    told = cost_of(campaign(1000, 0.2, many).plan)
    seconds = told["core_seconds_about"]
    print(f"so 1000 cases of 200 ms at places of their own take {seconds} s by the rates in force")
    print(f"({size / cases:.0f} bytes a case, of {cases})")


if __name__ == "__main__":
    main()
