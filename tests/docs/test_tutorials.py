"""Every command, file and snippet of the tutorials is run, and prints what the page says."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest

from faultloop.cli import call

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "docs" / "index.md", *sorted((ROOT / "docs" / "tutorials").glob("*.md"))]
BLOCK = re.compile(r'^```(\w+)(?: title="([^"]+)")?\n(.*?)^```$', re.MULTILINE | re.DOTALL)
EXIT = re.compile(r"  # exit (\d+)$")


def run(line: str, capsys: pytest.CaptureFixture[str]) -> str:
    """A command of the page; what it printed.  ``> FILE`` and ``# exit N`` are heeded."""
    status = int(found[1]) if (found := EXIT.search(line)) else 0
    words, _, target = EXIT.sub("", line).partition(" > ")
    program, *arguments = shlex.split(words)
    if program == "pytest":
        command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *arguments]
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
        assert done.returncode == status, done.stdout + done.stderr
        return done.stdout
    assert program == "faultloop", line
    capsys.readouterr()
    got = call(arguments)
    out, err = capsys.readouterr()
    assert got == status, (line, out, err)
    if target:
        Path(target).write_text(out, encoding="utf-8")
    return out + err


def words(text: str) -> str:
    return " ".join(text.split())


QUICK = ("scenario",)
RUN = [pytest.param(p, id=p.stem, marks=[] if p.stem in QUICK else pytest.mark.slow) for p in PAGES]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_every_file_of_it_can_be_read(page: Path) -> None:
    blocks = BLOCK.findall(page.read_text(encoding="utf-8"))
    assert len(blocks) == page.read_text(encoding="utf-8").count("\n```") / 2
    for kind, title, body in blocks:
        if kind == "toml":
            assert tomllib.loads(body)
        elif kind == "python":
            compile(body, title or page.name, "exec")
        else:
            assert kind in ("sh", "text") and not title


@pytest.mark.parametrize("page", RUN)
def test_the_page_is_as_it_says(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    known: dict[str, Any] = {}
    printed = ""
    for kind, title, body in BLOCK.findall(page.read_text(encoding="utf-8")):
        if title:
            Path(title).parent.mkdir(parents=True, exist_ok=True)
            Path(title).write_text(body, encoding="utf-8")
        elif kind == "sh":
            printed = "\n".join(run(line, capsys) for line in body.splitlines())
        elif kind == "text":
            told = words(printed)
            assert [line for line in body.splitlines() if words(line) not in told] == [], printed
        elif kind == "python":
            exec(compile(body, str(page), "exec"), known)
        else:
            assert kind == "toml" and tomllib.loads(body)
