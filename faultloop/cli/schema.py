"""``faultloop schema``"""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

import typer


class Kind(StrEnum):
    """The files that have a schema."""

    scenario = "scenario"
    relay = "relay"


def command(kind: Annotated[Kind, typer.Argument(help="Of which file.")]) -> int:
    """JSON Schema of a scenario or of relay settings, for editors that complete and check TOML."""
    from faultloop.cli.output import print_json
    from faultloop.loop.scenario import Scenario
    from faultloop.relay.settings import RelaySettings

    model = {Kind.scenario: Scenario, Kind.relay: RelaySettings}[kind]
    schema = model.model_json_schema(by_alias=True)
    print_json({"$schema": "https://json-schema.org/draft/2020-12/schema"} | schema)
    return 0
