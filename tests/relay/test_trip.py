"""Trip logic: which poles, for how long, and what comes after."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from faultloop.relay import Relay, RelayInputs, RelaySettings
from tests.relay.network import Network, play, settings_dict

NETWORK = Network()
ZONES = [{"zone": 1, "reach_pu": 0.8}, {"zone": 2, "reach_pu": 1.2, "delay_ms": 300.0}]
SINGLE = {"mode": "single-pole"}


def relay(**ptrc: Any) -> Relay:
    return Relay(RelaySettings.from_dict(settings_dict(NETWORK, ZONES, ptrc=ptrc)))


def trips(events: list) -> list[tuple[str, int, str, int]]:
    return [(e.trip.function, e.trip.zone, e.trip.loop, e.trip.poles) for e in events if e.trip]


@pytest.mark.parametrize(
    ("kind", "mode", "loop", "poles"),
    [
        ("BG", "three-pole", "BG", 7),
        ("BG", "single-pole", "BG", 2),
        ("CA", "single-pole", "CA", 7),
        ("BCG", "single-pole", "BC", 7),
        ("ABC", "single-pole", "ABC", 7),
    ],
)
def test_poles(kind: str, mode: str, loop: str, poles: int) -> None:
    r = relay(mode=mode)
    events = play(r, NETWORK.fault(kind, 0.4))
    assert trips(events) == [("PDIS1", 1, loop, poles)]
    assert r.outputs.trip_poles == poles
    assert [e.text for e in events if e.trip] == [
        f"PTRC1 Tr poles {'ABC' if poles == 7 else 'B'} zone 1 loop {loop}"
    ]


def test_only_the_zones_named_trip() -> None:
    r = relay(zones=[2])
    events = play(r, NETWORK.fault("AG", 0.4, duration_s=0.6))
    assert trips(events) == [("PDIS2", 2, "AG", 7)]


def test_a_growing_fault_ends_with_three_poles() -> None:
    """A-G, and before its pole has opened A-B-G."""
    stages = [(0.0, NETWORK.solve()), (0.1, NETWORK.solve("AG", 0.4)), (0.13, NETWORK.solve("ABG", 0.4))]
    r = relay(**SINGLE)
    events = play(r, NETWORK.samples(stages, 0.25))
    assert trips(events) == [("PDIS1", 1, "AG", 1), ("PDIS1", 1, "AB", 7)]


def test_the_trip_lasts_until_the_current_is_gone_and_at_least_its_time() -> None:
    after = np.concatenate([NETWORK.solve()[:3], np.zeros(3)])
    for opened_s, at_least_s in ((0.14, 0.0), (0.30, 0.30)):
        stages = [(0.0, NETWORK.solve()), (0.1, NETWORK.solve("BC", 0.4)), (opened_s, after)]
        events = play(relay(minimum_trip_ms=80.0), NETWORK.samples(stages, 0.6))
        on = next(e.sample_count for e in events if e.trip)
        off = next(e.sample_count for e in events if e.text == "PTRC1 Tr reset")
        assert off - on >= 0.08 * 4800
        assert off >= at_least_s * 4800
        if not at_least_s:
            assert off - on == 0.08 * 4800  # the current was gone: exactly the minimum


def test_the_breaker_s_report_ends_a_trip_that_a_current_remnant_would_hold() -> None:
    stages = [(0.0, NETWORK.solve()), (0.1, NETWORK.solve("AG", 0.4)), (0.15, NETWORK.solve())]
    x = NETWORK.samples(stages, 0.4)  # the fault is gone but the load current stays
    held = relay()
    play(held, x)
    assert held.outputs.trip_poles == 7
    told = relay()
    play(told, x[:800])
    told.inputs = RelayInputs(breaker_closed=0)
    play(told, x[800:])
    assert told.outputs.trip_poles == 0


def single_pole_cycle(second: str, second_at: float) -> list:
    """B-G, pole B opens for a second, and in its dead time another fault, if any."""
    dead = Network(open_pole=1)
    stages = [
        (0.0, NETWORK.solve()),
        (0.1, NETWORK.solve("BG", 0.4)),
        (0.16, dead.solve()),
        (0.5, dead.solve(second, second_at) if second else dead.solve()),
    ]
    x = NETWORK.samples(stages, 0.7)
    r = relay(**SINGLE)
    events = play(r, x[: int(0.165 * 4800)])
    r.inputs = RelayInputs(breaker_closed=0b101)
    return events + play(r, x[int(0.165 * 4800) :])


def test_the_dead_time_of_a_pole_is_quiet() -> None:
    """Load in two phases is full of negative and zero sequence, and no fault."""
    events = single_pole_cycle("", 0.0)
    assert trips(events) == [("PDIS1", 1, "BG", 2)]
    assert any(e.text == "PTRC1 Tr reset" for e in events)


@pytest.mark.parametrize(("second", "loop"), [("AG", "AG"), ("CA", "CA"), ("CG", "CG")])
def test_a_second_fault_while_a_pole_is_open_trips_three(second: str, loop: str) -> None:
    assert trips(single_pole_cycle(second, 0.4)) == [("PDIS1", 1, "BG", 2), ("PDIS1", 1, loop, 7)]


def test_a_fault_behind_while_a_pole_is_open_does_not_trip() -> None:
    assert trips(single_pole_cycle("AG", -1.0)) == [("PDIS1", 1, "BG", 2)]


def test_zone_2_outlasts_the_far_end_s_opening() -> None:
    """The far breaker takes the load from the healthy phases; the timer runs on, and the loop is the same."""
    far_open = Network(zr1=1e7 + 0j, zr0=1e7 + 0j)
    stages = [
        (0.0, NETWORK.solve()),
        (0.1, NETWORK.solve("AG", 0.92)),
        (0.16, far_open.solve("AG", 0.92)),
    ]
    assert trips(play(relay(), NETWORK.samples(stages, 0.6))) == [("PDIS2", 2, "AG", 7)]


def test_the_pilot_bit_follows_its_zone() -> None:
    r = relay(pilot_zone=2)
    x = NETWORK.fault("AG", 0.95)
    play(r, x)
    assert (r.outputs.pilot, r.outputs.trip_poles) == (1, 0)
