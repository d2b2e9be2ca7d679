"""What is told of a campaign on its way, by a clock of our own."""

from __future__ import annotations

import pytest

from faultloop.cli.campaign_progress import EVERY_S, Pace, duration, lines


class Clock:
    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


def test_what_was_there_before_tells_nothing_of_the_rate() -> None:
    clock = Clock()
    pace = Pace(clock)
    pace.take(500)
    assert pace.told(500, 1000) == ""
    clock.now += 10
    pace.take(520)
    assert pace.told(520, 1000) == "7,200 an hour, 4 min left"


def test_parts_in_clumps_do_not_shake_the_rate() -> None:
    """Two workers, each with a part of 100 cases in 20 s: 10 cases a second, whenever one looks."""
    clock = Clock()
    pace = Pace(clock)
    pace.take(0)
    for number in range(1, 31):
        clock.now = 100 + 20 * number
        pace.take(200 * number - 100)
        clock.now += 0.01
        pace.take(200 * number)
        assert pace.per_s == pytest.approx(10.0, rel=0.1)


def test_the_rate_follows_what_is_so_now() -> None:
    """The first hour slow, by a load that is gone."""
    clock = Clock()
    pace = Pace(clock)
    pace.take(0)
    done = 0
    for seconds, cases in ((3600, 1), (200, 10)):
        for _ in range(seconds):
            clock.now += 1
            done += cases
            pace.take(done)
    assert pace.per_s == pytest.approx(10.0)


def test_lines_for_a_pipe(capsys: pytest.CaptureFixture[str]) -> None:
    """None of a short campaign; then one each half minute, and none at the end."""
    clock = Clock()
    show = lines(clock)
    show(0, 1000)
    for done in range(10, 1001, 10):
        clock.now += 1
        show(done, 1000)
    told = capsys.readouterr().err.splitlines()
    assert told == [
        "300 of 1000 cases, 36,000 an hour, 70 s left",
        "600 of 1000 cases, 36,000 an hour, 40 s left",
        "900 of 1000 cases, 36,000 an hour, 10 s left",
    ]
    assert EVERY_S == 30


def test_durations() -> None:
    assert [duration(s) for s in (0.4, 89, 100, 3600, 7500)] == [
        "0 s",
        "89 s",
        "2 min",
        "60 min",
        "2 h 05 min",
    ]
