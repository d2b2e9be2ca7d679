"""``faultloop recover``"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def command(
    broken: Annotated[
        Path, typer.Argument(metavar="BROKEN.mcap", help="A log that was cut off (or its .part).")
    ],
    out: Annotated[Path, typer.Argument(metavar="OUT.mcap", help="The whole log to write.")],
    json: Annotated[bool, typer.Option("--json", help="One JSON object on standard output.")] = False,
) -> int:
    """Bring back what a run wrote before it was killed, as a whole log."""
    from faultloop.cli.output import print_json
    from faultloop.cli.terminal import say, warn
    from faultloop.io.recover import recover_log

    result = recover_log(broken, out)
    for text in result.warnings:
        warn(f"faultloop: warning: {result.source}: {text}")
    if json:
        print_json(vars(result))
    else:
        say(str(result))
    return 0
