"""A small campaign on the shipped scenario, shortened."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[3]
SETTINGS = ROOT / "scenarios" / "settings" / "ab-mho.toml"

CAMPAIGN: dict[str, Any] = {
    "campaign": {"name": "small", "scenario": "base.toml", "sampling": "grid"},
    "vary": [
        {"key": "fault.F1.at_pu", "values": [0.2, 0.6, 0.97]},
        {"key": "fault.F1.type", "values": ["AG", "BC"]},
    ],
    "judge": [
        {"relay": "RA", "where": "inside", "trip": True, "function": "PDIS1", "within_ms": 60},
        {"relay": "RB", "trip": True},
    ],
}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """With the scenario ``base.toml`` and its settings."""
    text = (ROOT / "scenarios" / "ag-zone1.toml").read_text(encoding="utf-8")
    text = text.replace("duration_s = 0.4", "duration_s = 0.2")
    (tmp_path / "base.toml").write_text(text[: text.index("[[expect]]")], encoding="utf-8")
    (tmp_path / "settings").mkdir()
    (tmp_path / "settings" / "ab-mho.toml").write_text(SETTINGS.read_text(encoding="utf-8"), encoding="utf-8")
    return tmp_path


@pytest.fixture
def tables() -> dict[str, Any]:
    """The campaign, to change."""
    return copy.deepcopy(CAMPAIGN)
