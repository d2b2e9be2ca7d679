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
    run = "run"
    replay = "replay"
    channels = "channels"
    check = "check"
    review = "review"
    why = "why"
    why_at = "why-at"
    locate = "locate"
    diff = "diff"
    export = "export"
    recover = "recover"
    import_ = "import"
    monitor = "monitor"
    suite = "suite"
    campaign_summary = "campaign-summary"
    campaign_report = "campaign-report"
    campaign_case = "campaign-case"


def command(
    kind: Annotated[
        Kind,
        typer.Argument(
            help="scenario, relay, campaign: of such a file.  Else of what a command prints with --json: "
            "run, review ...; campaign-summary: of campaign; why-at: of why --at."
        ),
    ],
) -> int:
    """JSON Schema of a scenario, settings or a campaign, for editors; of what commands print with --json."""
    from faultloop.cli.output import print_json

    print_json({"$schema": "https://json-schema.org/draft/2020-12/schema"} | schema_of(kind))
    return 0


def schema_of(kind: Kind) -> dict[str, Any]:
    """The schema, without its first line."""
    match kind:
        case Kind.scenario:
            from faultloop.loop.scenario import Scenario as model
        case Kind.relay:
            from faultloop.relay.settings import RelaySettings as model
        case Kind.campaign:
            from faultloop.config.campaign import CampaignTables as model
        case _:
            from pydantic import TypeAdapter

            from faultloop.cli.printed import PRINTED

            return TypeAdapter(PRINTED[kind]).json_schema(mode="serialization")
    return model.model_json_schema(by_alias=True)
