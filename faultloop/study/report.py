"""What a suite ends with: tables, checks against limits, figures; as text, one JSON object, or a page.

A limit is held, missed, not asked for where there were no cases (``--quick`` has few), or one that nobody
could hold: a published figure beyond a bound that is stated with its reason.  Only what is missed makes a
suite fail.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import Any

from faultloop.io.output_file import write_aside
from faultloop.study.diagram import Diagram
from faultloop.study.plotly_config import CONFIG


@dataclass(frozen=True)
class Table:
    """Rows under a title; a column that starts with ``>`` is right-aligned.  Numbers keep four digits."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[object]]
    note: str = ""


@dataclass(frozen=True)
class Check:
    """A figure against its limit: held if ``value <= limit`` (``at_least``: if ``value >= limit``).

    Attributes
    ----------
    bound : the best that anything could do, where that is known.  A limit beyond it is no failure.
    because : what shows the bound, for the reader.
    cases : how many it is over, where they are counted.  Over none it is neither held nor missed.
    """

    what: str
    value: float
    limit: float
    unit: str = ""
    at_least: bool = False
    bound: float | None = None
    because: str = ""
    cases: int | None = None

    @classmethod
    def none_of(cls, what: str, count: float, cases: int) -> Check:
        """None of so many cases."""
        return cls(f"{what}, of {cases}", float(count), 0.0, cases=cases)

    @property
    def margin(self) -> float:
        """How far on the right side, in the value's unit; negative where missed."""
        return float(self.value - self.limit if self.at_least else self.limit - self.value)

    @property
    def asked(self) -> bool:
        """There were cases."""
        return self.cases != 0

    @property
    def held(self) -> bool:
        """A NaN never holds, nor what is over no cases."""
        return self.asked and self.margin >= 0

    @property
    def missed(self) -> bool:
        """What makes a suite fail."""
        return self.asked and not (self.held or self.out_of_reach)

    @property
    def out_of_reach(self) -> bool:
        """Not held, and the limit lies beyond the bound."""
        if self.held or not self.asked or self.bound is None or math.isnan(self.value):
            return False
        return self.bound < self.limit if self.at_least else self.bound > self.limit

    @property
    def verdict(self) -> str:
        """``held``, ``MISSED``, ``not asked``, or ``published, not reached: bound`` with the bound."""
        if self.held:
            return "held"
        if not self.asked:
            return "not asked"
        if not self.out_of_reach:
            return "MISSED"
        return f"published, not reached: bound {cell(self.bound)}{f' {self.unit}'.rstrip()}"

    @property
    def status(self) -> str:
        """The verdict, and what shows the bound where there is one."""
        return f"{self.verdict} ({self.because})" if self.out_of_reach else self.verdict


@dataclass
class Report:
    """The result of one suite, or of one part of it.

    ``figures`` are plotly figures with their titles, drawn on the page only; ``diagrams`` are drawn on the
    page and in the picture.  ``failed`` is why the report could not be made, in one line; what is in it by
    then stands.
    """

    name: str
    title: str
    text: list[str] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)
    checks: list[Check] = field(default_factory=list)
    figures: list[tuple[str, Any]] = field(default_factory=list)
    diagrams: list[Diagram] = field(default_factory=list)
    failed: str = ""

    @property
    def held(self) -> bool:
        """No limit was missed but those that nobody could hold."""
        return not self.failed and not any(check.missed for check in self.checks)

    def as_dict(self) -> dict[str, Any]:
        """For ``--json``."""
        return {
            "name": self.name,
            "title": self.title,
            "held": self.held,
            "failed": self.failed or None,
            "text": self.text,
            "tables": [
                {
                    "title": t.title,
                    "columns": [c.removeprefix(">") for c in t.columns],
                    "rows": [list(row) for row in t.rows],
                    "note": t.note,
                }
                for t in self.tables
            ],
            "checks": [
                vars(c) | {"margin": c.margin, "held": c.held, "status": c.status} for c in self.checks
            ],
        }


def cell(value: object) -> str:
    """A value as a table shows it."""
    if isinstance(value, bool) or not isinstance(value, float):
        return str(value)
    return "-" if math.isnan(value) else f"{value:.0f}" if 1e4 <= abs(value) < 1e7 else f"{value:.4g}"


def check_table(report: Report) -> Table:
    """The checks as a table."""
    rows = []
    for c in report.checks:
        limit = f"{'>=' if c.at_least else '<='} {cell(c.limit)}"
        rows.append((c.verdict, c.what, cell(c.value), limit, cell(c.margin), c.unit))
    beyond = [f"{c.what}: {c.status}." for c in report.checks if c.out_of_reach]
    columns = ("", "what", ">value", ">limit", ">margin", "unit")
    return Table("Checks", columns, rows, " ".join(beyond))


