"""What a campaign will cost, told without running any of it.

The rates are of one core that does nothing else, by ``python bench/case.py`` on 2026-11-26 with the machine's
load divided out (the same `run` took 3 to 4 times what it takes alone): renew them when the loop is quicker.
"""

from __future__ import annotations

from typing import Any

from faultloop.study.campaign.plan import Plan, of_fault
from faultloop.study.campaign.waves import WIDTHS, Waves

CASE_S = 0.008
"""A case, whatever its length: made ready, run, judged, written."""
RELAY_S = 1 / 30
"""A relay and its part of the plant, for a second of simulated time."""
NEW_STATE_S = 0.004
"""A relay with settings, or before a network, that no case had so far: warm-up, and the plant's matrices."""
ROW_BYTES = 60
"""Of the file, per case."""


def cost_of(plan: Plan) -> dict[str, Any]:
    """Seconds of a core and megabytes, about; of waves, before they are compressed."""
    first = plan.case(0)
    relays, duration_s = len(first.settings), first.scenario.scenario.duration_s
    seconds = plan.cases * (CASE_S + RELAY_S * relays * duration_s) + _states(plan) * relays * NEW_STATE_S
    waves = {kind: Waves(plan, [kind]).case_bytes * plan.cases / 1e6 for kind in WIDTHS}
    return {
        "core_seconds_about": _rounded(seconds),
        "file_mb_about": _rounded(plan.cases * ROW_BYTES / 1e6),
        "keep_mb_at_most": {kind: _rounded(mb) for kind, mb in waves.items()},
    }


def _states(plan: Plan) -> int:
    """Pre-fault states, at most."""
    count = 1
    for vary, listed in zip(plan.draws.varied, plan.draws.listed, strict=True):
        if not all(map(of_fault, vary.all_keys)):
            count *= plan.cases if listed is None else len(listed)
    return min(count, plan.cases)


def _rounded(value: float) -> float:
    return float(f"{value:.2g}") if value < 100 else float(round(value))
