"""Reclosing and breaker failure in the closed loop: times; the sequences are cases of `suite functions`."""

from __future__ import annotations

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
