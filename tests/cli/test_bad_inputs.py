"""Every command with every kind of input that is none: one line, exit status 2, nothing left behind."""

from __future__ import annotations

import contextlib
import ctypes
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from faultloop.cli import call

ROOT = Path(__file__).resolve().parents[2]
AG = ROOT / "scenarios" / "ag-zone1.toml"
SETTINGS = ROOT / "scenarios" / "settings" / "ab-mho.toml"
Capture = pytest.CaptureFixture[str]

COMMANDS: dict[str, tuple[list[str], str]] = {
    "run": (["run", "{}", "--log", "out.mcap"], ".toml"),
    "check": (["check", "{}"], ".toml"),
    "node": (["node", "plant", "{}", "--can", "virtual:x"], ".toml"),
    "run-settings": (["run", str(AG), "--log", "out.mcap", "--set", "relay.RA.settings={}"], ".toml"),
    "run-keys": (
        ["run", str(AG), "--log", "out.mcap", "--set", "can.fd=true", "--set", "can.keys={}"],
        ".toml",
    ),
    "replay": (["replay", "{}", "--settings", str(SETTINGS), "--log", "out.mcap"], ".cfg"),
    "channels": (["channels", "{}"], ".cfg"),
    "channels-log": (["channels", "{}"], ".mcap"),
    "replay-cff": (["replay", "{}", "--settings", str(SETTINGS), "--log", "out.mcap"], ".cff"),
    "replay-log": (["replay", "{}", "--settings", str(SETTINGS), "--log", "out.mcap"], ".mcap"),
    "replay-settings": (["replay", "record.cfg", "--settings", "{}", "--log", "out.mcap"], ".toml"),
    "review": (["review", "{}"], ".mcap"),
    "export": (["export", "{}", "--csv", "out"], ".mcap"),
    "diff": (["diff", "{}", "{}"], ".mcap"),
    "recover": (["recover", "{}", "out.mcap"], ".mcap"),
}
"""The arguments, and the suffix that lets the file through to its reader."""


def _pipe(path: Path) -> None:
    os.mkfifo(path)


def _nested(path: Path) -> None:
    path.write_text("x = " + "[" * 100_000, encoding="utf-8")


def _deep(path: Path) -> None:
    path.write_text("[" + ".".join("a" * 500) + "]\n", encoding="utf-8")


def _huge(path: Path) -> None:
    with path.open("wb") as file:  # sparse
        file.truncate(2**33)


def _unreadable(path: Path) -> None:
    path.write_text("x = 1", encoding="utf-8")
    path.chmod(0)


def _loop(path: Path) -> None:
    path.symlink_to(path)


BAD: dict[str, Callable[[Path], object]] = {
    "nothing": lambda path: None,
    "folder": lambda path: path.mkdir(),
    "empty": lambda path: path.write_bytes(b""),
    "pipe": _pipe,
    "device": lambda path: path.symlink_to("/dev/zero"),
    "null": lambda path: path.symlink_to("/dev/null"),
    "link to itself": _loop,
    "bytes": lambda path: path.write_bytes(bytes(range(256)) * 4),
    "nul": lambda path: path.write_bytes(bytes(1000)),
    "utf-16": lambda path: path.write_text("[scenario]\nname = 'x'\n", encoding="utf-16"),
    "nested": _nested,
    "deep": _deep,
    "digits": lambda path: path.write_text("x = " + "1" * 10_000, encoding="utf-8"),
    "huge": _huge,
    "escape": lambda path: path.write_bytes(b"\x1b[31m = 1\n"),
}


def refused(capsys: Capture, arguments: list[str]) -> str:
    assert call(arguments) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("faultloop: ")
    assert err.count("\n") == 1
    assert "Traceback" not in err
    assert "\x1b" not in err
    return err


@pytest.mark.skipif(sys.platform == "win32", reason="pipes and devices of POSIX")
@pytest.mark.parametrize("kind", BAD)
@pytest.mark.parametrize("command", COMMANDS)
def test_an_input_that_is_none(
    capsys: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: str, kind: str
) -> None:
    arguments, suffix = COMMANDS[command]
    bad = tmp_path / f"bad{suffix}"
    BAD[kind](bad)
    monkeypatch.chdir(tmp_path)
    if kind not in ("nothing", "folder", "pipe", "device", "null", "link to itself"):
        bad.chmod(0o600)
    before = set(tmp_path.iterdir())
    err = refused(capsys, [part.replace("{}", str(bad)) for part in arguments])
    assert "bad" in err or "out" in err or "record.cfg" in err
    assert set(tmp_path.iterdir()) == before


@pytest.mark.parametrize("path", [".", "/", "", "..", "a" * 300, "x/" * 2500, "\0"])
@pytest.mark.parametrize("command", COMMANDS)
def test_a_path_that_is_none(
    capsys: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: str, path: str
) -> None:
    monkeypatch.chdir(tmp_path)
    refused(capsys, [part.replace("{}", path) for part in COMMANDS[command][0]])
    assert not list(tmp_path.iterdir())


@contextlib.contextmanager
def permissions_hold() -> Iterator[None]:
    """As a process that may not read everything, which root's may (capabilities(7): CAP_DAC_OVERRIDE and
    CAP_DAC_READ_SEARCH of its effective set)."""
    if os.geteuid() != 0:
        yield
        return
    libc = ctypes.CDLL(None, use_errno=True)
    header = (ctypes.c_uint32 * 2)(0x20080522, 0)
    sets = (ctypes.c_uint32 * 6)()
    assert libc.capget(header, sets) == 0
    kept = sets[0]
    sets[0] = kept & ~0b110
    assert libc.capset(header, sets) == 0
    try:
        yield
    finally:
        sets[0] = kept
        assert libc.capset(header, sets) == 0


@pytest.mark.skipif(sys.platform == "win32", reason="permissions of POSIX")
@pytest.mark.parametrize("command", COMMANDS)
def test_a_file_of_somebody_else(
    capsys: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: str
) -> None:
    arguments, suffix = COMMANDS[command]
    bad = tmp_path / f"bad{suffix}"
    _unreadable(bad)
    monkeypatch.chdir(tmp_path)
    with permissions_hold():
        refused(capsys, [part.replace("{}", str(bad)) for part in arguments])


@pytest.mark.parametrize(
    "override",
    [
        "", "=", "x", "x=1", ".=1", "a..b=1", "scenario=1", "line=1", "line.0=1", "line.9.length_km=1",
        "line.AB.length_km=" + "[" * 100_000, "line.AB.length_km=" + "1" * 10_000, "line.AB.length_km=",
        "line.AB.length_km=\x1b[31m", "fault.F1.at_pu=\udcff", "scenario.duration_s=inf", "scenario.seed=-1",
        "scenario.duration_s.x=1", "fault.F1.at_pu.x.y=1",
    ],
)  # fmt: skip
def test_an_override_that_is_none(capsys: Capture, tmp_path: Path, override: str) -> None:
    refused(capsys, ["run", str(AG), "--log", str(tmp_path / "out.mcap"), "--set", override])
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "arguments",
    [
        [], ["nonsense"], ["run"], ["run", "--nonsense"], ["run", str(AG), "--pace", "x"], ["suite"],
        ["suite", "nonsense"], ["schema"], ["schema", "nonsense"], ["check"], ["diff", "x"],
        ["run", str(AG), "--realtime", "--pace", "1"], ["run", str(AG), "extra"], ["export", "x.mcap"],
    ],
)  # fmt: skip
def test_a_command_line_that_is_none(capsys: Capture, arguments: list[str]) -> None:
    if arguments:
        refused(capsys, arguments)
