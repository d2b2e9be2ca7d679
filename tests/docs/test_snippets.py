"""Every Python snippet of docs/ is executed: here, or by the test that is named beside its page."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from faultloop.cli import call

ROOT = Path(__file__).resolve().parents[2]
HERE = ("README.md", "docs/log.md", "docs/comtrade.md", "docs/plant.md")
ELSEWHERE = {
    "docs/campaigns.md": "tests/study/campaign/test_docs.py",
    "docs/can.md": "tests/io/test_can_docs.py",
    "docs/estimators.md": "tests/study/test_own_data.py",
    "docs/how-to-add.md": "tests/relay/test_element.py",
    "docs/relay.md": "tests/relay/test_element.py",
    "docs/testing.md": "tests/testing",
}
SNIPPET = re.compile(r"^```python\n(.*?)^```", re.MULTILINE | re.DOTALL)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log and the record of it, beside the shipped scenarios."""
    folder = tmp_path_factory.mktemp("snippets")
    (folder / "scenarios").symlink_to(ROOT / "scenarios")
    log = folder / "run.mcap"
    assert call(["run", str(ROOT / "scenarios" / "ag-zone1.toml"), "--log", str(log)]) == 0
    assert call(["export", str(log), "--comtrade", str(folder / "run.cfg")]) == 0
    return folder


@pytest.mark.parametrize("page", HERE)
def test_it_runs(page: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    known: dict[str, Any] = {}
    snippets = SNIPPET.findall((ROOT / page).read_text(encoding="utf-8"))
    assert snippets
    for code in snippets:
        exec(compile(code, page, "exec"), known)


def test_no_page_is_forgotten() -> None:
    pages = [ROOT / "README.md", *(ROOT / "docs").glob("*.md")]
    code = {p.relative_to(ROOT).as_posix() for p in pages if "```python" in p.read_text(encoding="utf-8")}
    assert code <= {*HERE, *ELSEWHERE}
    for page, test in ELSEWHERE.items():
        files = [ROOT / test] if test.endswith(".py") else sorted((ROOT / test).rglob("test_*.py"))
        assert any(Path(page).name in file.read_text(encoding="utf-8") for file in files), (page, test)


def test_no_page_shows_python_as_plain_text() -> None:
    """What is indented is not run: commands, and files of other programs."""
    pages = [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]
    for page in pages:
        text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
        found = re.findall(r"^    (?:from \w[\w.]* import|import) .*$", text, re.MULTILINE)
        assert not found or page.name == "can.md", (page, found)  # which test_can_docs.py runs
