"""A grid with conditions: the same combinations as by going through all of them."""

from __future__ import annotations

import pickle
from typing import Any

import pytest

from faultloop.config.campaign import Vary
from faultloop.errors import InputError
from faultloop.study.campaign import grid
from faultloop.study.campaign.condition import Condition
from faultloop.study.campaign.draw import Draws
from faultloop.study.campaign.grid import Grid

VARIED: list[dict[str, Any]] = [
    {"key": "a.x", "range": [0, 1, 7]},
    {"keys": ["b.y", "b.z"], "values": [1, 2, 5], "factor": {"c.w": 0.5}},
    {"key": "d.type", "values": ["AG", "BC"]},
    {"key": "e.on", "values": [True, False]},
]
CONDITIONS = [
    ["a.x < 0.6"],
    ["a.x * b.y > 1 or d.type == 'AG'", "not e.on or c.w == 0.5"],
    ["b.z in [1, 5]", "a.x != 0.5", "1 < 2"],
]


@pytest.mark.parametrize("texts", CONDITIONS)
@pytest.mark.parametrize("block", [grid.BLOCK, 5])
def test_what_remains(texts: list[str], block: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(grid, "BLOCK", block)
    draws = Draws([Vary.model_validate(vary) for vary in VARIED], 1, "grid")
    keys = list(draws.at(0))
    conditions = [Condition(text, keys, "only") for text in texts]
    by_hand = [n for n in range(draws.grid_size) if all(c.holds(draws.at(n)) for c in conditions)]
    made = Grid(draws, pickle.loads(pickle.dumps(conditions)))
    assert len(made) == len(by_hand)
    assert [made.combination(case) for case in range(len(made))] == by_hand
    assert made.combination(3) == by_hand[3]


def test_a_condition_is_judged_for_its_own_keys_only(monkeypatch: pytest.MonkeyPatch) -> None:
    """A grid of a million whose condition is over two keys of three values: nine judgements."""
    varied = [
        Vary(key=f"a.{name}", range=(0, 1, count))
        for name, count in zip("xyzw", (3, 1000, 3, 111), strict=True)
    ]
    draws, seen = Draws(varied, 1, "grid"), []
    condition = Condition("a.x <= a.z", list(draws.at(0)), "only")
    assert condition.keys == {"a.x", "a.z"}
    real = condition._judge
    monkeypatch.setattr(condition, "_judge", lambda values: seen.append(1) or real(values))
    made = Grid(draws, [condition])
    assert (len(made), len(seen)) == (6 * 111_000, 9)
    last = draws.at(made.combination(len(made) - 1))
    assert last == {"a.x": 1.0, "a.y": 1.0, "a.z": 1.0, "a.w": 1.0}


def test_too_much_and_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    draws = Draws([Vary.model_validate(vary) for vary in VARIED], 1, "grid")
    with pytest.raises(InputError, match=r"holds in none of the 84 combinations"):
        Grid(draws, [Condition("a.x > 2", list(draws.at(0)), "only")])
    monkeypatch.setattr(grid, "MOST_JUDGED", 20)
    with pytest.raises(InputError, match=r"is over 21 combinations; at most 20"):
        Grid(draws, [Condition("a.x > b.y", list(draws.at(0)), "only")])
