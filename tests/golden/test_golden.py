"""Every shipped scenario still runs as it did: its outcome exactly, its messages by digest, numbers to 1e-9.

``pytest tests/golden --renew-golden`` writes the files anew and prints what changed (as warnings, which
parallel workers show too); a renewal is committed with what made it necessary, and the difference is told.
"""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from typing import Any

import pytest

from faultloop import open_log
from faultloop.cli import call
from faultloop.loop.runner import run
from faultloop.loop.scenario import load_scenario
from faultloop.review.retrace import retrace
from faultloop.review.summary import summarize
from faultloop.review.why import why
from tests.golden.record import differences, golden
from tests.review.review_logs import check_tables

HERE = Path(__file__).parent
SCENARIOS = sorted((HERE.parents[1] / "scenarios").glob("*.toml"))


@pytest.mark.parametrize("path", SCENARIOS, ids=lambda path: path.stem)
def test_runs_as_it_did(
    path: Path,
    tmp_path: Path,
    request: pytest.FixtureRequest,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    log = tmp_path / "run.mcap"
    result = run(path, log=log)
    now = golden(result, open_log(log))
    kept = HERE / f"{path.stem}.json"
    if request.config.getoption("--renew-golden"):
        before: dict[str, Any] = json.loads(kept.read_text()) if kept.exists() else {}
        for line in differences(before, now):
            warnings.warn(f"{path.stem}: {line}", stacklevel=1)
        kept.write_text(json.dumps(now, indent=1, ensure_ascii=False) + "\n")
        return
    assert kept.exists(), f"no golden log of {path.name}: pytest tests/golden --renew-golden"
    assert differences(json.loads(kept.read_text()), now) == []
    monkeypatch.setenv("COLUMNS", "80")
    capsys.readouterr()
    assert call(["review", str(log)]) == 0
    check_tables(capsys.readouterr().out, log)
    opened = open_log(log)  # and each relay, run over its log once more, decides the same, bit by bit
    names = [place.name for place in load_scenario(path).relay]
    assert {name: retrace(opened, name).differs for name in names} == dict.fromkeys(names)
    summary = summarize(opened)  # and each trip is explained
    told = [(r.relay, r.function) for r in why(opened, summary) if "; tripped" in r.text]
    assert sorted(told) == sorted((name, t.function) for name in names for t in summary.relays[name].trips)


def test_no_golden_log_without_its_scenario() -> None:
    assert {file.stem for file in HERE.glob("*.json")} == {path.stem for path in SCENARIOS}


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda g: g["outcome"]["trips"][0].update(received_ns=1), "outcome.trips[0].received_ns"),
        (lambda g: g["messages"].pop("/can"), "messages./can"),
        (lambda g: g["rows"]["RA"]["samples"][3].__setitem__(2, 1.0), "rows.RA.samples[3][2]"),
    ],
)
def test_a_difference_is_found_and_named(change: Any, told: str) -> None:
    kept = json.loads((HERE / "ag-zone1.json").read_text())
    changed = json.loads(json.dumps(kept))
    change(changed)
    (line,) = differences(kept, changed)
    assert line.startswith(told)
