"""Result, log and review say the same of one run: all three come from its messages."""

from __future__ import annotations

from pathlib import Path

import pytest

import faultloop
from faultloop.loop.case import Cases
from faultloop.loop.outcome import Cast, Fold, Outcome, outcome_of
from faultloop.loop.scenario import Scenario, load_scenario
from faultloop.review.summary import summarize

SCENARIOS = sorted((Path(__file__).resolve().parents[2] / "scenarios").glob("*.toml"))
AG = next(path for path in SCENARIOS if path.stem == "ag-zone1")
MS = 1_000_000


def as_told(scenario: Scenario, folder: Path, without: tuple[str, ...] = ()) -> faultloop.Result:
    """The result of a run, after log and review have been held against it."""
    log = folder / "run.mcap"
    result = faultloop.run(scenario, log=log, without=without)
    opened = faultloop.open_log(log)
    outcome = outcome_of(opened)
    assert outcome.trips == result.trips
    assert outcome.faults == result.faults
    by_time = sorted(result.events, key=lambda event: (event.t_ns, event.source, event.text))
    assert sorted(outcome.events, key=lambda event: (event.t_ns, event.source, event.text)) == by_time
    assert sum(outcome.can_frames.values()) == result.can_frames
    summary = summarize(opened)
    reviewed = [
        (name, trip.decided_ns, trip.received_ns, trip.opened_ns)
        for name, relay in summary.relays.items()
        for trip in relay.trips
    ]
    assert sorted(reviewed) == sorted((t.relay, t.t_ns, t.received_ns, t.opened_ns) for t in result.trips)
    return result


def with_keys(path: Path, folder: Path) -> Scenario:
    keys = folder / "keys.toml"
    keys.write_text('default = "000102030405060708090a0b0c0d0e0f"\n')
    keys.chmod(0o600)
    return load_scenario(path, ["can.fd=true", f'can.keys="{keys}"'])


@pytest.mark.parametrize("path", SCENARIOS, ids=lambda path: path.stem)
def test_plain(path: Path, tmp_path: Path) -> None:
    result = as_told(load_scenario(path), tmp_path)
    case = Cases().prepare(load_scenario(path))
    for _ in range(2):  # the second starts from the same beginning
        outcome = case.run()
        assert (outcome.trips, outcome.faults, outcome.events) == (
            result.trips,
            result.faults,
            result.events,
        )
        assert str(outcome.fault_locations) == str(result.fault_locations)
        assert outcome.bus_load == result.bus_load


@pytest.mark.parametrize("name", ["ag-zone1", "single-pole-trip", "evolving-fault", "lossy-bus"])
def test_authenticated(name: str, tmp_path: Path) -> None:
    path = next(path for path in SCENARIOS if path.stem == name)
    result = as_told(with_keys(path, tmp_path), tmp_path)
    assert result.trips and all(trip.received_by == "breaker" for trip in result.trips)


@pytest.mark.parametrize("keys", [False, True])
def test_a_breaker_that_is_somebody_elses_has_a_trip_when_its_frame_is_on_the_bus(
    keys: bool, tmp_path: Path
) -> None:
    scenario = with_keys(AG, tmp_path) if keys else load_scenario(AG)
    result = as_told(scenario, tmp_path, without=("QA",))
    trip = next(trip for trip in result.trips if trip.relay == "RA")
    assert trip.received_by == "CAN frame" and trip.received_ns is not None and trip.opened_ns is None
    assert 0 < trip.received_ns - trip.t_ns < MS


def test_two_relays_at_one_breaker_are_told_apart(tmp_path: Path) -> None:
    scenario = load_scenario(AG)
    first, other = scenario.relay
    # a second relay at RA's place, which has to wait for its zone 2
    slow = tmp_path / "slow.toml"
    text = scenario.settings_path(first).read_text()
    slow.write_text(text.replace("zone = 1\n", "zone = 1\ndelay_ms = 17\n", 1))
    twin = first.model_copy(update={"name": "RC", "settings": str(slow)})
    two = Scenario.from_dict(
        scenario.model_dump(by_alias=True, exclude_none=True)
        | {"relay": [r.model_dump(by_alias=True, exclude_none=True) for r in (first, other, twin)]},
        path=AG,
    )
    result = as_told(two, tmp_path)
    trips = {trip.relay: trip for trip in result.trips}
    for name in ("RA", "RC"):
        received_ns = trips[name].received_ns
        assert received_ns is not None and 0 < received_ns - trips[name].t_ns < MS
    assert trips["RC"].t_ns - trips["RA"].t_ns == pytest.approx(17 * MS, abs=0.3 * MS)
    assert trips["RA"].opened_ns == trips["RC"].opened_ns  # one breaker


def folded(*messages: tuple[str, int, str, dict]) -> Outcome:
    fold = Fold(Cast({"RA": "QA", "RB": "QA"}, ["F1"]))
    for topic, t_ns, name, fields in messages:
        fold.message(topic, t_ns, name, **fields)
    return fold.outcome()


TRIP = {"function": "PDIS1", "zone": 1, "loop": "AG", "poles": 1, "sample_count": 0}
CLOSED = {"pole_a": True, "pole_b": True, "pole_c": True, "command": ""}


def test_a_breaker_says_whom_it_obeyed() -> None:
    """Two trips, two commands: not what came first after the decision, but what was obeyed."""
    outcome = folded(
        ("/relay/RA/trips", 10, "Trip", TRIP),
        ("/relay/RB/trips", 11, "Trip", TRIP),
        ("/breaker/QA", 12, "BreakerStatus", CLOSED | {"command": "open", "relay": "RB"}),
        ("/breaker/QA", 14, "BreakerStatus", CLOSED | {"command": "open", "relay": "RA"}),
    )
    assert {trip.relay: trip.received_ns for trip in outcome.trips} == {"RA": 14, "RB": 12}


def test_poles_that_were_open_already_are_open_when_the_trip_is_received() -> None:
    outcome = folded(
        ("/breaker/QA", 0, "BreakerStatus", CLOSED | {"pole_a": False}),
        ("/relay/RA/trips", 10, "Trip", TRIP),
        ("/breaker/QA", 12, "BreakerStatus", CLOSED | {"pole_a": False, "command": "open"}),
    )
    (trip,) = outcome.trips
    assert (trip.received_ns, trip.opened_ns) == (12, 12)


def test_what_the_breaker_did_before_the_trip_or_without_it_is_not_the_trips() -> None:
    outcome = folded(
        ("/breaker/QA", 5, "BreakerStatus", CLOSED | {"command": "open"}),
        ("/breaker/QA", 8, "BreakerStatus", CLOSED | {"pole_a": False}),
        ("/relay/RA/trips", 10, "Trip", TRIP),
        ("/breaker/QA", 11, "BreakerStatus", CLOSED | {"pole_a": False, "command": "close"}),
    )
    (trip,) = outcome.trips
    assert (trip.received_ns, trip.received_by, trip.opened_ns) == (None, None, None)
