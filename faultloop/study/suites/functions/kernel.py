"""A function's kernel by itself: its records, filled by hand, and one sample after the other."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from faultloop.relay import quantities
from faultloop.relay.functions.function import BitsOf, Function
from faultloop.relay.recent import LENGTH
from faultloop.relay.settings import RelaySettings

GIVEN = {"relay": {"frequency_hz": 50}, "line": {"z1_ohm": [3.0, 30.0], "z0_ohm": [12.0, 90.0]}}
TURN = np.exp(-2j * np.pi / 3 * np.arange(3))


class Kernel:
    """``step(g, q, c, w)`` of a function with settings, on a line of 3 + 30j ohm at 4800 samples per second.

    Attributes
    ----------
    g, q, c, w : its records; ``q`` is that of a settled estimator, undisturbed.
    """

    def __init__(self, function: Function, table: dict[str, Any], **more: Any) -> None:
        data = GIVEN | more | {function.key: [table] if function.most > 1 else table}
        settings = RelaySettings.from_dict(data)
        self.function = function
        self.g, self.q = _zeros(quantities.CONSTANTS), _zeros(quantities.QUANTITIES)
        self.c, self.w = _zeros(function.constants_dtype), function.initial_state(1).view(np.recarray)[0]
        _fill(self.g, quantities.constants(settings, 96))
        _fill(self.c, function.values(settings, settings.tables(function)[0]))
        quantities.clear(self.q)
        self.q["settled"] = self.q["ready"] = 1
        self.q["proven"], self.q["memory"]["frequency"] = 7, self.g["frequency"]

    def step(self, phasors: Any = None, count: int = 1, **published: Any) -> None:
        """``count`` samples, of phasors (6,) where they are given; what is published cleared before each, but
        for what earlier functions are said to have ``published``."""
        if phasors is not None:
            self.q["x"] = phasors
            quantities.sequences(self.q["x"], self.q["sequence"])
        for _ in range(count):
            quantities.forget(self.q)
            for key, value in published.items():
                self.q[key] = value
            self.function.step(self.g, self.q, self.c, self.w)

    def disturb(self, before: Any, now: Any, age: int = 1) -> None:
        """A disturbance ``age`` samples old, with these phasors (6,) before it and now, and such samples."""
        self.q["disturbed"] = self.q["fed"] = 1
        self.q["x"], self.q["d"] = now, np.subtract(now, before)
        self.q["memory"]["reference"], self.q["memory"]["age"] = before, age
        quantities.sequences(self.q["x"], self.q["sequence"])
        quantities.sequences(self.q["d"], self.q["change"])
        turn = np.exp(2j * np.pi * np.arange(1 - LENGTH, 1) / 96)
        self.q["recent"]["value"][:, :6] = np.sqrt(2) * np.real(turn[:, None] * np.asarray(now))
        self.q["recent"]["head"] = LENGTH - 1


def _zeros(dtype: np.dtype) -> Any:
    return np.zeros(1, dtype).view(np.recarray)[0]


def _fill(record: Any, values: Mapping[str, Any]) -> None:
    for key, value in values.items():
        if not isinstance(value, BitsOf):  # there are no other functions
            record[key] = value
