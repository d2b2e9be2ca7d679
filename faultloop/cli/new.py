"""``faultloop new``"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def command(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="To make.")] = Path("faultloop-start"),
) -> int:
    """Make a folder of scenarios, relay settings and examples to start from."""
    from faultloop.cli.starter import make_starter

    for path in make_starter(folder):
        typer.echo(str(path))
    typer.echo(f"try: faultloop run {folder / 'scenarios' / 'ag-zone1.toml'}")
    return 0
