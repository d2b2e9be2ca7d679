"""What commands print: tables for people, one JSON object for programs."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from typing import TYPE_CHECKING, Any

from rich.console import Console, ConsoleOptions, Group, RenderableType
from rich.progress import Progress
from rich.segment import Segment
from rich.table import Table
from rich.text import Text

from faultloop.cli.terminal import safe, warn

if TYPE_CHECKING:
    from faultloop.io.mcap_reader import Log
    from faultloop.io.rerun_sink import RerunSink
    from faultloop.study.report import Report


class _SafeConsole(Console):
    """A console whose texts are safe; its own control sequences are not text."""

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        for segment in super().render(renderable, options):
            yield segment if segment.control else segment._replace(text=safe(segment.text))


WIDTH = 5000  # wider than any table


def console() -> Console:
    """Standard output, never narrower than a table: a terminal that is wraps the line, and nothing is cut."""
    return _SafeConsole(highlight=False, markup=False, width=WIDTH)


def screen() -> Console:
    """Standard output as wide as the terminal is, for what fills it."""
    # No markup: a name in a scenario may hold brackets.
    return _SafeConsole(highlight=False, markup=False)


def table(title: str, columns: Sequence[str], rows: Iterable[Sequence[object]]) -> Group:
    """A plain table; columns that start with ``>`` are right-aligned."""
    out = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="dim")
    for column in columns:
        out.add_column(column.removeprefix(">"), justify="right" if column.startswith(">") else "left")
    for row in rows:
        out.add_row(*[cell if isinstance(cell, Text) else Text(safe(str(cell))) for cell in row])
    return Group(Text(title, style="bold"), out)


def print_report(report: Report) -> None:
    """A report's texts and tables."""
    from faultloop.study.report import cell, check_table

    out = console()
    out.print(report.title, style="bold")
    if report.failed:
        out.print(f"not made: {report.failed}", style="red")
    for line in report.text:
        out.print(line)
    for shown in [*report.tables, *([check_table(report)] if report.checks else [])]:
        out.print()
        out.print(table(shown.title, shown.columns, [[cell(v) for v in row] for row in shown.rows]))
        if shown.note:
            out.print(shown.note, style="dim")
    out.print()


@contextmanager
def progress_bar(what: str) -> Iterator[Callable[[float], None] | None]:
    """A bar on standard error, fed with the part done; None where that is no terminal."""
    err = _SafeConsole(stderr=True)
    if not err.is_terminal:
        yield None
        return
    with Progress(console=err, transient=True) as bar:
        task = bar.add_task(what, total=1.0)
        yield lambda part: bar.update(task, completed=part)


@contextmanager
def reading(*logs: Log) -> Iterator[None]:
    """A bar while logs are read, for each pass over one anew; nothing where standard error is no terminal."""
    with progress_bar("reading") as progress:
        for log in logs:
            log.progress = progress
        try:
            yield
        finally:
            for log in logs:
                log.progress = None


def serve(stream: RerunSink | None) -> None:
    """Keep a stream that viewers connect to alive until Ctrl-C."""
    if stream is not None and stream.url is not None:
        warn(f"serving at {stream.url}: connect with `rerun {stream.url}`; Ctrl-C ends it")
        stream.wait()


def warn_of(*logs: Log) -> list[str]:
    """Says on standard error what is damaged in logs; returns it, for ``--json``."""
    told = [f"{log.path}: {text}" for log in logs for text in log.warnings]
    for text in dict.fromkeys(told):
        warn(f"faultloop: warning: {text}")
    return told


@cache
def announce_compilation() -> None:
    """Say why a run takes longer when something has to be compiled, as that begins; once in a process."""
    from faultloop.jit import cache_note, on_first_compilation

    if note := cache_note():
        warn(f"faultloop: {note}")
    on_first_compilation(lambda: warn("compiling what this machine has not run before: one to three minutes"))


def print_json(data: Any) -> None:
    """One JSON object and a newline; NaN and infinity become null, as JSON has neither."""
    json.dump(_plain(data), sys.stdout, indent=2, allow_nan=False)
    sys.stdout.write("\n")


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    if hasattr(value, "item"):  # a NumPy scalar: its bool is no bool, and would become the text "True"
        value = value.item()
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, (str, int, bool)) or value is None:
        return value
    return str(value)
