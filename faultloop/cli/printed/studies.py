"""What suite and the commands of campaigns print with ``--json``."""

from __future__ import annotations

from typing_extensions import TypedDict

from faultloop.cli.printed.runs import Run
from faultloop.cli.printed.told import Cell, told, told_with


@told_with(Run)
class CampaignCase(Run):
    """`faultloop campaign-case --json`: the run, and the campaign's word on it."""

    case: int
    """Its number."""
    values: dict[str, Cell]
    """What was varied, by key."""
    differences: list[str]
    """`column: there, here` of what came out otherwise."""
    row: dict[str, Cell]
    """The campaign's row of it, by column."""


@told
class Table(TypedDict):
    """A table of a report."""

    title: str
    """Above it."""
    columns: list[str]
    """Their names."""
    rows: list[list[Cell]]
    """Their cells; null where there is no number."""
    note: str
    """Under it."""


@told
class FigureCheck(TypedDict):
    """A figure against its limit."""

    what: str
    """The figure."""
    value: float | None
    """What it is; null is never held."""
    limit: float
    """What it is held against."""
    unit: str
    """Of both."""
    at_least: bool
    """The limit is the least; false: the greatest."""
    bound: float | None
    """The best that anything could do, where that is known."""
    because: str
    """What shows the bound."""
    cases: int | None
    """How many it is over, where they are counted; over none it is not asked."""
    margin: float | None
    """How far on the right side; negative where missed."""
    held: bool
    """Whether it is."""
    status: str
    """The same in words: held, MISSED, not asked (there were no cases), or published and not reached."""


@told
class Report(TypedDict):
    """A report, of a part of a suite or of a campaign."""

    name: str
    """In short."""
    title: str
    """Above it."""
    held: bool
    """Whether no limit was missed that could be held."""
    failed: str | None
    """Why it could not be made."""
    text: list[str]
    """Paragraphs."""
    tables: list[Table]
    """Below them."""
    checks: list[FigureCheck]
    """Figures against limits."""


@told
class Suite(TypedDict):
    """`faultloop suite --json`."""

    suite: str
    """Which."""
    held: bool
    """Whether all of its reports are."""
    reports: list[Report]
    """One for each part."""


@told
class CampaignReport(TypedDict):
    """`faultloop campaign-report --json`."""

    file: str
    """The campaign's file."""
    cases: int
    """How many are in it."""
    reports: list[Report]
    """What they came to, what changed where that was asked, the worst, the setup."""
    written: list[str]
    """Pages and pictures."""
