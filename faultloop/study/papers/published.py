"""A paper's own figure beside ours, by every reading of the paper's text."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from faultloop.study.report import Check, Report, Table, cell


@dataclass(frozen=True)
class Published:
    """A figure of a paper.

    Attributes
    ----------
    what, figure, unit : what was published; ours should be at most that (``at_least``: at least).
    readings : ours by each reading of the text, the plainest first.
    rounding : half a unit of the last digit that is printed, where the figure is that coarse.
    bound, because : the best that anything could do by those readings, where it is known, and what shows it.
    """

    what: str
    figure: float
    readings: Mapping[str, float]
    unit: str = ""
    at_least: bool = False
    bound: float | None = None
    because: str = ""
    rounding: float = 0.0

    def check(self) -> Check:
        """Of the first reading that reaches the figure, else of the one that is nearest."""
        return self._best()[1]

    def row(self) -> tuple[object, ...]:
        """The figure, ours by the plainest reading and by the best, and what became of it."""
        name, check = self._best()
        plainest = next(iter(self.readings.values()))
        became = "reached" if check.held else check.status
        return (
            self.what,
            f"{cell(self.figure)} {self.unit}".rstrip(),
            cell(plainest),
            cell(check.value),
            name,
            became,
        )

    def _best(self) -> tuple[str, Check]:
        checks = [(name, self._held_against(name, value)) for name, value in self.readings.items()]
        held = [each for each in checks if each[1].held]
        return held[0] if held else max(checks, key=lambda each: _finite(each[1].margin))

    def _held_against(self, reading: str, value: float) -> Check:
        what = f"{self.what}; {reading}"
        limit = self.figure - self.rounding if self.at_least else self.figure + self.rounding
        return Check(what, value, limit, self.unit, self.at_least, self.bound, self.because)


def _finite(margin: float) -> float:
    return -math.inf if math.isnan(margin) else margin


TITLE = "What was published, and by which reading it is reached"


def state(report: Report, published: Sequence[Published]) -> None:
    """Rows of the table of what was published, which stands before all others, and a check for each."""
    columns = ("published", ">figure", ">ours, plainest reading", ">best reading", "that reading", "status")
    rows: list[Sequence[object]] = [each.row() for each in published]
    if report.tables and report.tables[0].title == TITLE:
        rows = [*report.tables.pop(0).rows, *rows]
    report.tables.insert(0, Table(TITLE, columns, rows))
    report.checks += [each.check() for each in published]
