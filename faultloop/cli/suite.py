"""``faultloop suite``"""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from typing import Annotated

import typer


def command(
    name: Annotated[
        str,
        typer.Argument(
            metavar="bus|differential|distance|estimators|functions|schemes|seeds|synchrophasor",
            help="Which suite.",
        ),
    ],
    parts: Annotated[
        list[str] | None, typer.Argument(metavar="[PART]...", help="Only these parts of it.")
    ] = None,
    html: Annotated[Path | None, typer.Option(metavar="F.html", help="A page with plots.")] = None,
    png: Annotated[Path | None, typer.Option(metavar="F.png", help="Its diagrams as one picture.")] = None,
    json: Annotated[bool, typer.Option("--json", help="One JSON object on standard output.")] = False,
    quick: Annotated[bool, typer.Option("--quick", help="Fewer cases and seeds.")] = False,
    workers: Annotated[
        int | None, typer.Option(metavar="N", min=1, help="Processes, of the distance suite; 1 by default.")
    ] = None,
    keep: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER", help="Of the distance suite: its campaigns, gone on with if they are there."
        ),
    ] = None,
) -> int:
    """Run a study and hold its figures against their limits.

    Exit status 3 where one is missed.  A published figure beyond a bound that is stated is none.
    """
    from faultloop.cli.output import announce_compilation, console, print_json, print_report, progress_bar
    from faultloop.io.output_file import write_aside
    from faultloop.study.diagram import write_png
    from faultloop.study.report import write_page
    from faultloop.study.suites import run_suite

    announce_compilation()
    with write_aside(html, ".html") if html is not None else nullcontext() as page:
        with progress_bar(f"suite {name}") as progress:
            reports = run_suite(name, parts or (), quick=quick, progress=progress, workers=workers, keep=keep)
        if page is not None:
            write_page(reports, page)
    if png is not None:
        write_png(f"faultloop suite {name}", [d for report in reports for d in report.diagrams], png)
    if json:
        print_json(
            {"suite": name, "held": all(r.held for r in reports), "reports": [r.as_dict() for r in reports]}
        )
    else:
        for report in reports:
            print_report(report)
        for path in (html, png):
            if path is not None:
                console().print(f"wrote {path}")
    return 0 if all(report.held for report in reports) else 3
