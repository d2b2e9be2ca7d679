"""A breaker's operating mechanism: what a command makes of the motions under way."""

from __future__ import annotations

from faultloop.plant.elements.switch import Action
from faultloop.plant.mechanism import commanded


def test_a_repeated_open_changes_nothing_and_a_quicker_one_comes_first() -> None:
    first = commanded((), Action(40, "part", 0, 7))
    assert commanded(first, Action(42, "part", 0, 3)) == first
    assert commanded(first, Action(39, "part", 0, 1)) == (*first, Action(39, "part", 0, 1))


def test_an_open_cancels_a_pending_close_pole_by_pole_of_its_own_breaker() -> None:
    pending = (Action(80, "make", 0, 7), Action(80, "make", 1, 7))
    after = commanded(pending, Action(60, "part", 0, 1))
    assert after == (Action(80, "make", 0, 6), Action(80, "make", 1, 7), Action(60, "part", 0, 1))
    assert commanded(pending[:1], Action(60, "part", 0, 7)) == (Action(60, "part", 0, 7),)


def test_no_command_takes_back_what_the_scenario_plans() -> None:
    planned = (Action(80, "make", 0, 7, planned=True),)
    assert commanded(planned, Action(60, "part", 0, 7)) == (*planned, Action(60, "part", 0, 7))


def test_a_close_follows_an_open() -> None:
    opening = (Action(40, "part", 0, 7),)
    assert commanded(opening, Action(90, "make", 0, 7)) == (*opening, Action(90, "make", 0, 7))
