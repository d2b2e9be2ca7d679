"""``faultloop node``"""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer


class Role(StrEnum):
    """What a process can be."""

    plant = "plant"
    relay = "relay"
    breaker = "breaker"


def command(
    role: Annotated[Role, typer.Argument(help="What this process is.")],
    scenario: Annotated[Path, typer.Argument(metavar="SCENARIO.toml", help="Whose network and settings.")],
    name: Annotated[str | None, typer.Argument(help="Which relay or breaker of the scenario.")] = None,
    can: Annotated[
        str | None, typer.Option(metavar="INTERFACE:CHANNEL", help="The bus, as in socketcan:vcan0.")
    ] = None,
    pace: Annotated[
        float, typer.Option(metavar="X", help="Run time in one second of wall time; the same for all.")
    ] = 1.0,
    log: Annotated[Path | None, typer.Option(metavar="F.mcap", help="This node's own log.")] = None,
    set_: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Override: fault.F1.at_pu=0.7.")
    ] = None,
    closed: Annotated[
        int | None,
        typer.Option(min=0, max=7, help="breaker: mask of the poles that are closed when it starts."),
    ] = None,
) -> int:
    """One real process on a real bus: the plant, a relay or a breaker; any may be a device of your own."""
    from faultloop.live.nodes import NodeOptions, run_role

    options = NodeOptions(role.value, scenario, name, can, pace, log, tuple(set_ or ()), closed)
    return 0 if run_role(options) else 130
