"""Ways that differ, vary and change, clocks that are lost or wrong: what line differential makes of them."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from faultloop.io.can.frames import Rejection
from faultloop.nodes.clock import FOREVER
from faultloop.relay.events import Names
from faultloop.relay.far_ends import tell
from faultloop.relay.functions.pdif import PDIF
from faultloop.relay.recent import LENGTH
from faultloop.relay.settings import RelaySettings
from tests.loop.test_line_differential import MS, THROUGH, End, run
from tests.relay.functions.kernel import GIVEN, TURN

FAULT = 1000 * TURN, 2000 * TURN
AMPERES_PER_MS = 2000 * np.sin(np.radians(9.0) / 2)
"""|sum| of 1000 A through the line for a millisecond of a wrong clock."""


def pair(*clocks: tuple[int, int, int], **keys: Any) -> tuple[End, End]:
    own = clocks or ((0, 0, FOREVER), (0, 0, FOREVER))
    return End(0, own[0], **keys), End(1, own[1], **keys)


def said(end: End) -> list[str]:
    """What the function has told by now, from its state alone."""
    settings = RelaySettings.from_dict(GIVEN | {"pdif": {"pickup_a": 200.0}})
    was, now = np.zeros_like(end.w[0]), end.w[0]
    return [event.text for event in tell(Names(0, settings, {}), was, now)]


def shown(end: End, bit: int) -> int:
    return int(end.q["pickup"][0]) >> bit & 1


CH_BLK, CH_ASYM = 4, 7


def varying(jitter_ms: float, seed: int = 1, delay_ms: float = 5.0) -> Callable[[int], tuple[float, float]]:
    """Each way's delay, uniform from `delay_ms` on."""
    draws = np.random.default_rng(seed).random((4000, 2))
    return lambda k: (delay_ms + jitter_ms * draws[k, 0], delay_ms + jitter_ms * draws[k, 1])


@pytest.mark.parametrize(("jitter_ms", "told"), [(0.5, 0), (5.0, 1), (12.0, 1)])
def test_delays_that_vary_are_no_clock_that_jumps(jitter_ms: float, told: int) -> None:
    """Nobody trips for what flows through, and both do for a fault, as soon as its sets are there; more than
    some 2 ms are told.  The clock is known to a sixth of what a delay varies by."""
    keys: dict[str, Any] = {"alignment": "channel", "characteristic": "percentage"}
    ends = pair((0, 0, 0), (77_000_000, 20_000, 0), **keys)
    within = 1000 + round((5 + jitter_ms + 15) * 4.8)
    ways = varying(jitter_ms)
    assert run(ends, THROUGH, ways, samples=1000) == [False, False]
    assert all(end.node.rejected[Rejection.JUMP] == 0 for end in ends)
    assert all(np.abs(end.sums()).max() < (jitter_ms / 6 + 0.02) * AMPERES_PER_MS for end in ends)
    assert [shown(end, CH_ASYM) for end in ends] == [told, told]
    if told:  # they vary, and do not differ
        assert all(any(" and back vary by " in line for line in said(end)) for end in ends), said(ends[0])
    ends = pair((0, 0, 0), (77_000_000, 20_000, 0), **keys)
    assert run(ends, THROUGH, ways, samples=within, then=[(1000, FAULT)]) == [True, True]


def test_sets_that_come_too_late_block_and_the_reason_is_told() -> None:
    ends = pair()
    assert run(ends, THROUGH, (62.0, 62.0), samples=700, then=[(500, FAULT)]) == [False, False]
    text = "as those of relay number 1 take 61.9 ms, of 40 that are bridged"
    assert shown(ends[0], CH_BLK) and any(text in line for line in said(ends[0])), said(ends[0])


@pytest.mark.parametrize(("there_ms", "back_ms"), [(12.0, 12.0), (14.0, 10.0), (5.0, 9.0)])
def test_another_path_leaves_the_clock_alone(there_ms: float, back_ms: float) -> None:
    """By the round trip: what changes together with it is the ways', and the clock of before holds; where
    they differ by more than asymmetry_ms that is told, and the rules are the harder ones."""
    clocks = (0, 0, 0), (33_000_000, 10_000, 0)
    ends = pair(*clocks, alignment="channel", sequence=False)

    def ways(k: int) -> tuple[float, float]:
        return (there_ms, back_ms) if k >= 480 else (5.0, 5.0)

    assert run(ends, THROUGH, ways, samples=1080) == [False, False]
    differ_ms = there_ms - back_ms
    for end, sign in zip(ends, (-1, 1), strict=True):
        far = end.w["remote"][0, 0]
        np.testing.assert_allclose(far["ways_us"], -1000 * sign * differ_ms, atol=60)
        np.testing.assert_allclose(far["trip_us"], 1000 * (there_ms + back_ms), atol=60)
        assert (int(far["switches"]), int(far["jumps"])) == (1, 0)
        assert int(end.w["age"][0]) < 100 and np.abs(end.sums()).max() < 0.01 * AMPERES_PER_MS
        assert shown(end, CH_ASYM) == (abs(differ_ms) > 1.5)
        if abs(differ_ms) > 1.5:
            found = [re.search(r" and back differ by (\S+) ms;", line) for line in said(end)]
            assert [float(one[1]) for one in found if one] == [pytest.approx(abs(differ_ms), abs=0.06)]
        assert any("another path to relay number" in line for line in said(end))


