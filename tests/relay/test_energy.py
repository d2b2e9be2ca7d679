"""The sign of a disturbance's energy by itself."""

from __future__ import annotations

import numpy as np

from faultloop.relay.energy import ENERGY, follow


def given(steps: list[tuple[float, float]], cycle: int = 96) -> list[int]:
    """The direction after each of ``steps``: energy so far, and what voltage and current allow so far."""
    e, g = np.zeros(1, ENERGY), np.array([(cycle,)], [("cycle", "i8")])
    found = []
    for energy, apparent in steps:
        e["now"][0] = energy, apparent, apparent
        follow(g[0], e[0])
        found.append(int(e["direction"][0]))
    return found


def test_it_takes_a_part_of_what_is_possible_and_four_times_the_other_side() -> None:
    assert given([(0.01, 1.0), (0.03, 1.0)]) == [0, -1]
    assert given([(-0.01, 1.0), (-0.03, 1.0)]) == [0, 1]
    assert given([(0.03, 1.0), (-0.03, 1.0), (-0.13, 1.0)]) == [-1, 0, 1]


def test_a_sign_stays_while_what_is_given_comes_back() -> None:
    """A lossless network behind: energy between 0 and 1, what is possible grows without end (before: no sign
    from 50 on, and the impedance of a resonance is that of a fault ahead)."""
    steps = [(1.0 - np.cos(t), 2.0 * t) for t in np.arange(0.5, 200.0, 0.5)]
    assert set(given(steps)[2:]) == {-1}


def test_it_is_given_up_where_the_other_side_gets_as_much() -> None:
    assert given([(1.0, 2.0), (-0.3, 40.0), (-3.0, 60.0), (-5.0, 80.0)]) == [-1, 0, 0, 1]


def test_it_stays_after_four_cycles() -> None:
    """Sources that slip in the fault have gone away from the reference by then."""
    assert given([(1.0, 2.0)] * 5 + [(-3.0, 60.0), (-5.0, 80.0)], cycle=1) == [-1] * 7
    assert given([(0.0, 2.0)] * 5 + [(-3.0, 60.0)], cycle=1) == [0] * 5 + [1]


def test_one_that_was_lost_is_given_again_but_no_other_one_after_four_cycles() -> None:
    """A fault behind, and sources ahead that slip meanwhile (before: ahead, and zone 1 after 190 ms)."""
    lost = [(1.0, 2.0), (-0.3, 40.0)]
    assert given([*lost, *[(-0.3, 40.0)] * 3, (-5.0, 80.0)], cycle=1) == [-1, 0, 0, 0, 0, 0]
    assert given([*lost, *[(-0.3, 40.0)] * 3, (5.0, 80.0)], cycle=1) == [-1, 0, 0, 0, 0, -1]
    assert given([(0.0, 2.0)] * 6 + [(-5.0, 80.0)], cycle=1) == [0] * 6 + [1], "a first one at any time"
