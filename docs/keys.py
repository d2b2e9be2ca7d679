"""Writes the tables of keys in docs/scenario.md and docs/campaigns.md from the models of these files.

python docs/keys.py                 # writes them anew, between <!-- keys: TABLE --> and <!-- end -->
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, get_args

from faultloop.config.campaign import CampaignTables
from faultloop.config.key_table import key_table
from faultloop.config.tables import Table
from faultloop.loop.scenario import Scenario

FOLDER = Path(__file__).parent
PAGES: dict[str, type[Any]] = {"scenario.md": Scenario, "campaigns.md": CampaignTables}
PLACE = re.compile(r"<!-- keys: ([\w.]+) -->\n.*?<!-- end -->", re.DOTALL)


def filled(text: str, whole: type[Any]) -> str:
    """The page with the tables that its marks name.  Raises KeyError for one that the model does not have."""

    def table(mark: re.Match[str]) -> str:
        lines = key_table(model_of(whole, mark[1]))
        return "\n".join([f"<!-- keys: {mark[1]} -->", *lines, "<!-- end -->"])

    return PLACE.sub(table, text)


def tables(whole: type[Any]) -> list[str]:
    """The names of all that a file may hold: ``vt``, and ``vt.circuit`` for a table inside."""
    found = []
    for name, field in whole.model_fields.items():
        for model in _models(field.annotation):
            own = field.alias or name
            found += [own, *(f"{own}.{inner}" for inner in tables(model))]
    return found


def model_of(whole: type[Any], path: str) -> type[Table]:
    """The model of a table."""
    for part in path.split("."):
        field = next((f for name, f in whole.model_fields.items() if (f.alias or name) == part), None)
        if field is None:
            raise KeyError(path)
        (whole,) = _models(field.annotation)
    return whole


def _models(annotation: Any) -> list[type[Table]]:
    if isinstance(annotation, type) and issubclass(annotation, Table):
        return [annotation]
    return [model for inner in get_args(annotation) for model in _models(inner)]


if __name__ == "__main__":
    for page, whole in PAGES.items():
        path = FOLDER / page
        path.write_text(filled(path.read_text(encoding="utf-8"), whole), encoding="utf-8")
