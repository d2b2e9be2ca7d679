"""What commands print with --json is what their published schema says, of a real run each."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import typer.main
from pydantic import TypeAdapter

import faultloop
from faultloop.cli import app, call, monitor
from faultloop.cli.printed import PRINTED
from faultloop.cli.schema import Kind
from faultloop.io.can.frames import Frame, Heartbeat
from faultloop.io.can.table import OPERATIONAL

ROOT = Path(__file__).resolve().parents[2]
SCENARIOS = ROOT / "scenarios"
MHO = SCENARIOS / "settings" / "ab-mho.toml"
CAMPAIGN = f"""[campaign]
name = "three"
scenario = '{SCENARIOS / "ag-zone1.toml"}'
sampling = "grid"

[[vary]]
key = "fault.F1.at_pu"
values = [0.3, 0.6, 0.95]

[[judge]]
relay = "RA"
where = "inside"
trip = true
"""


@dataclass(frozen=True)
class Place:
    """Where the files are that commands are called with."""

    folder: Path

    def __getattr__(self, name: str) -> str:
        return str(self.folder / name.replace("__", "."))


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Place:
    here = Place(tmp_path_factory.mktemp("printed"))
    faultloop.run(SCENARIOS / "ag-zone1.toml", log=here.ag__mcap)
    faultloop.run(SCENARIOS / "ag-zone1.toml", log=here.more__mcap, overrides=["fault.F1.resistance_ohm=2"])
    assert call(["export", here.ag__mcap, "--comtrade", here.ag__cfg, "--relay", "RA"]) == 0
    assert call(["export-settings", str(MHO), here.ab__rio]) == 0
    (here.folder / "three.toml").write_text(CAMPAIGN, encoding="utf-8")
    assert call(["campaign", here.three__toml, "--out", here.there__parquet, "--workers", "1"]) == 0
    return here


class Fed:
    """A bus on which two frames come: a heartbeat, and one that nobody knows."""

    dropped, errors = 0, 0

    def __init__(self) -> None:
        self.frames = [(1, Heartbeat(0, OPERATIONAL, 0, 0, 0).encode()), (2, Frame(0x7EE, b"\x01"))]

    def receive(self, timeout_s: float) -> list[tuple[int, Frame]]:
        frames, self.frames = self.frames, []
        return frames

    def close(self) -> None:
        pass


Words = Callable[[Place], list[str]]
CALLS: dict[str, list[tuple[str, Words, int]]] = {
    "run": [
        ("run", lambda at: [str(SCENARIOS / "ag-zone1.toml"), "--log", at.x__mcap], 0),
        ("run", lambda at: [str(SCENARIOS / "both-ends.toml"), "--log", at.x__mcap, "--pace", "50"], 0),
        ("run", lambda at: [str(SCENARIOS / "reverse-fault.toml"), "--log", at.x__mcap], 0),
    ],
    "replay": [
        ("replay", lambda at: [at.ag__cfg, "--settings", str(MHO), "--log", at.x__mcap], 0),
        (
            "replay",
            lambda at: [at.ag__mcap, "--map", "relay=RB", "--settings", str(MHO), "--log", at.x__mcap],
            0,
        ),
    ],
    "channels": [("channels", lambda at: [at.ag__cfg], 0), ("channels", lambda at: [at.ag__mcap], 0)],
    "check": [
        ("check", lambda at: [str(SCENARIOS / "ag-zone1.toml")], 0),
        ("check", lambda at: [str(MHO)], 0),
        ("check", lambda at: [str(ROOT / "campaigns" / "position-and-sir.toml")], 0),
    ],
    "review": [("review", lambda at: [at.ag__mcap, "--png", at.x__png], 0)],
    "why": [
        ("why", lambda at: [at.ag__mcap], 0),
        ("why-at", lambda at: [at.ag__mcap, "--at", "12"], 0),
        ("why-at", lambda at: [at.ag__mcap, "--at", "-50"], 0),
    ],
    "locate": [("locate", lambda at: [at.ag__mcap] * 2 + ["--relay-a", "RA", "--relay-b", "RB"], 0)],
    "diff": [
        ("diff", lambda at: [at.ag__mcap, at.more__mcap], 3),
        ("diff", lambda at: [at.ag__mcap, at.ag__mcap], 0),
    ],
    "export": [("export", lambda at: [at.ag__mcap, "--csv", at.csv], 0)],
    "recover": [("recover", lambda at: [at.ag__mcap, at.whole__mcap], 0)],
    "import": [("import", lambda at: [at.ab__rio, "--z1", "3.2,31.5"], 0)],
    "monitor": [("monitor", lambda at: ["--can", "none:0", "--seconds", "0.3"], 0)],
    "suite": [("suite", lambda at: ["bus", "response-times", "--quick"], 0)],
    "campaign": [
        ("campaign-summary", lambda at: [at.three__toml, "--out", at.new__parquet, "--workers", "1"], 0)
    ],
    "campaign-report": [
        ("campaign-report", lambda at: [at.there__parquet, at.there__parquet, "--html", at.x__html], 0)
    ],
    "campaign-case": [("campaign-case", lambda at: [at.there__parquet, "1", "--log", at.x__mcap], 0)],
}
"""By command: the name of what it prints, its arguments, its exit status."""


def commands_with_json() -> list[str]:
    """All of the command line that have the option: a new one is among them."""
    commands = typer.main.get_command(app).commands  # pyright: ignore[reportAttributeAccessIssue]
    return [
        name for name, one in commands.items() if any("--json" in parameter.opts for parameter in one.params)
    ]


def test_everything_that_is_printed_has_a_schema_and_is_tried() -> None:
    assert set(commands_with_json()) == set(CALLS)
    tried = {name for calls in CALLS.values() for name, _, _ in calls}
    assert tried == set(PRINTED) == {kind.value for kind in Kind} - {"scenario", "relay", "campaign"}


@pytest.mark.parametrize(
    ("command", "number"),
    [(name, n) for name in commands_with_json() for n in range(len(CALLS.get(name, " ")))],
)
def test_json_is_as_its_schema_says(
    command: str,
    number: int,
    place: Place,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The model that the schema is made of takes it, and knows every key of it."""
    kind, words, status = CALLS[command][number]
    monkeypatch.setattr(monitor, "_link", lambda can: Fed())
    assert call([command, *words(place), "--json"]) == status
    printed = json.loads(capsys.readouterr().out)
    adapter: TypeAdapter[Any] = TypeAdapter(PRINTED[kind])
    taken = adapter.validate_json(json.dumps(printed), strict=True)
    assert _without_none(adapter.dump_python(taken, mode="json")) == _without_none(printed)


def _without_none(value: Any) -> Any:
    """Without the keys that are left out where there is nothing to say."""
    if isinstance(value, dict):
        return {key: _without_none(own) for key, own in value.items() if own is not None}
    return [_without_none(own) for own in value] if isinstance(value, list) else value