def test_a_clock_that_jumps_is_told() -> None:
    ends = pair((0, 0, 0), (33_000_000, 0, 0), alignment="channel")

    def lost(number: int, to: int) -> bool:
        if number == 40:
            ends[1].node.set_clock(40 * MS, 0, 0)
        return False

    assert run(ends, THROUGH, samples=960, lost=lost) == [False, False]
    assert [int(end.w["remote"][0, 0]["jumps"]) for end in ends] == [1, 1]
    assert "PDIF1: the clock here or of relay number 1 has jumped, they differ by 40.0" in said(ends[0])[0]


@pytest.mark.parametrize("asymmetry_ms", [0.4, 3.0])
def test_by_the_time_of_all_the_ways_are_measured(asymmetry_ms: float) -> None:
    """They turn nothing, and are told where they differ."""
    ends = pair()
    ways = 6 + asymmetry_ms / 2, 6 - asymmetry_ms / 2
    assert run(ends, THROUGH, ways, samples=600) == [False, False]
    np.testing.assert_allclose(ends[0].w["remote"][0, 0]["ways_us"], 1000 * asymmetry_ms, atol=5)
    np.testing.assert_allclose(ends[1].w["remote"][0, 0]["ways_us"], -1000 * asymmetry_ms, atol=5)
    assert np.abs(ends[0].sums()).max() < 0.02
    assert [shown(end, CH_ASYM) for end in ends] == [int(asymmetry_ms > 1.5)] * 2


@pytest.mark.parametrize("characteristic", ["alpha", "percentage"])
def test_the_round_trip_stands_in_for_a_time_that_is_lost(characteristic: str) -> None:
    """With the ways' difference of before, 3 ms, for as long as it is lost: the clock drifts by 65 us."""
    keys: dict[str, Any] = {"time_lost": "hold", "characteristic": characteristic}
    lost_ns = 120 * MS
    ends = pair((0, 0, FOREVER), (0, 500_000, lost_ns), **keys)
    assert run(ends, THROUGH, (7.5, 4.5), samples=1200) == [False, False]
    assert [shown(end, CH_BLK) for end in ends] == [0, 0] and [shown(end, CH_ASYM) for end in ends] == [1, 1]
    assert all(np.abs(end.sums()).max() < 0.1 * AMPERES_PER_MS for end in ends)  # the mean's lag, 50 us
    assert sum("the round trip stands in for it" in line for line in said(ends[0])) == 1
    ends = pair((0, 0, FOREVER), (0, 500_000, lost_ns), **keys)
    assert run(ends, THROUGH, (7.5, 4.5), samples=1000, then=[(800, FAULT)]) == [True, True]


@pytest.mark.parametrize("offset_ms", [-7.0, 7.0, 20.0])
def test_a_wrong_clock_that_takes_itself_for_right_is_none(offset_ms: float) -> None:
    """No way of 5 ms takes less than nothing: from the first set on it is refused, at both ends."""
    ends = pair((0, 0, FOREVER), (round(offset_ms * MS), 0, FOREVER))
    assert run(ends, FAULT, samples=480) == [False, False]
    assert all(end.node.rejected[Rejection.JUMP] > 30 for end in ends)


@pytest.mark.parametrize("time_lost", ["block", "hold"])
def test_a_clock_that_jumps_and_takes_itself_for_right(time_lost: str) -> None:
    """By 3 ms, which ways of 5 ms allow: out and told, or on by the round trip; when it is right again, all
    is as before."""
    ends, seen = pair(time_lost=time_lost), []
    told: list[str] = []

    def lost(number: int, to: int) -> bool:
        if number == 115:
            seen.append([shown(end, CH_BLK) for end in ends])
            told.extend(said(ends[0]))
        if number in (40, 120):
            ends[1].node.set_clock(3 * MS if number == 40 else 0, 0, FOREVER)
        return False

    assert run(ends, THROUGH, samples=2200, lost=lost) == [False, False]
    assert seen[0] == [int(time_lost == "block")] * 2
    assert [shown(end, CH_BLK) + shown(end, CH_ASYM) for end in ends] == [0, 0]
    assert np.abs(ends[0].sums()).max() < 0.1
    text = "as the clocks here and of relay number 1 differ by 3.00 ms"
    assert any(text in line for line in told) == (time_lost == "block")


def test_three_ends_take_off_a_third_each() -> None:
    """What a line charges is taken off once, whatever the number of its ends."""

    keys: dict[str, Any] = {"b1_us": 300.0, "b0_us": 200.0}
    for remotes, share in ((1, 2), (2, 3)):
        end = End(0, **keys)
        end.w["remotes"] = remotes
        numbers = np.arange(1 - LENGTH, 1)
        end.q["recent"]["value"][0, :, :3] = (
            np.sqrt(2) * 1e5 * np.real(np.exp(2j * np.pi * 50 * numbers / 4800)[:, None] * TURN)
        )
        end.q["recent"]["head"] = LENGTH - 1
        end.q["number"] = 0
        c, s = end.constants.view(np.recarray)[0], end.state.view(np.recarray)[0]
        PDIF.step(c.shared, s.shared, c.pdif[0], s.pdif[0])
        np.testing.assert_allclose(
            end.w["own"]["charging"][0, 0], 1j * 300e-6 * 1e5 * TURN / share, rtol=1e-9
        )
