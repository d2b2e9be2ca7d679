"""``faultloop replay``"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def command(
    record: Annotated[Path, typer.Argument(metavar="RECORD", help="COMTRADE .cfg or .cff, or a log .mcap.")],
    settings: Annotated[Path, typer.Option(metavar="RELAY.toml", help="The relay's settings.")],
    map_: Annotated[
        str | None,
        typer.Option(
            "--map",
            metavar="va=..,vb=..",
            help="Channels by name or by place (from 0) in the analog list, with a factor where needed: "
            "va=5*1.4142,vb=6*1.4142; of a log: relay=NAME.",
        ),
    ] = None,
    log: Annotated[
        Path | None, typer.Option(metavar="F.mcap", help="The log to write; default logs/RECORD-replay.mcap.")
    ] = None,
    rerun: Annotated[
        str | None, typer.Option(metavar="spawn|serve|F.rrd|URL", help="Stream to a rerun viewer or file.")
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="One JSON object on standard output.")] = False,
) -> int:
    """Play a recorded fault into a relay, as a test set does."""
    from faultloop.cli.output import announce_compilation, print_json, serve
    from faultloop.cli.report import print_replay
    from faultloop.loop.replay import replay

    announce_compilation()
    path = log if log is not None else Path("logs") / f"{record.stem}-replay.mcap"
    result = replay(record, settings, mapping=map_, log=path, rerun=rerun)
    if json:
        print_json(result.as_dict())
    else:
        print_replay(result)
    serve(result.rerun)
    return 0
