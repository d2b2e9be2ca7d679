"""Reclosing and breaker failure in the closed loop: times; the sequences are cases of `suite functions`."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from faultloop.errors import InputError
from faultloop.loop.runner import run
from faultloop.loop.scenario import load_scenario
from faultloop.study.suites.functions.sequence_checks import Messages, shipped


def kept(name: str) -> Messages:
    sink = Messages()
    run(load_scenario(shipped(name)), sinks=[sink])
    return sink


def test_the_follower_closes_once_the_line_has_been_in_step_for_the_hold_time() -> None:
    closed = {
        fields["topic"]: t_ns / 1e6
        for t_ns, kind, fields in kept("reclosing").kept
        if kind == "BreakerStatus" and fields["pole_a"] and fields["pole_b"] and t_ns > 5e8
    }
    leader, follower = closed["/breaker/QA"], closed["/breaker/QB"]
    assert 616.0 + 80.0 < leader < 616.0 + 82.0, "300 ms after all poles are open, and the breaker's 80 ms"
    assert follower > leader + 180.0, "100 ms in step, and the breaker's 80 ms"


def test_the_last_infeed_is_gone_50_ms_after_the_back_trip() -> None:
    opened = {
        fields["topic"]: t_ns / 1e6
        for t_ns, kind, fields in kept("breaker-failure").kept
        if kind == "BreakerStatus" and not (fields["pole_a"] or fields["pole_b"] or fields["pole_c"])
    }
    assert opened.keys() == {"/breaker/QB", "/breaker/QX"}
    assert opened["/breaker/QX"] < 310.0


def test_an_extended_zone_trips_once_and_then_leaves_the_fault_to_zone_2(tmp_path: Path) -> None:
    """A-B-C at 95 % that stays: reclosed after zone 5 of 120 %, without delay; onto it zone 2 trips, with its
    350 ms."""
    shutil.copytree(shipped("reclosing").parent / "settings", tmp_path / "settings")
    leader = tmp_path / "settings" / "ab-reclose-leader.toml"
    text = leader.read_text(encoding="utf-8").replace("zones = [1, 2, 4]", "zones = [1, 2, 4, 5]")
    text = text.replace("[rrec]", "[[pdis]]\nzone = 5\nreach_pu = 1.2\n\n[rrec]\nextension_zone = 5")
    leader.write_text(text, encoding="utf-8")
    path = shutil.copy(shipped("reclosing"), tmp_path)
    stays = ["fault.F1.at_pu=0.95", "fault.F1.type=ABC", "fault.F1.duration_s=9", "scenario.duration_s=1.2"]
    result = run(load_scenario(path, [*stays, "fault.F2.resistance_ohm=1e9"]))
    trips = [trip for trip in result.trips if trip.relay == "RA"]
    assert [trip.function for trip in trips] == ["PDIS5", "PDIS2"]
    closed_ns = next(e.t_ns for e in result.events if "the reclaim time begins" in e.text)
    assert trips[0].t_ns < 150e6
    assert trips[1].t_ns - closed_ns == pytest.approx(360e6, abs=20e6)


@pytest.mark.parametrize(
    ("override", "key", "what"),
    [
        (
            'relay.RA.back_trip=["QZ"]',
            "relay[RA].back_trip",
            "there is no breaker 'QZ'; did you mean 'QX'?",
        ),
        (
            'relay.RA.back_trip=["QA"]',
            "relay[RA].back_trip",
            "'QA' is the breaker that fails; name those around it",
        ),
        (
            "relay.RA.parallel=RB",
            "relay[RA].parallel",
            "'RB' is on the same line; name the relay of the parallel one",
        ),
        ("relay.RA.parallel=RX", "relay[RA].parallel", "there is no relay 'RX'; did you mean 'RB'?"),
    ],
)
def test_what_is_wrong_is_named(override: str, key: str, what: str) -> None:
    with pytest.raises(InputError) as error:
        load_scenario(shipped("breaker-failure"), [override])
    assert (error.value.key, error.value.what) == (key, what)
