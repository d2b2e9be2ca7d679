"""A log that version 0.1.0 wrote is still reviewed, compared and exported.

`data/v0.1.0.mcap` is `scenarios/ag-zone1.toml` cut to 60 ms at 2400 samples per second, with breakers of
12 ms, in zstd chunks; `data/v0.1.0.review.json` is what `review --json` of that version said of it.  A review
may say more, or another text: it may not say another figure.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from faultloop.cli import app
from faultloop.io.mcap_reader import open_log
from faultloop.io.recover import recover_log

DATA = Path(__file__).parent / "data"
LOG = DATA / "v0.1.0.mcap"


def command(*arguments: object) -> str:
    result = CliRunner().invoke(app, [str(argument) for argument in arguments], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.stdout


def told_otherwise(was: Any, now: Any, at: str = "") -> list[str]:
    """Where `now` lacks or contradicts what `was` has."""
    if isinstance(was, dict) and isinstance(now, dict):
        return [
            line
            for key in was
            for line in (told_otherwise(was[key], now[key], f"{at}.{key}") if key in now else [f"{at}.{key}"])
        ]
    if isinstance(was, list) and isinstance(now, list):
        pairs = enumerate(zip(was, now, strict=False))
        length = [] if len(was) == len(now) else [f"{at}: {len(was)} -> {len(now)}"]
        return length + [line for i, (a, b) in pairs for line in told_otherwise(a, b, f"{at}[{i}]")]
    if isinstance(was, float) and isinstance(now, (int, float)):
        return [] if math.isclose(was, now, rel_tol=1e-9, abs_tol=1e-12) else [f"{at}: {was} -> {now}"]
    return [] if was == now else [f"{at}: {was} -> {now}"]


def test_it_is_reviewed() -> None:
    was = json.loads((DATA / "v0.1.0.review.json").read_text(encoding="utf-8"))
    was["log"].pop("path")
    now = json.loads(command("review", LOG, "--json"))
    assert told_otherwise(was, now) == []
    assert "PDIS1" in command("review", LOG)


def test_it_equals_itself_after_a_recovery(tmp_path: Path) -> None:
    assert recover_log(LOG, tmp_path / "again.mcap").whole
    assert json.loads(command("diff", LOG, tmp_path / "again.mcap", "--json"))["equal"]


@pytest.mark.parametrize(
    ("option", "target", "files"),
    [
        ("--comtrade", "x.cfg", 2),
        ("--parquet", "tables", 19),
        ("--csv", "tables", 19),
        ("--can", "x.asc", 1),
        ("--can", "x.log", 1),
    ],
)
def test_it_is_exported(option: str, target: str, files: int, tmp_path: Path) -> None:
    written = json.loads(command("export", LOG, option, tmp_path / target, "--json"))["written"]
    assert len(written) == files
    assert all(Path(path).stat().st_size for path in written)


def test_it_is_drawn(tmp_path: Path) -> None:
    command("review", LOG, "--html", tmp_path / "x.html", "--png", tmp_path / "x.png")
    assert (tmp_path / "x.png").stat().st_size > 10_000


def test_its_arrays() -> None:
    log = open_log(LOG)
    assert (log.relays, log.breakers) == (("RA", "RB"), ("QA", "QB"))
    for relay in log.relays:
        for rows in (log.samples(relay), log.phasors(relay), log.loops(relay), log.elements(relay)):
            assert len(rows) == 144
    assert [(t.source, t.function, t.loop, t.t_ns) for t in log.trips] == [
        ("RA", "PDIS1", "AG", 30_416_666),
        ("RB", "PDIS1", "AG", 30_416_666),
    ]
