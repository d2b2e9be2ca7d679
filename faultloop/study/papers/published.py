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
    readings : what the paper's own method gives by each reading of the text, the plainest first.
    ours : what a method of ours gives, where there is one; it stands beside, and is no reading.
    rounding : half a unit of the last digit that is printed (a whole one where digits are cut off).
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
    ours: float | None = None

    def check(self) -> Check:
        """Of the first reading that reaches the figure; where none does, of ours if it does, else of the
        reading that is nearest."""
        best = self._best()[1]
        if not best.held and self.ours is not None:
            own = self._against("ours", self.ours)
            return own if own.held else best
        return best

    def row(self) -> tuple[object, ...]:
        """The figure, by the plainest reading and by the best, ours, and what became of it."""
        name, best = self._best()
        plainest = next(iter(self.readings.values()))
        check = self.check()
        became = "reached" if best.held else "reached by ours only" if check.held else check.verdict
        return (
            self.what,
            f"{cell(self.figure)} {self.unit}".rstrip(),
            cell(plainest),
            cell(best.value),
            name,
            "" if self.ours is None else cell(self.ours),
            became,
        )

    def _best(self) -> tuple[str, Check]:
        checks = [(name, self._against(name, value)) for name, value in self.readings.items()]
        held = [each for each in checks if each[1].held]
        return held[0] if held else max(checks, key=lambda each: _finite(each[1].margin))

    def _against(self, reading: str, value: float) -> Check:
        what = f"{self.what}; {reading}"
        limit = self.figure - self.rounding if self.at_least else self.figure + self.rounding
        return Check(what, value, limit, self.unit, self.at_least, self.bound, self.because)


def _finite(margin: float) -> float:
    return -math.inf if math.isnan(margin) else margin


TITLE = "What was published, and by which reading it is reached"


def state(report: Report, published: Sequence[Published]) -> None:
    """Rows of the table of what was published, which stands before all others, and a check for each."""
    columns = (
        "published",
        ">figure",
        ">plainest reading",
        ">best reading",
        "that reading",
        ">ours",
        "status",
    )
    rows: list[Sequence[object]] = [each.row() for each in published]
    if report.tables and report.tables[0].title == TITLE:
        rows = [*report.tables.pop(0).rows, *rows]
    report.tables.insert(0, Table(TITLE, columns, rows))
    report.checks += [each.check() for each in published]
