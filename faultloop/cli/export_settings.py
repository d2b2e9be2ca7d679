"""``faultloop export-settings``"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def command(
    settings: Annotated[Path, typer.Argument(metavar="F.toml", help="Relay settings.")],
    rio: Annotated[Path, typer.Argument(metavar="F.rio", help="Where the zones go.")],
) -> int:
    """A relay's zones as RIO, for a test set."""
    from faultloop.cli.terminal import say
    from faultloop.errors import InputError
    from faultloop.interchange.rio_out import rio_text
    from faultloop.io.output_file import write_aside
    from faultloop.relay import load_settings

    loaded = load_settings(settings)
    if not loaded.pdis:
        raise InputError("has no distance zone", file=settings, key="pdis")
    with write_aside(rio, ".rio") as aside:
        aside.write_text(rio_text(loaded, settings.stem), encoding="utf-8")
    say(f"wrote {rio}")
    z1 = loaded.z1_ohm
    back = f"faultloop import {rio} --z1 {z1.real:.9g},{z1.imag:.9g}"
    say(f"RIO tells of the line its angle alone; to read it: {back}")
    return 0
