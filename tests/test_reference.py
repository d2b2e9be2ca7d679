"""docs/reference.md is what the code says."""

from __future__ import annotations

import importlib.util
from pathlib import Path


def test_the_page_is_that_of_the_code(root: Path) -> None:
    place = importlib.util.spec_from_file_location("reference", root / "docs" / "reference.py")
    assert place is not None and place.loader is not None
    module = importlib.util.module_from_spec(place)
    place.loader.exec_module(module)
    made, page = module.reference(), (root / "docs" / "reference.md").read_text(encoding="utf-8")
    assert made.splitlines() == page.splitlines(), "python docs/reference.py"
