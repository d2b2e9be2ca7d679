"""``faultloop campaign``"""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Annotated

import typer


def command(
    campaign: Annotated[Path, typer.Argument(metavar="CAMPAIGN.toml", help="What to run.")],
    out: Annotated[
        Path | None,
        typer.Option(metavar="F.parquet", help="A row per case; logs/NAME.parquet where not given."),
    ] = None,
    workers: Annotated[
        int | None, typer.Option(metavar="N", help="Processes; one per core where not given.")
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Of a dask.distributed cluster: tcp://HOST:8786.")
    ] = None,
    keep: Annotated[
        str | None,
        typer.Option(metavar="samples,phasors,loops", help="Keep each case's waves, in F.waves/."),
    ] = None,
    float64: Annotated[bool, typer.Option("--float64", help="Keep them in double precision.")] = False,
    no_user_code: Annotated[
        bool, typer.Option("--no-user-code", help="Refuse settings that name code of the user's own.")
    ] = False,
    json: Annotated[bool, typer.Option("--json", help="One JSON object on standard output.")] = False,
) -> int:
    """Run many cases of a scenario; each gets a verdict.  What is there of it already is not run again."""
    from faultloop.cli.campaign_progress import case_progress
    from faultloop.cli.output import announce_compilation, console, print_json
    from faultloop.errors import InputError
    from faultloop.study.campaign import Campaign

    if scheduler is not None and workers is not None:
        raise InputError("cannot stand with --scheduler, which has workers of its own", key="--workers")
    announce_compilation()
    path = out if out is not None else Path("logs") / f"{campaign.stem}.parquet"
    prepared = Campaign.load(campaign, user_code=not no_user_code)
    try:
        with case_progress(prepared.cases) as progress:
            summary = prepared.run(
                path,
                workers=_cores() if workers is None else workers,
                scheduler=scheduler,
                keep=[kind.strip() for kind in keep.split(",")] if keep is not None else (),
                float64=float64,
                progress=progress,
            )
    except KeyboardInterrupt:
        print(f"faultloop: stopped; the same command goes on from what is in {path}.parts", file=sys.stderr)
        return 130
    if json:
        print_json(vars(summary))
    else:
        out_ = console()
        out_.print(f"{summary.cases} cases, {summary.new} of them run now: {summary.right} right,", end=" ")
        out_.print(f"{summary.wrong} wrong, {summary.unjudged} unjudged, {summary.errors} failed")
        if summary.first_error is not None:
            out_.print(f"the first that failed: {summary.first_error}")
        out_.print(f"wrote {summary.out}")
    return 0


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
