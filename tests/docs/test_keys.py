"""The tables of keys in docs/ are what the models say, have all tables, and say something of every key."""

from __future__ import annotations

import re
from pathlib import Path
from types import ModuleType

import pytest

from faultloop.config.key_table import key_table
from tests.load import load

ROOT = Path(__file__).resolve().parents[2]
PAGES = ("scenario.md", "campaigns.md")


@pytest.fixture(scope="module")
def keys() -> ModuleType:
    return load("docs/keys.py")


@pytest.mark.parametrize("page", PAGES)
def test_the_tables_are_those_of_the_models(keys: ModuleType, page: str) -> None:
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    assert keys.filled(text, keys.PAGES[page]) == text, "python docs/keys.py"
    shown = set(re.findall(keys.PLACE, text))
    assert set(keys.tables(keys.PAGES[page])) - shown <= {"relay.front_end"}  # as [front_end]


def test_what_commands_print_is_that_of_their_types(keys: ModuleType) -> None:
    assert (ROOT / "docs" / "json.md").read_text(encoding="utf-8") == keys.json_page(), "python docs/keys.py"


@pytest.mark.parametrize("page", PAGES)
def test_every_key_has_a_meaning(keys: ModuleType, page: str) -> None:
    for table in keys.tables(keys.PAGES[page]):
        for row in key_table(keys.model_of(keys.PAGES[page], table))[2:]:
            cells = re.split(r"(?<!\\)\|", row)
            assert len(cells) == 7, row
            assert cells[5].strip(), (table, row)
            assert cells[4].strip(), (table, row)
