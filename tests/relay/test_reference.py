"""docs/settings.md is what the models say, and they say something of every key."""

from __future__ import annotations

from pathlib import Path

from faultloop.relay import RelaySettings
from faultloop.relay.functions import FUNCTIONS
from faultloop.relay.reference import reference

AGAIN = "python -m faultloop.relay.reference > docs/settings.md"


def test_the_page_is_that_of_the_models(root: Path) -> None:
    assert (root / "docs" / "settings.md").read_text(encoding="utf-8") == reference(), AGAIN


def test_every_key_has_a_meaning() -> None:
    rows = [line for line in reference().splitlines() if line.startswith("| `")]
    assert len(rows) >= 60
    assert [row for row in rows if row.split("|")[5].strip() == ""] == []


def test_the_schema_has_a_table_for_every_function() -> None:
    schema = RelaySettings.model_json_schema()
    for function in FUNCTIONS:
        field = schema["properties"][function.key]
        model = schema["$defs"][function.settings.__name__]
        assert (field.get("type") == "array") == (function.most > 1)
        assert set(model["properties"]) == set(function.settings.model_fields)
