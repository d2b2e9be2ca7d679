"""``faultloop replay``"""

from __future__ import annotations

import math
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
            "va=5*1.4142,vb=6*1.4142; 52a=NAME, 52b=NAME for the breaker's position; of a log: relay=NAME.",
        ),
    ] = None,
    unit: Annotated[
        list[str] | None,
        typer.Option(
            metavar="va=kV", help="A unit in place of the record's own; v and i stand for all three."
        ),
    ] = None,
    scale: Annotated[
        list[str] | None,
        typer.Option(metavar="va=2200", help="Factor to primary in place of what the record says."),
    ] = None,
    ct_ratio: Annotated[float | None, typer.Option(metavar="R", help="Of all currents, as 240.")] = None,
    vt_ratio: Annotated[float | None, typer.Option(metavar="R", help="Of all voltages, as 1100.")] = None,
    from_: Annotated[
        float, typer.Option("--from", metavar="S", help="Play from here, in seconds from the record's start.")
    ] = 0.0,
    to: Annotated[float | None, typer.Option("--to", metavar="S", help="Play to here, in seconds.")] = None,
    log: Annotated[
        Path | None, typer.Option(metavar="F.mcap", help="The log to write; default logs/RECORD-replay.mcap.")
    ] = None,
    rerun: Annotated[
        str | None, typer.Option(metavar="spawn|serve|F.rrd|URL", help="Stream to a rerun viewer or file.")
    ] = None,
    no_user_code: Annotated[
        bool, typer.Option("--no-user-code", help="Refuse settings that name code of the user's own.")
    ] = False,
    compress: Annotated[bool, typer.Option("--compress", help="Compress the log (zstd).")] = False,
    json: Annotated[bool, typer.Option("--json", help="One JSON object on standard output.")] = False,
) -> int:
    """Play a recorded fault into a relay, as a test set does."""
    from faultloop.api import replay
    from faultloop.cli.output import announce_compilation, print_json, serve
    from faultloop.cli.report import print_replay
    from faultloop.io.comtrade.mapping import numbers_of, parse_overrides

    units = parse_overrides(unit or (), "--unit")
    scales = numbers_of(parse_overrides(scale or (), "--scale"), "--scale")
    announce_compilation()
    path = log if log is not None else Path("logs") / f"{record.stem}-replay.mcap"
    result = replay(
        record,
        settings,
        mapping=map_,
        unit=units,
        scale=scales,
        ct_ratio=ct_ratio,
        vt_ratio=vt_ratio,
        from_s=from_,
        to_s=math.inf if to is None else to,
        log=path,
        rerun=rerun,
        user_code=not no_user_code,
        compress=compress,
    )
    if json:
        print_json(result.as_dict())
    else:
        print_replay(result)
    if result.interrupted:
        return 130
    serve(result.rerun)
    return 0
