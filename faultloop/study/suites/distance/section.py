"""What the sections share: their interface, and the tables that most of them end with."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

import numpy as np

from faultloop.study.diagram import Curve
from faultloop.study.report import Report, Table
from faultloop.study.suites.distance.makers import Claim
from faultloop.study.suites.distance.rows import Rows, Times
from faultloop.study.suites.distance.sweep import Sweep

TIME_COLUMNS = (">cases", ">min ms", ">median ms", ">95 % ms", ">max ms", ">not operated")


class Section(Protocol):
    """A module of ``sections``: ``TITLE``, the cases, and what is made of their rows."""

    TITLE: str

    def sweeps(self, quick: bool) -> dict[str, Sweep]:
        """Cases by name, each of one network."""
        ...

    def fill(self, report: Report, rows: Mapping[str, Rows]) -> None:
        """Texts, tables, diagrams and checks of the rows of each sweep."""
        ...


def angles(count: int) -> list[float]:
    """Inception angles evenly over half a cycle; the other half is its mirror image."""
    return [180.0 * k / count for k in range(count)]


def time_cells(times: Times) -> list[str]:
    """For `TIME_COLUMNS`; a figure that a missed operation makes infinite is a dash."""
    own = [f"{value:.1f}" if np.isfinite(value) else "-" for value in times.figures]
    return [str(len(times.values)), *own, str(times.missed)]


def operated(rows: Rows, relay: str) -> str:
    """``n of m``."""
    return f"{int(rows.tripped(relay).sum())} of {len(rows)}"


def times_over(
    rows: Rows, relay: str, over: str, name: str, colour: int, since: str = "fault_ns"
) -> list[Curve]:
    """Median and greatest time over a column, and the band from least to greatest.

    Where a case did not operate the greatest is not drawn."""
    x = rows.values(over)
    each = [rows.only(**{over: value}).times(relay, since).figures for value in x]
    low, middle, _, high = (np.where(np.isfinite(f), f, np.nan) for f in np.array(each).T)
    return [
        Curve(f"{name}: min to max", x, low, "band", colour, upper=high, in_legend=False),
        Curve(f"{name}: median", x, middle, colour=colour),
        Curve(f"{name}: maximum", x, high, colour=colour, dash="dot", in_legend=False),
    ]


def claims_table(title: str, claims: Sequence[tuple[Claim, str, str]], note: str = "") -> Table:
    """Makers' figures, each with ours and what ours is of."""
    rows = [(c.relay, c.what, c.condition, c.figure, ours, of) for c, ours, of in claims]
    return Table(
        title, ("relay", "figure", "condition", ">maker's", ">faultloop's", "faultloop's is of"), rows, note
    )
