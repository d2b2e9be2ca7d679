"""The combinations of a grid that its conditions leave, by number; none of them is kept."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from faultloop.errors import InputError
from faultloop.study.campaign.condition import Condition
from faultloop.study.campaign.draw import Draws

BLOCK = 65_536
MOST_JUDGED = 10_000_000
"""Combinations of the keys of one condition."""


class Grid:
    """All combinations; the last ``[[vary]]`` changes first.  Raises InputError where none is left.

    A condition is judged once for each combination of the keys that are in it, so that a grid of a million
    costs what its conditions do.
    """

    def __init__(self, draws: Draws, conditions: Sequence[Condition]) -> None:
        listed = [values for values in draws.listed if values is not None]
        self.shape = tuple(map(len, listed))
        self.size = math.prod(self.shape)
        self._held = [_judged(draws, listed, condition) for condition in conditions]
        blocks = range(0, self.size, BLOCK) if conditions else ()
        self._ends = np.cumsum([len(self._remaining(begin)) for begin in blocks], dtype=np.int64)
        self._block: tuple[int, NDArray[np.int64]] = (-1, np.empty(0, np.int64))
        if conditions and not len(self):
            raise InputError(f"holds in none of the {self.size} combinations: there are no cases", key="only")

    def __len__(self) -> int:
        return int(self._ends[-1]) if self._held else self.size

    def combination(self, case: int) -> int:
        """Number of the case's combination among all."""
        if not self._held:
            return case
        number = int(np.searchsorted(self._ends, case, side="right"))
        block = self._block  # which another thread may change
        if block[0] != number:
            block = self._block = number, self._remaining(number * BLOCK)
        return int(block[1][case - (self._ends[number - 1] if number else 0)])

    def _remaining(self, begin: int) -> NDArray[np.int64]:
        numbers = np.arange(begin, min(begin + BLOCK, self.size))
        indices = np.unravel_index(numbers, self.shape)
        left = np.ones(len(numbers), bool)
        for places, holds in self._held:
            left &= holds[tuple(indices[place] for place in places)]
        return numbers[left]


def _judged(
    draws: Draws, listed: Sequence[Sequence[Any]], condition: Condition
) -> tuple[list[int], NDArray[np.bool_]]:
    """Places of the ``[[vary]]`` that a condition depends on; whether it holds at each of their values."""
    places = [place for place, vary in enumerate(draws.varied) if condition.keys & set(vary.all_keys)]
    shape = tuple(len(listed[place]) for place in places)
    if math.prod(shape) > MOST_JUDGED:
        raise InputError(
            f"'{condition.text}' is over {math.prod(shape)} combinations; at most {MOST_JUDGED} are possible",
            key=condition.where,
        )
    keyed = [[draws.keyed(place, value) for value in listed[place]] for place in places]
    merged = ({key: value for one in own for key, value in one.items()} for own in product(*keyed))
    holds = np.fromiter(map(condition.holds, merged), bool, math.prod(shape))
    return places, holds.reshape(shape)
