"""``faultloop schema``"""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

import typer


class Kind(StrEnum):
    """The files that have a schema."""

    scenario = "scenario"
    relay = "relay"
    campaign = "campaign"


def command(kind: Annotated[Kind, typer.Argument(help="Of which file.")]) -> int:
    """JSON Schema of a scenario, of settings or of a campaign, for editors that complete and check TOML."""
    from faultloop.cli.output import print_json
    from faultloop.config.campaign import CampaignTables
    from faultloop.loop.scenario import Scenario
    from faultloop.relay.settings import RelaySettings

    model = {Kind.scenario: Scenario, Kind.relay: RelaySettings, Kind.campaign: CampaignTables}[kind]
    schema = model.model_json_schema(by_alias=True)
    print_json({"$schema": "https://json-schema.org/draft/2020-12/schema"} | schema)
    return 0
