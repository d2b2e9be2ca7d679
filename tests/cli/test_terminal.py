"""What reaches a terminal or a pipe: text in its encoding, and nothing that a terminal would obey."""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from faultloop.cli import call
from faultloop.cli.terminal import safe
from tests.io.comtrade_records import config_text, data_bytes, write

MHO = Path(__file__).resolve().parents[2] / "scenarios" / "settings" / "ab-mho.toml"


SLOW = pytest.mark.slow


@pytest.mark.parametrize(
    ("command", "encoding"),
    [
        ("replay", "ascii"),
        ("channels", "gbk"),
        *(pytest.param("replay", encoding, marks=SLOW) for encoding in ("cp1252", "utf-8", "gbk")),
        *(pytest.param("channels", encoding, marks=SLOW) for encoding in ("cp1252", "ascii", "utf-8")),
    ],
)
def test_output_of_any_encoding(
    root: Path, shared: Path, tmp_path: Path, command: str, encoding: str
) -> None:
    arguments = [command, str(shared / "cases" / "stdout-encoding" / "r.cfg")]
    if command == "replay":
        arguments += ["--settings", str(MHO), "--log", str(tmp_path / "l.mcap")]
    environment = os.environ | {"PYTHONIOENCODING": encoding, "PYTHONUTF8": "0", "PYTHONPATH": str(root)}
    done = subprocess.run(
        [sys.executable, "-m", "faultloop", *arguments], env=environment, capture_output=True, check=False
    )
    assert done.returncode == 0, done.stderr
    out = done.stdout.decode(encoding)
    assert ("A相电压" if encoding in ("utf-8", "gbk") else r"A\u76f8\u7535\u538b") in out


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("a\tb\nc", "a\tb\nc"),
        ("\x1b[2J", r"\x1b[2J"),
        ("\x9b2J\x07\x08\r", r"\x9b2J\x07\x08\x0d"),
        ("\x7f\x00", r"\x7f\x00"),
        ("a\u202eb\u2066", r"a\u202eb\u2066"),
        ("Ä 相 Ω", "Ä 相 Ω"),
    ],
)
def test_control_characters_are_shown(text: str, shown: str) -> None:
    assert safe(text) == shown


@pytest.mark.parametrize("command", ["replay", "channels", "review"])
def test_no_control_character_of_a_file_reaches_a_terminal(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str
) -> None:
    names = ("VA", "VB\x1b[31m", "VC\x9b5m", "IA\x07", "IB\x08\x08", "IC\u202e")
    record = write(tmp_path, config_text(names=names), data_bytes())
    mapping = ["--map", "va=0,vb=1,vc=2,ia=3,ib=4,ic=5"]
    replayed = ["replay", str(record), "--settings", str(MHO), "--log", str(tmp_path / "l.mcap"), *mapping]
    if command != "channels":
        assert call(replayed) == 0
    if command == "review":
        capsys.readouterr()
    if command != "replay":
        assert call([command, str(record if command == "channels" else tmp_path / "l.mcap")]) == 0
    out = capsys.readouterr().out
    assert command == "review" or r"VB\x1b[31m" in out
    assert not {character for character in out if ord(character) < 32} - {"\n"}
    assert not set(out) & {"\x7f", "\x9b", "\u202e"}


def test_errors_are_safe_too(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert call(["channels", str(tmp_path / "\x1b]0;x\x07.cfg")]) == 2
    assert "\x1b" not in capsys.readouterr().err


@pytest.mark.skipif(shutil.which("zsh") is None, reason="needs-zsh: apt-get install zsh")
def test_zsh_completes_at_the_first_tab(root: Path, tmp_path: Path) -> None:
    """The installed file as zsh runs it then: read as the body of the function that completes."""
    environment = os.environ | {
        "_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "1",
        "HOME": str(tmp_path),
        "ZDOTDIR": str(tmp_path),
        "PYTHONPATH": str(root),
    }
    program = [sys.executable, "-m", "faultloop"]
    installed = [*program, "--install-completion", "zsh"]
    subprocess.run(installed, env=environment, capture_output=True, check=True)
    tab = f"""
        faultloop() {{ {shlex.join(program)} "$@" }}
        env() {{ while [[ $1 == *=* ]]; do export $1; shift; done; "$@" }}
        compdef() {{ }}
        _arguments() {{ print -r -- "$@" }}
        fpath+=({tmp_path}/.zfunc); autoload -Uz _faultloop
        words=(faultloop ca); CURRENT=2; _faultloop
    """
    done = subprocess.run(["zsh", "-fc", tab], env=environment, capture_output=True, text=True, check=False)
    assert done.stderr == ""
    assert all(name in done.stdout for name in ("campaign-report", "campaign-case"))


def test_no_command_prints_the_help(capsys: pytest.CaptureFixture[str]) -> None:
    """And nothing that looks like an error with its text left out; the program's name is `faultloop`, however
    it was started: the shell completion is made for that name."""
    assert call([]) == 2
    out, err = capsys.readouterr()
    assert "Usage: faultloop [OPTIONS] COMMAND" in out and err == ""
