"""The README shows what the program prints, is short, and its links lead somewhere."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from faultloop.cli import call


@pytest.fixture(scope="module")
def readme(root: Path) -> str:
    return (root / "README.md").read_text(encoding="utf-8")


def test_the_printed_run_is_what_it_prints(
    readme: str, root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call(["run", str(root / "scenarios" / "ag-zone1.toml"), "--log", str(tmp_path / "x.mcap")]) == 0
    printed = [line.strip() for line in capsys.readouterr().out.splitlines()]
    shown = {line.strip() for line in readme.splitlines()}
    told = [line for line in printed if line and not line.startswith(("A-G in zone 1", "log:"))]
    assert len(told) > 30
    assert [line for line in told if line not in shown] == []


def test_its_links_lead_somewhere(readme: str, root: Path) -> None:
    for target in re.findall(r"\]\(([^)#]+)\)", readme):
        if "://" not in target:
            assert (root / target).exists(), target


def test_it_is_short(readme: str) -> None:
    """What is longer belongs into docs/, which it points to."""
    assert len(readme.splitlines()) <= 150
    assert "docs/tutorials/scenario.md" in readme
