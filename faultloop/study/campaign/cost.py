"""What a campaign will cost, told without running any of it.

The rates were measured by ``python bench/campaign_cost.py``, in CPU time, on one that took `YARDSTICK_S` for
`yardstick_s`; when the cost is told this machine does that, too, and the rates are taken in proportion.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from faultloop.study.campaign.plan import Plan, of_fault
from faultloop.study.campaign.waves import WIDTHS, Waves

MEASURED = "2026-11-26"
YARDSTICK_S = 0.010
CASE_S = 0.008
"""A case, whatever its length: made ready, run, judged, written."""
RELAY_S = 1 / 30
"""A relay and its part of the plant, for a second of simulated time."""
NEW_STATE_S = 0.004
"""A relay with settings, or before a network, that no case had so far: warm-up, and the plant's matrices."""
ROW_BYTES = 60
"""Of the file, per case."""


def cost_of(plan: Plan) -> dict[str, Any]:
    """Seconds of a core of this machine and megabytes, about; of waves, before they are compressed."""
    relays, duration_s = len(plan.first.settings), plan.first.scenario.scenario.duration_s
    seconds = plan.cases * (CASE_S + RELAY_S * relays * duration_s) + _states(plan) * relays * NEW_STATE_S
    slower = yardstick_s() / YARDSTICK_S
    waves = {kind: Waves(plan, [kind]).case_bytes * plan.cases / 1e6 for kind in WIDTHS}
    return {
        "core_seconds_about": _rounded(seconds * slower),
        "rests_on": f"rates of {MEASURED} (bench/campaign_cost.py), times {slower:.2f} on this machine, now",
        "file_mb_about": _rounded(plan.cases * ROW_BYTES / 1e6),
        "keep_mb_at_most": {kind: _rounded(mb) for kind, mb in waves.items()},
    }


def yardstick_s() -> float:
    """What a core takes for a piece of Python and NumPy work that never changes; the best of five, so that
    another program on the machine does not count."""
    values = np.arange(20_000.0)
    times = []
    for _ in range(5):
        begin = time.perf_counter()
        counts: dict[int, float] = {}
        for number in range(20_000):
            counts[number % 97] = counts.get(number % 97, 0.0) + 0.5 * number
        for _ in range(20):
            np.cumsum(np.sqrt(values) * values)
        times.append(time.perf_counter() - begin)
    return min(times)


def _states(plan: Plan) -> int:
    """Pre-fault states, at most."""
    count = 1
    for vary, listed in zip(plan.draws.varied, plan.draws.listed, strict=True):
        if not all(map(of_fault, vary.all_keys)):
            count *= plan.cases if listed is None else len(listed)
    return min(count, plan.cases)


def _rounded(value: float) -> float:
    return float(f"{value:.2g}") if value < 100 else float(round(value))
