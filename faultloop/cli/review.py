"""``faultloop review``"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def command(
    log: Annotated[Path, typer.Argument(metavar="LOG.mcap", help="The log of a run or a replay.")],
    html: Annotated[Path | None, typer.Option(metavar="F.html", help="An interactive page.")] = None,
    png: Annotated[Path | None, typer.Option(metavar="F.png", help="A picture.")] = None,
    rerun: Annotated[
        str | None, typer.Option(metavar="spawn|serve|F.rrd|URL", help="Show it in rerun.")
    ] = None,
    secondary: Annotated[
        bool, typer.Option("--secondary", help="The text in secondary values, by the settings' ratios.")
    ] = False,
    json: Annotated[bool, typer.Option("--json", help="One JSON object on standard output.")] = False,
) -> int:
    """What happened in a log: a summary, and plots where asked for."""
    from faultloop.cli.output import console, print_json, reading, serve, warn_of
    from faultloop.cli.terminal import say
    from faultloop.io.mcap_reader import open_log
    from faultloop.review.facts import as_json
    from faultloop.review.summary import summarize
    from faultloop.review.text import print_review

    opened = open_log(log)
    with reading(opened):
        summary = summarize(opened)
    told = summary
    if secondary:
        from faultloop.errors import InputError
        from faultloop.review.secondary import secondary as in_secondary

        if json:
            raise InputError("--json is in primary values, as the log is", key="--secondary")
        told = in_secondary(opened, summary)
    written = []
    if png is not None:
        from faultloop.review.plot import write_png

        with reading(opened):
            write_png(opened, summary, png)
        written.append(png)
    if html is not None:
        from faultloop.review.page import write_html

        with reading(opened):
            write_html(opened, summary, html)
        written.append(html)
    warn_of(opened)
    if json:
        print_json(as_json(summary) | {"written": [str(path) for path in written]})
    else:
        print_review(told, console(), secondary=secondary)
        for path in written:
            say(f"wrote {path}")
    if rerun is not None:
        from faultloop.review.rerun import show

        with reading(opened):
            stream = show(opened, summary, rerun)
        serve(stream)
    return 0
