"""``faultloop campaign-report``"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from faultloop.study.campaign.results import Results
    from faultloop.study.report import Report


def command(
    file: Annotated[Path, typer.Argument(metavar="F.parquet", help="A campaign's file.")],
    old: Annotated[
        Path | None, typer.Argument(metavar="OLD.parquet", help="The same cases before: what changed.")
    ] = None,
    html: Annotated[
        Path | None, typer.Option(metavar="F.html", help="A page with plots, in one file.")
    ] = None,
    png: Annotated[Path | None, typer.Option(metavar="F.png", help="The plots as a picture.")] = None,
    map_: Annotated[
        str | None,
        typer.Option("--map", metavar="KEY,KEY", help="The two keys of the map of wrong answers."),
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="One JSON object on standard output.")] = False,
) -> int:
    """What a campaign came to: times, distributions, shots, wrong answers, and the worst cases."""
    from faultloop.cli.output import console, print_json, print_report
    from faultloop.io.output_file import check_target
    from faultloop.study.campaign.results import Results

    for path, suffix in ((html, ".html"), (png, ".png")):
        if path is not None:
            check_target(path, suffix)
    results = Results(file)
    over = None if map_ is None else _two(map_, results.keys)
    reports = _reports(results, old)
    written = _draw(results, reports, over, html, png)
    if json:
        told = {"file": str(file), "cases": len(results), "reports": [r.as_dict() for r in reports]}
        print_json(told | {"written": written})
    else:
        for report in reports:
            print_report(report)
        for path in written:
            console().print(f"wrote {path}")
    return 0


def _draw(
    results: Results, reports: list[Report], over: tuple[str, str] | None, html: Path | None, png: Path | None
) -> list[str]:
    """The page and the picture; their paths."""
    if html is None and png is None:
        return []
    from faultloop.study.campaign.figures import diagrams
    from faultloop.study.diagram import write_png
    from faultloop.study.report import Report, write_html

    figures = Report("figures", "In figures", diagrams=diagrams(results, over))
    if html is not None:
        write_html([*reports[:-2], figures, *reports[-2:]], html)  # after what changed, if that was asked
    if png is not None:
        write_png(results.name, figures.diagrams, png)
    return [str(path) for path in (html, png) if path is not None]


def _reports(results: Results, old: Path | None) -> list[Report]:
    from faultloop.study.campaign.report import changes, report_of, setup_of, worst_of
    from faultloop.study.campaign.results import Results

    changed = [] if old is None else [changes(results, Results(old))]
    return [report_of(results), *changed, worst_of(results), setup_of(results)]


def _two(text: str, keys: tuple[str, ...]) -> tuple[str, str]:
    from faultloop.errors import InputError, nearest

    names = [name.strip() for name in text.split(",")]
    if len(names) != 2:
        raise InputError(f"'{text}' is not KEY,KEY", key="--map")
    for name in names:
        if name not in keys:
            raise InputError(f"'{name}' was not varied; {nearest(name, keys)}", key="--map")
    return names[0], names[1]
