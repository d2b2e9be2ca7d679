"""``faultloop diff``"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def command(
    a: Annotated[Path, typer.Argument(metavar="A.mcap", help="One log.")],
    b: Annotated[Path, typer.Argument(metavar="B.mcap", help="The other.")],
    ignore: Annotated[
        list[str] | None,
        typer.Option(metavar="FIELD", help="Leave a field out: rocof_hz_per_s, '/relay/*/phasors.*'."),
    ] = None,
    tolerance: Annotated[
        list[str] | None, typer.Option(metavar="FIELD=ABS", help="Absolute tolerance of a field: va=0.1.")
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="One JSON object on standard output.")] = False,
) -> int:
    """Compare two logs: the first differing field and time.  Exit status 3 where they differ."""
    from faultloop.cli.output import console, print_json, table
    from faultloop.errors import InputError
    from faultloop.io.diff import diff_logs

    tolerances = {}
    for item in tolerance or []:
        field, equals, text = item.rpartition("=")
        try:
            tolerances[field] = float(text)
        except ValueError:
            equals = ""
        if not equals or not field or not tolerances[field] >= 0:
            raise InputError(f"'{item}' is not FIELD=ABS with a number >= 0, as in va=0.1", key="--tolerance")
    result = diff_logs(a, b, ignore=ignore or [], tolerances=tolerances)
    if json:
        print_json(result.as_dict())
    else:
        out = console()
        out.print(str(result))
        if result.fields:
            rows = [
                (f.field, f.count, f"{f.first_t_ns / 1e9:.6f}", f"{f.largest:.6g}") for f in result.fields
            ]
            out.print(table("Differing fields", ["field", ">messages", ">first at s", ">largest"], rows))
    return 3 if result else 0
