"""``faultloop campaign-case``"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def command(
    file: Annotated[Path, typer.Argument(metavar="F.parquet", help="A campaign's file.")],
    case: Annotated[int, typer.Argument(metavar="N", help="Which of its cases, from 0.")],
    log: Annotated[
        Path | None,
        typer.Option(metavar="F.mcap", help="The log; logs/NAME-N.mcap where not given."),
    ] = None,
    rerun: Annotated[
        str | None, typer.Option(metavar="spawn|serve|F.rrd|URL", help="Stream to a rerun viewer or file.")
    ] = None,
    keys: Annotated[
        Path | None,
        typer.Option(metavar="KEYS.toml", help="The key file, of a case whose bus is authenticated."),
    ] = None,
    no_user_code: Annotated[
        bool, typer.Option("--no-user-code", help="Refuse settings that name code of the user's own.")
    ] = False,
    json: Annotated[bool, typer.Option("--json", help="One JSON object on standard output.")] = False,
) -> int:
    """One case of a campaign again, alone, with everything logged; 3 where it comes out otherwise."""
    from faultloop.cli.output import announce_compilation, console, print_json, progress_bar, serve
    from faultloop.cli.report import print_result, result_as_dict
    from faultloop.study.campaign.again import run_again

    announce_compilation()
    path = log if log is not None else Path("logs") / f"{file.stem}-{case}.mcap"
    with progress_bar("simulating") as progress:
        again = run_again(
            file, case, log=path, rerun=rerun, keys=keys, user_code=not no_user_code, progress=progress
        )
    if json:
        told = {"case": case, "values": again.values, "differences": again.differences}
        print_json(told | {"row": again.row} | result_as_dict(again.result))
    else:
        out = console()
        out.print(f"case {case}: {', '.join(f'{key} = {value}' for key, value in again.values.items())}")
        print_result(again.result)
        out.print(f"verdict: {again.row['verdict']} {again.row['reason'] or ''}")
        for difference in again.differences:
            out.print(f"not as in the campaign: {difference}", style="red")
    if again.result.interrupted:
        return 130
    serve(again.result.rerun)
    return 3 if again.differences else 0
