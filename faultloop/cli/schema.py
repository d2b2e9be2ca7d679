"""``faultloop schema``"""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated, Any

import typer


class Kind(StrEnum):
    """What has a schema: files, and what commands print with --json."""

    scenario = "scenario"
    relay = "relay"
    campaign = "campaign"
    review = "review"
    why = "why"


def command(
    kind: Annotated[Kind, typer.Argument(help="Of which file, or of which command's --json.")],
) -> int:
    """JSON Schema of a scenario, settings or a campaign, for editors; of what review and why print."""
    from faultloop.cli.output import print_json

    print_json({"$schema": "https://json-schema.org/draft/2020-12/schema"} | _schema(kind))
    return 0


def _schema(kind: Kind) -> dict[str, Any]:
    match kind:
        case Kind.scenario:
            from faultloop.loop.scenario import Scenario as model
        case Kind.relay:
            from faultloop.relay.settings import RelaySettings as model
        case Kind.campaign:
            from faultloop.config.campaign import CampaignTables as model
        case Kind.review | Kind.why:
            from pydantic import TypeAdapter

            from faultloop.review.facts import Summary
            from faultloop.review.why import Reason

            printed: Any = Summary if kind is Kind.review else list[Reason]
            return TypeAdapter(printed).json_schema(mode="serialization")
    return model.model_json_schema(by_alias=True)
