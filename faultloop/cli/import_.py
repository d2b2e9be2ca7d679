"""``faultloop import``"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def command(
    settings: Annotated[Path, typer.Argument(metavar="SETTINGS", help="RIO, XRIO or SEL text.")],
    out: Annotated[
        Path | None, typer.Option(metavar="F.toml", help="Where it is written; else it is shown.")
    ] = None,
    z1: Annotated[str | None, typer.Option(metavar="R,X", help="The line's Z1, in the file's ohms.")] = None,
    z0: Annotated[str | None, typer.Option(metavar="R,X", help="Its Z0.")] = None,
    ct_ratio: Annotated[float | None, typer.Option(min=1e-9, help="Primary over secondary.")] = None,
    vt_ratio: Annotated[float | None, typer.Option(min=1e-9, help="The same of the voltages.")] = None,
    frequency: Annotated[float | None, typer.Option(help="50 or 60.")] = None,
    png: Annotated[
        Path | None, typer.Option(metavar="F.png", help="A picture of the zones on the R-X plane.")
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="One JSON object on standard output.")] = False,
) -> int:
    """Relay settings of another maker's tool as faultloop's, and what of them was not understood."""
    from faultloop.cli.output import print_json
    from faultloop.cli.terminal import say
    from faultloop.errors import InputError
    from faultloop.interchange import read_settings
    from faultloop.interchange.model import Given
    from faultloop.interchange.toml import settings_dict, settings_text
    from faultloop.io.output_file import write_aside
    from faultloop.relay import RelaySettings

    def pair(text: str | None, key: str) -> complex | None:
        if text is None:
            return None
        try:
            r, x = (float(part) for part in text.split(","))
        except ValueError:
            raise InputError(f"'{text}' should be R,X as in 3.2,31.5", key=key) from None
        return complex(r, x)

    taken = read_settings(settings, Given(pair(z1, "--z1"), pair(z0, "--z0"), ct_ratio, vt_ratio, frequency))
    found = settings_dict(taken)
    try:
        made = RelaySettings.from_dict(found)
    except InputError as error:
        raise InputError(f"its zones are no settings of faultloop: {error}", file=settings) from error
    text = settings_text(taken, settings.name)
    if out is not None:
        with write_aside(out, ".toml") as aside:
            aside.write_text(text, encoding="utf-8")
    if png is not None:
        from faultloop.review.zones import Outline, write_zones

        drawn = [Outline(zone.name, zone.loops, zone.shape) for zone in taken.zones if zone.shape]
        write_zones(made, png, title=f"{settings.name}: {taken.kind}", outlines=drawn)
    if json:
        told = {"kind": taken.kind, "settings": found, "not_taken": taken.left, "look_at": taken.noted}
        print_json(told | {"written": None if out is None else str(out)})
        return 0
    if out is None:
        say(text.rstrip("\n"))
        if png is not None:
            say(f"# wrote {png}")
        return 0
    say(f"{settings.name}: {taken.kind}, {len(taken.zones)} zones taken")
    for line in taken.noted:
        say(f"look at: {line}")
    for line in taken.left:
        say(f"not taken: {line}")
    for path in (out, png):
        if path is not None:
            say(f"wrote {path}")
    return 0
