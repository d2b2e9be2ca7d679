"""Why a zone did not operate, by what it saw at each sample."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from faultloop.relay.explain import SHARED, ZONE
from faultloop.relay.layout import constants, instances
from faultloop.relay.settings import RelaySettings
from faultloop.review.why_zone import Zone, judge_zone
from tests.relay.functions.kernel import GIVEN


@pytest.mark.parametrize(
    ("m", "delay_ms", "cause"),
    [(-1.2, 0.0, "direction"), (-0.4, 0.0, "not-settled"), (-1.2, 300.0, "not-settled"), (1.2, 0.0, "reach")],
)
def test_a_zone_without_delay_does_not_start_for_what_is_far_behind(
    m: float, delay_ms: float, cause: str
) -> None:
    """Released, forward, and inside by memory; with a delay, or less far, it may start."""
    pdis = [{"zone": 1, "reach_pu": 0.8, "delay_ms": delay_ms}]
    settings = RelaySettings.from_dict(GIVEN | {"pdis": pdis})
    shared, zones = np.zeros(20, SHARED), np.zeros((20, 1), ZONE)
    for key, value in {
        "ready": 1,
        "disturbed": 1,
        "fed": 1,
        "fault": 1,
        "released": 1,
        "direction": 1,
    }.items():
        shared[key] = value
    zones["m"] = zones["x"] = m
    zones["current"], zones["residual"] = 2.0, 2.0
    known: Any = SimpleNamespace(
        settings=settings, shared=shared, zones=zones, t_ns=np.arange(20),
        constants=constants(settings, 96, instances(settings))[0],
    )  # fmt: skip
    facts: Any = SimpleNamespace(known=known, rows=np.arange(20), one=SimpleNamespace(number=0), zero=0)
    verdict = judge_zone(Zone(facts, "AG"))
    assert verdict.cause == cause
    assert ("behind the relay" in verdict.text) == (cause == "direction")
