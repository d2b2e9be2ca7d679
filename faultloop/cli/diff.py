"""``faultloop diff``"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer


def command(
    a: Annotated[Path, typer.Argument(metavar="A.mcap", help="One log.")],
    b: Annotated[
        Path | None,
        typer.Argument(metavar="B.mcap", help="The other; none with --again.", show_default=False),
    ] = None,
    again: Annotated[
        bool, typer.Option("--again", help="Compare with a new run of the log's own scenario and settings.")
    ] = False,
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
    from tempfile import TemporaryDirectory

    from faultloop.cli.output import print_json, reading, warn_of
    from faultloop.errors import InputError
    from faultloop.io.diff import diff_logs
    from faultloop.io.mcap_reader import open_log

    if (b is None) != again:
        raise InputError("give two logs, or one and --again", key="--again")
    one, tolerances = open_log(a), _tolerances(tolerance or [])
    with TemporaryDirectory() as folder:
        other = open_log(_run_again(one, Path(folder)) if b is None else b)
        with reading(one):
            result = diff_logs(one, other, ignore or [], tolerances)
        if again:  # made from what the log tells of itself, it holds no files of settings
            result.information = [x for x in result.information if not x.startswith("attachment ")]
        warnings = warn_of(one, other)
        del other
    if json:
        print_json(
            {
                "equal": result.equal,
                "first": vars(result.first) if result.first else None,
                "fields": [vars(field) for field in result.fields],
                "topics": [{"topic": topic, "only_in": side} for topic, side in result.topics],
                "information": result.information,
                "warnings": warnings,
            }
        )
    else:
        _print(result)
    return 0 if result.equal else 3


def _run_again(log: Any, folder: Path) -> Path:
    from faultloop.cli.output import announce_compilation
    from faultloop.loop.again import run_again

    announce_compilation()
    run_again(log, folder / "again.mcap")
    return folder / "again.mcap"


def _tolerances(items: list[str]) -> dict[str, float]:
    from faultloop.errors import InputError

    found = {}
    for item in items:
        field, equals, text = item.rpartition("=")
        try:
            found[field] = float(text)
        except ValueError:
            equals = ""
        if not equals or not field:
            raise InputError(f"'{item}' is not FIELD=ABS, as in va=0.1", key="--tolerance")
    return found


def _print(result: Any) -> None:
    from faultloop.cli.output import console, table

    out = console()
    if result.equal:
        out.print("no difference")
    if result.first is not None:
        first = result.first
        out.print(f"first difference: {first.name} at {first.t_ns / 1e9:.9f} s: {first.a} and {first.b}")
    for topic, side in result.topics:
        out.print(f"{topic} is only in {'the first' if side == 'a' else 'the second'} log")
    if result.fields:
        rows = [
            (
                f.name,
                f"{f.count} of {f.compared}",
                f"{f.t_ns / 1e9:.9f}",
                "" if f.largest is None else f"{f.largest:.6g}",
            )
            for f in result.fields
        ]
        out.print(table("\nDiffering fields", ["field", ">messages", ">first at s", ">largest"], rows))
    for line in result.information:
        out.print(line, style="dim", markup=False)
