"""``faultloop run``"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def command(
    scenario: Annotated[Path, typer.Argument(metavar="SCENARIO.toml", help="What to run.")],
    log: Annotated[
        Path | None, typer.Option(metavar="F.mcap", help="The log to write; logs/NAME.mcap where not given.")
    ] = None,
    rerun: Annotated[
        str | None, typer.Option(metavar="spawn|serve|F.rrd|URL", help="Stream to a rerun viewer or file.")
    ] = None,
    sink: Annotated[
        list[str] | None, typer.Option("--sink", metavar="NAME", help="Write to an installed package's sink.")
    ] = None,
    can: Annotated[
        str | None, typer.Option(metavar="INTERFACE:CHANNEL", help="The bus, as in socketcan:vcan0.")
    ] = None,
    realtime: Annotated[bool, typer.Option("--realtime", help="Run at the pace of the wall clock.")] = False,
    pace: Annotated[
        float | None, typer.Option(metavar="X", help="Simulated seconds in one second of wall time.")
    ] = None,
    without: Annotated[
        list[str] | None,
        typer.Option("--without", metavar="NAME", help="Leave this breaker to a device of your own."),
    ] = None,
    processes: Annotated[
        bool, typer.Option("--processes", help="Plant, relays and breakers as processes on a real bus.")
    ] = False,
    set_: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Override: fault.F1.at_pu=0.7.")
    ] = None,
    no_user_code: Annotated[
        bool, typer.Option("--no-user-code", help="Refuse settings that name code of the user's own.")
    ] = False,
    compress: Annotated[bool, typer.Option("--compress", help="Compress the log (zstd).")] = False,
    log_thread: Annotated[
        bool, typer.Option("--log-thread", help="Write the log in a thread of its own, on a second core.")
    ] = False,
    json: Annotated[bool, typer.Option("--json", help="One JSON object on standard output.")] = False,
) -> int:
    """Run a scenario closed-loop: faults, estimates, trips over CAN, breakers; everything in a log."""
    from faultloop.cli.output import announce_compilation, print_json, progress_bar, serve
    from faultloop.cli.report import print_result, result_as_dict
    from faultloop.errors import InputError
    from faultloop.loop.runner import Interrupted

    if realtime and pace is not None:
        raise InputError("give either --realtime (which is --pace 1) or --pace X", key="--pace")
    path = log if log is not None else Path("logs") / f"{scenario.stem}.mcap"
    announce_compilation()
    try:
        with progress_bar("running" if processes else "simulating") as progress:
            if processes:
                from faultloop.live.supervisor import run_processes

                if rerun is not None:
                    raise InputError(
                        "processes write a log: see it by `faultloop review --rerun`", key="--rerun"
                    )
                if compress:
                    raise InputError("processes write a log that is not compressed", key="--compress")
                if log_thread:
                    raise InputError("processes write their logs themselves", key="--log-thread")
                if sink:
                    raise InputError("processes write a log, and nothing else", key="--sink")
                result = run_processes(
                    scenario,
                    can=can,
                    pace=1.0 if pace is None else pace,
                    without=without or [],
                    log=path,
                    overrides=set_ or [],
                    user_code=not no_user_code,
                    progress=progress,
                )
            else:
                from faultloop.api import run

                result = run(
                    scenario,
                    log=path,
                    rerun=rerun,
                    overrides=set_ or [],
                    sinks=sink or [],
                    can=can,
                    pace=1.0 if realtime else pace,
                    without=without or [],
                    user_code=not no_user_code,
                    compress=compress,
                    log_thread=log_thread,
                    progress=progress,
                )
    except Interrupted as ended:
        result = ended.result
    if json:
        print_json(result_as_dict(result))
    else:
        print_result(result)
    if result.interrupted:
        return 130
    serve(result.rerun)
    return 0 if result.held and not result.died else 3
