"""A run in a notebook; a log against a new run of itself; a compressed log."""

from __future__ import annotations

from pathlib import Path

import pytest

import faultloop
from faultloop.cli import call

ROOT = Path(__file__).resolve().parents[2]
AG = ROOT / "scenarios" / "ag-zone1.toml"
SCENARIOS = sorted((ROOT / "scenarios").glob("*.toml"))
Capture = pytest.CaptureFixture[str]


def test_a_log_is_that_of_a_new_run_of_it_and_a_compressed_one_too(tmp_path: Path, capsys: Capture) -> None:
    """With an override of a fault and of a setting, which the log notes."""
    log = tmp_path / "ag.mcap"
    changes = ["fault.F1.at_pu=0.6", "relay.RB.pdis.2.delay_ms=200"]
    result = faultloop.run(AG, log=log, overrides=changes, compress=True)
    assert call(["diff", str(log), "--again"]) == 0
    assert capsys.readouterr().out == "no difference\n"
    plain = tmp_path / "plain.mcap"
    faultloop.run(AG, log=plain, overrides=changes)
    assert log.stat().st_size < 0.9 * plain.stat().st_size
    assert call(["diff", str(log), str(plain)]) == 0
    told = repr(result)
    assert told.startswith("<Result A-G in zone 1: 0.4 s, RB PDIS1 AG poles ABC") and "ag.mcap" in told
    assert "<td>RB</td>" in result._repr_html_() and "held" in result._repr_html_()
    assert len(result.plot("RA").axes) == 2
    frame = faultloop.run(AG).to_pandas("RB")  # nothing was written
    assert frame.shape == (1920, 1 + 6 + 14 + 12 + len(frame.filter(regex=r"\.|^[A-Z]").columns))
    assert frame["PDIS1.Op"].any() and not frame["PDIS1.Op"].all()


@pytest.mark.slow
@pytest.mark.parametrize("scenario", SCENARIOS, ids=lambda path: path.stem)
def test_every_shipped_scenario_runs_again_as_it_did(scenario: Path, tmp_path: Path, capsys: Capture) -> None:
    log = tmp_path / "run.mcap"
    faultloop.run(scenario, log=log)
    assert call(["diff", str(log), "--again"]) == 0
    assert "no difference" in capsys.readouterr().out
