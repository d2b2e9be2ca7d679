"""What an expectation says of a trip: the trip answers the fault, and in time."""

from __future__ import annotations

import pytest

from faultloop.config.expect import Expect
from faultloop.loop.outcome import TripReport
from faultloop.loop.result import judge

FAULT_NS = 100_000_000


def trip_at(received_ms: float) -> TripReport:
    ns = round(received_ms * 1e6)
    return TripReport("RA", "PDIS1", 1, "AG", 7, 0, ns, "QA", ns)


@pytest.mark.parametrize(
    ("received_ms", "held", "told"),
    [
        (100.0, True, ""),
        (120.0, True, ""),
        (120.1, False, "after 20.1 ms, not within 20 ms"),
        (99.9, False, "0.1 ms before the fault"),  # it cannot be an answer to it
        (10.0, False, "90.0 ms before the fault"),
    ],
)
def test_within(received_ms: float, held: bool, told: str) -> None:
    expect = Expect(relay="RA", trip=True, within_ms=20.0)
    verdict = judge(expect, [trip_at(received_ms)], FAULT_NS)
    assert verdict.held is held
    assert told in verdict.why


def test_a_false_trip_does_not_hide_the_right_one() -> None:
    expect = Expect(relay="RA", trip=True, within_ms=20.0)
    assert judge(expect, [trip_at(50.0), trip_at(110.0)], FAULT_NS).held


def test_without_a_fault_times_count_from_the_runs_start() -> None:
    assert judge(Expect(relay="RA", trip=True, within_ms=20.0), [trip_at(15.0)], None).held
