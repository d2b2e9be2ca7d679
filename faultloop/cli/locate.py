"""``faultloop locate``"""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer


def command(
    one: Annotated[Path, typer.Argument(metavar="A.mcap", help="The log of one end.")],
    other: Annotated[Path, typer.Argument(metavar="B.mcap", help="That of the other; may be the same.")],
    relay_a: Annotated[str | None, typer.Option(metavar="NAME", help="Relay of the first end.")] = None,
    relay_b: Annotated[str | None, typer.Option(metavar="NAME", help="Relay of the other end.")] = None,
    synchronised: Annotated[
        bool | None,
        typer.Option(
            "--synchronised/--unsynchronised", help="Whether both have one clock; found out if left out."
        ),
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="One JSON object on standard output.")] = False,
) -> int:
    """Where the fault is, from both ends of its line."""
    from faultloop.cli.output import print_json, reading, warn_of
    from faultloop.cli.terminal import say
    from faultloop.errors import InputError
    from faultloop.io.mcap_reader import open_log
    from faultloop.review.locate import locate

    for path in (one, other):
        if path.suffix.lower() in (".cfg", ".cff", ".dat"):
            what = "is a COMTRADE record: play it into a relay (faultloop replay --log F.mcap), give its log"
            raise InputError(what, file=path)
    logs = open_log(one), open_log(other)
    with reading(*logs):
        found = locate(*logs, (relay_a, relay_b), synchronised)
    warn_of(*logs)
    if json:
        print_json(asdict(found))
        return 0
    where = "" if found.km is None else f", {found.km:.2f} km"
    clock = "one clock" if found.synchronised else "without a common clock"
    say(f"fault at {100 * found.part:.2f} % of the line{where} from the first end")
    say(f"by the {found.sequence} sequence, {clock}; the ends differ by {100 * found.mismatch:.2f} % there")
    return 0
