"""``faultloop layout``"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def command(
    log: Annotated[Path, typer.Argument(metavar="LOG.mcap", help="The log of a run or a replay.")],
    foxglove: Annotated[Path | None, typer.Option(metavar="F.json", help="A layout for Foxglove.")] = None,
    plotjuggler: Annotated[
        Path | None, typer.Option(metavar="F.xml", help="A layout for PlotJuggler 4.")
    ] = None,
    view: Annotated[
        Path | None,
        typer.Option(metavar="V.mcap", help="Magnitudes, degrees and booleans; open it beside the log."),
    ] = None,
) -> int:
    """Layouts for viewers: waves, magnitudes and angles, elements, R-X plane, events of this log."""
    import json
    import xml.etree.ElementTree as ET

    from faultloop.cli.output import reading, warn_of
    from faultloop.cli.terminal import say
    from faultloop.errors import InputError
    from faultloop.io import layouts
    from faultloop.io.mcap_reader import open_log
    from faultloop.io.output_file import write_aside
    from faultloop.io.view import write_view

    if foxglove is None and plotjuggler is None and view is None:
        raise InputError("give --foxglove F.json, --plotjuggler F.xml or --view V.mcap", key="layout")
    opened = open_log(log)
    beside = view or log.with_suffix(".view.mcap")
    with reading(opened):
        written = [write_view(opened, beside)]
    if foxglove is not None:
        with write_aside(foxglove, ".json") as aside:
            aside.write_text(json.dumps(layouts.foxglove(opened), indent=1) + "\n", encoding="utf-8")
        written.append(foxglove)
    if plotjuggler is not None:
        tree = layouts.plotjuggler(opened, [str(log.resolve()), str(beside.resolve())])
        ET.indent(tree)
        with write_aside(plotjuggler, ".xml") as aside:
            ET.ElementTree(tree).write(aside, encoding="utf-8", xml_declaration=True)
        written.append(plotjuggler)
    warn_of(opened)
    for path in written:
        say(f"wrote {path}")
    return 0
