"""A case's verdict."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from faultloop.config.campaign import Judge
from faultloop.loop.outcome import TripReport
from faultloop.loop.result import judge as judge_expectation
from faultloop.loop.scenario import Scenario
from faultloop.study.campaign.where import where_of


class CaseVerdict(NamedTuple):
    """``right``, ``wrong`` (with its reason) or ``unjudged``."""

    verdict: str
    reason: str | None = None


def judge_case(
    judges: Sequence[Judge], scenario: Scenario, trips: list[TripReport], fault_ns: int | None
) -> CaseVerdict:
    """All judges that apply must hold; the first that does not is the reason."""
    asked = {judge.relay for judge in judges if judge.where is not None}
    where = {place.name: where_of(scenario, place) for place in scenario.relay if place.name in asked}
    applied = False
    for judge in judges:
        if judge.where is not None and judge.where != where[judge.relay]:
            continue
        applied = True
        verdict = judge_expectation(judge, trips, fault_ns)
        if not verdict.held:
            expected = "trip" if judge.trip else "no trip"
            seen = f" for a fault {judge.where}" if judge.where not in (None, "none") else ""
            return CaseVerdict("wrong", f"{judge.relay}: {expected} expected{seen}: {verdict.why}")
    return CaseVerdict("right" if applied else "unjudged")
