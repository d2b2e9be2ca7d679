"""Validation cases as data: what goes in, what must come out, by whom that is said, within what.

Each file of ``cases/`` is of one function or component: ``of``, ``part``, and an ``origin`` for the cases
that have none of their own.  A case names its check (`faultloop.study.suites.functions.checks`).
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from faultloop.study.suites.functions.checks import CHECKS

FOLDER = Path(__file__).parent / "cases"


@dataclass(frozen=True)
class Compared:
    """One number, list or word of a case: what is expected, what came, and how far off that is.

    ``off`` is the largest difference as a part of the tolerance: held up to 1.
    """

    key: str
    expected: Any
    got: Any
    tolerance: float | str | None
    off: float

    @property
    def held(self) -> bool:
        return self.off <= 1.0


@dataclass(frozen=True)
class Case:
    """A row of a validation table."""

    of: str
    name: str
    check: str
    input: dict[str, Any]
    expected: dict[str, Any]
    tolerance: dict[str, float | str]
    origin: str

    def compared(self) -> list[Compared]:
        """Everything that is expected of it, beside what came."""
        found = CHECKS[self.check](self.input)
        return [
            compare(key, expected, found[key], self.tolerance.get(key))
            for key, expected in self.expected.items()
        ]


def compare(key: str, expected: Any, got: Any, tolerance: float | str | None) -> Compared:
    """Words, and lists of them, are equal or not; of numbers the largest difference counts, and each needs a
    tolerance: a number, or "1 %" of what is expected."""
    words = expected if isinstance(expected, list) else [expected]
    if all(isinstance(word, str) for word in words):
        return Compared(key, expected, got, None, 0.0 if got == expected else np.inf)
    if tolerance is None:
        raise ValueError(f"{key}: a number needs a tolerance")
    number, wanted = np.asarray(got, float), np.asarray(expected, float)
    if number.shape != wanted.shape:
        return Compared(key, expected, got, tolerance, np.inf)
    scale = np.abs(wanted) * float(tolerance[:-1]) / 100 if isinstance(tolerance, str) else tolerance
    apart = np.abs(number - wanted) / scale
    off = float(np.max(apart, initial=0.0)) if np.isfinite(apart).all() else np.inf
    return Compared(key, expected, number.tolist(), tolerance, off)


@cache
def tables() -> dict[str, tuple[str, tuple[Case, ...]]]:
    """The part of each table, and its cases, by the file's name."""
    return {path.stem: _read(path) for path in sorted(FOLDER.glob("*.toml"))}


def cases_of(part: str) -> Iterator[Case]:
    """The cases of one part of the suite."""
    for own, cases in tables().values():
        if own == part:
            yield from cases


def _read(path: Path) -> tuple[str, tuple[Case, ...]]:
    data = tomllib.loads(path.read_text(encoding="utf-8"))
    origin = data.get("origin", "")
    return data["part"], tuple(
        Case(
            data["of"],
            case["name"],
            case["check"],
            case["input"],
            case["expected"],
            case.get("tolerance", {}),
            case.get("origin", origin),
        )
        for case in data["case"]
    )
