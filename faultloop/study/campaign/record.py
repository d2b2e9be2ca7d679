"""What a campaign's file carries along: all that one of its cases needs to be run again."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

from faultloop.config.campaign import CampaignTables
from faultloop.config.tables import parse_toml, validate
from faultloop.errors import InputError
from faultloop.jit import source_digest
from faultloop.loop.recording import versions
from faultloop.loop.scenario import Scenario
from faultloop.relay import RelaySettings
from faultloop.relay.named_code import named_code
from faultloop.study.campaign.plan import Files, Plan


def record_of(plan: Plan) -> dict[str, Any]:
    """The campaign, the scenario, the settings with the code that they name, versions."""
    settings = {}
    for reference, (path, text, data) in plan.files.settings.items():
        settings[reference] = {"name": path.name, "text": text, "code": _code(path, data)}
    return {
        "format": 1,
        "campaign": plan.tables.model_dump(mode="json", by_alias=True, exclude_none=True),
        "scenario": {"name": plan.files.path.name, "text": plan.files.text},
        "settings": settings,
        "keys": {name: key_digest(path) for name, path in plan.key_files().items()},
        "seed": plan.tables.campaign.seed,
        "cases": plan.cases,
        "versions": versions(),
        "sources": source_digest("study"),
    }


def key_digest(path: Path) -> str:
    """Tells whether a key file is the same.  The keys stay out of the record: they are secrets of a bus, and
    a campaign's file is made to be handed on.  Yet a row depends on them (their tags change how many bits are
    stuffed into a frame), so a case cannot be run again with others.
    """
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise InputError(
            f"cannot be read: {error.strerror or error}; [can] keys names it", file=path
        ) from None


def fingerprint(record: dict[str, Any]) -> str:
    """Of all that decides what the rows are."""
    return hashlib.sha256(json.dumps(record, sort_keys=True).encode()).hexdigest()


def plan_of(record: dict[str, Any], folder: Path, file: object, user_code: bool = True) -> Plan:
    """The plan again, its files laid out in ``folder``.  Raises InputError where the record is not whole."""
    try:
        scenario, settings = record["scenario"], record["settings"]
        path = folder / Path(scenario["name"]).name
        path.write_text(scenario["text"], encoding="utf-8")
        files = Files(path, scenario["text"], Scenario.named(parse_toml(scenario["text"], file)))
        for number, (reference, own) in enumerate(settings.items()):
            place = folder / f"settings-{number}" / Path(own["name"]).name
            place.parent.mkdir()
            place.write_text(own["text"], encoding="utf-8")
            for name, text in own["code"].items():
                (place.parent / Path(name).name).write_text(text, encoding="utf-8")
            files.settings[reference] = place, own["text"], parse_toml(own["text"], file)
        return Plan(validate(CampaignTables, record["campaign"], file), files, file, user_code)
    except (KeyError, TypeError, AttributeError) as error:
        raise InputError(
            f"is a campaign's, but what it tells of itself is not whole ({error!r})", file=file
        ) from None


def _code(path: Path, data: dict[str, Any]) -> dict[str, str]:
    """Files of Python that the settings name, by name."""
    found = {}
    for _, code in named_code(RelaySettings.from_dict(data, path=path)):
        name = code.rpartition(":")[0]
        if name.endswith(".py") and (path.parent / name).is_file():
            found[name] = (path.parent / name).read_text(encoding="utf-8")
    return found
