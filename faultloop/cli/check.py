"""``faultloop check``"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from faultloop.relay.settings import RelaySettings

LOG_BYTES = 620
"""Of a log, per relay and sample (measured)."""
RELAYS_REAL_TIME = 40
"""Seconds of one relay that a core simulates and logs in a second, about (docs/evidence.md)."""


def command(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A scenario, relay settings or a campaign.")],
    json: Annotated[bool, typer.Option("--json", help="One JSON object on standard output.")] = False,
) -> int:
    """Validate a file and tell how long it will take and what it will write.  Nothing is run."""
    from faultloop.cli.output import console, print_json
    from faultloop.config.tables import read_toml
    from faultloop.errors import InputError

    data, _ = read_toml(file)
    kinds = {"campaign": _campaign, "scenario": _scenario, "relay": _settings}
    kind = next((name for name in kinds if isinstance(data.get(name), dict)), None)
    if kind is None:
        raise InputError("has none of [scenario], [relay] (settings) and [campaign]", file=file)
    told = {"file": str(file), "valid": True} | kinds[kind](file)
    if json:
        print_json(told)
    else:
        out = console()
        for key, value in told.items():
            out.print(f"{key.replace('_', ' ')}: {_text(value)}")
    return 0


def _scenario(file: Path) -> dict[str, Any]:
    from faultloop.loop.doubts import scenario_doubts
    from faultloop.loop.inputs import check_expectations, load_inputs
    from faultloop.plant import Plant
    from faultloop.relay import Relay

    scenario, settings = load_inputs(file)
    check_expectations(scenario, {name: Relay(own, name) for name, own in settings.items() if not _code(own)})
    duration_s, relays = scenario.scenario.duration_s, len(scenario.relay)
    samples = round(duration_s * scenario.system.sampling_hz)
    return {
        "kind": "scenario",
        "name": scenario.scenario.name,
        "duration_s": duration_s,
        "relays": [place.name for place in scenario.relay],
        "faults": len(scenario.fault),
        "expectations": len(scenario.expect),
        "samples_per_relay": samples,
        "log_mb": round(samples * relays * LOG_BYTES / 1e6, 1),
        "seconds_about": round(duration_s * max(relays, 1) / RELAYS_REAL_TIME + 1, 1),
        "user_code": sorted({code for own in settings.values() for code in _code(own)}),
        "warnings": scenario_doubts(scenario, settings, Plant(scenario)),
    }


def _settings(file: Path) -> dict[str, Any]:
    from faultloop.loop.doubts import settings_doubts
    from faultloop.relay import Relay, load_settings

    settings = load_settings(file)
    code = _code(settings)
    if not code:
        Relay(settings)  # what it refuses
    return {
        "kind": "relay settings",
        "estimator": settings.estimator.method,
        "zones": [zone.zone for zone in settings.pdis],
        "user_code": code,
        "warnings": settings_doubts(settings),
    }


def _campaign(file: Path) -> dict[str, Any]:
    from faultloop.loop.doubts import settings_doubts
    from faultloop.study.campaign import Campaign
    from faultloop.study.campaign.cost import cost_of

    campaign = Campaign.load(file)
    first = campaign.plan.first
    return {
        "kind": "campaign",
        "name": campaign.plan.tables.campaign.name,
        "cases": campaign.cases,
        "varied": list(campaign.plan.keys),
        "judges": len(campaign.plan.tables.judge),
        "relays": list(first.settings),
        **cost_of(campaign.plan),
        "user_code": sorted({code for own in first.settings.values() for code in _code(own)}),
        "warnings": list(
            dict.fromkeys(text for name, own in first.settings.items() for text in settings_doubts(own, name))
        ),
    }


def _code(settings: RelaySettings) -> list[str]:
    from faultloop.relay.named_code import named_code

    return [code for _, code in named_code(settings)]


def _text(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{name} {inner}" for name, inner in value.items())
    if isinstance(value, list):
        return ("; " if any(" " in str(v) for v in value) else ", ").join(map(str, value)) or "none"
    return str(value)