def write_html(reports: Sequence[Report], path: Path) -> Path:
    """`write_page` to a path that ends in .html.  Raises InputError where it cannot be written."""
    with write_aside(path, ".html") as aside:
        write_page(reports, aside)
    return path


def write_page(reports: Sequence[Report], path: Path) -> None:
    """All reports as one page that needs no network; plotly is in it once."""
    parts = []
    plotly: bool | str = True
    for report in reports:
        parts.append(f"<h1>{escape(report.title)}</h1>")
        if report.failed:
            parts.append(f"<p class=missed>not made: {escape(report.failed)}</p>")
        parts += [f"<p>{escape(line)}</p>" for line in report.text]
        tables = [*report.tables, *([check_table(report)] if report.checks else [])]
        parts += [_html_table(table) for table in tables]
        drawn = [(one.title, one.note, one.wide, one.plotly()) for one in report.diagrams]
        drawn += [(title, "", True, figure) for title, figure in report.figures]
        parts.append("<div class=g>")
        for title, note, wide, figure in drawn:
            said = f"<p class=note>{escape(note)}</p>" if note else ""
            _for_page(figure)
            plot = figure.to_html(full_html=False, include_plotlyjs=plotly, config=CONFIG)
            parts.append(
                f"<section{' class=w' if wide else ''}><h2>{escape(title)}</h2>{said}{plot}</section>"
            )
            plotly = False
        parts.append("</div>")
    head = "<!doctype html><meta charset='utf-8'><meta name='viewport' content='width=device-width'>"
    head += f"<title>faultloop</title><style>{STYLE}</style>"
    path.write_text(head + "".join(parts), encoding="utf-8")


STYLE = (
    "body{font:15px sans-serif;max-width:1200px;margin:2em auto;padding:0 1em}"
    "div.t{overflow-x:auto}"  # a table that is wider than a telephone scrolls by itself, and not the page
    "table{border-collapse:collapse;margin:.5em 0 1em;width:max-content;max-width:max(100%,50em)}"
    "td,th{padding:.2em .9em .2em 0;text-align:left;border-bottom:1px solid #ddd;vertical-align:top}"
    "th{vertical-align:bottom}td:first-child{min-width:8em}td.r{white-space:nowrap;min-width:0}"
    "td.v,td.missed{min-width:0}"
    # diagrams side by side where there is room
    "@media(min-width:1100px){div.g{display:grid;gap:0 2em;grid-template-columns:repeat(2,minmax(0,1fr))}}"
    "section.w{grid-column:1/-1}"
    "p.note{color:#666;font-size:13px;margin:.2em 0}h1,h2{overflow-wrap:anywhere}"
    "td.c{white-space:nowrap;font:13px monospace}"  # a command, to be copied
    "td.r,th.r{text-align:right}td.missed,p.missed{color:#b00;font-weight:bold}"
    # the plots' own colours are those of a white page: their lightness is turned, not their hue
    "@media(prefers-color-scheme:dark){body{background:#141414;color:#d8dce2}td,th{border-color:#363b43}"
    "p.note{color:#9aa3ad}td.missed,p.missed{color:#ff7b72}a{color:#7ab7ff}"
    ".js-plotly-plot{filter:invert(.92) hue-rotate(180deg)}}"
)


MANY = 6
"""Entries of a legend that take height from the plot."""


def _for_page(figure: Any) -> None:
    """The legend under the plot, unless the figure has a place of its own: beside it on a telephone it would
    leave no room for the plot.  The margin at the top is that of plotly's buttons: the title stands above."""
    figure.update_layout(margin={"t": 60})
    if figure.layout.legend.orientation is None:
        height = figure.layout.height or 450
        entries = sum(trace.showlegend is not False for trace in figure.data)
        legend = min(10 * entries, height / 2) if entries > MANY else 0  # some two side by side
        below = -65 / max(height - 115 - legend, 100)  # of the plot's own height: under the axis' title
        figure.update_layout(legend={"orientation": "h", "yanchor": "top", "y": below, "x": 0})


_CLASSES = {"MISSED": " class=missed", "held": " class=v", "faultloop": " class=c"}


def _html_table(table: Table) -> str:
    right = [column.startswith(">") for column in table.columns]
    head = "".join(
        f"<th{' class=r' if r else ''}>{escape(c.removeprefix('>'))}</th>"
        for c, r in zip(table.columns, right, strict=True)
    )
    body = ""
    for row in table.rows:
        cells = []
        for value, r in zip(row, right, strict=True):
            text = cell(value)
            kind = " class=r" if r else _CLASSES.get(text.partition(" ")[0], "")
            cells.append(f"<td{kind}>{escape(text)}</td>")
        body += f"<tr>{''.join(cells)}</tr>"
    note = f"<p>{escape(table.note)}</p>" if table.note else ""
    return f"<h2>{escape(table.title)}</h2><div class=t><table><tr>{head}</tr>{body}</table></div>{note}"
