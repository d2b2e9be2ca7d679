"""`faultloop why`: of 20 trips and 20 that are none the cause that was set; its command, and bad logs."""

from __future__ import annotations

import json
import warnings
from pathlib import Path

import numpy as np
import pytest
from pydantic import TypeAdapter

import faultloop
from faultloop.cli import call
from faultloop.io.mcap_reader import open_log
from faultloop.io.mcap_writer import LogWriter
from faultloop.review import why_stages, why_zone
from faultloop.review.retrace import retrace
from faultloop.review.summary import summarize
from faultloop.review.why import CAUSES, Reason, why
from tests.review.why_cases import NETWORK, NO_TRIPS, TRIPS, Case, fault, write


def told(case: Case, folder: Path) -> Reason:
    log = open_log(write(folder / "case.mcap", dict(case.tables), case.samples, case.truth))
    assert retrace(log, "R1").differs is None, "the relay does not decide again what it decided"
    found = why(log, summarize(log), "R1", case.function)
    assert len(found) == 1
    return found[0]


QUICK = {
    *("ag", "zone 2", "residual", "emergency", "beyond", "behind", "quad, resistance", "too short", "load"),
    *("wrong type", "wakes in a fault", "residual current", "fast swing", "one fuse"),
}
CASES = [
    pytest.param(case, id=case.name, marks=[] if case.name in QUICK else pytest.mark.slow)
    for case in TRIPS + NO_TRIPS
]


def test_the_quick_cases_have_every_cause() -> None:
    causes = {case.cause for case in TRIPS + NO_TRIPS}
    assert {case.cause for case in TRIPS + NO_TRIPS if case.name in QUICK} == causes
    assert (len(TRIPS), len(NO_TRIPS), len(causes)) == (20, 20, 11)


@pytest.mark.parametrize("case", CASES)
def test_the_cause_is_the_one_that_was_set(case: Case, tmp_path: Path) -> None:
    reason = told(case, tmp_path)
    assert (reason.cause, reason.operated) == (case.cause, case.cause == "operated"), reason.text
    assert case.loop is None or reason.loop == case.loop, reason.text
    assert case.said in reason.text
    assert reason.cause in CAUSES


def test_the_command_prints_each_function_and_what_it_knew_at_an_instant(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = write(tmp_path / "beyond.mcap", {}, fault("BC", 0.95), "BC")
    assert call(["why", str(log)]) == 0
    out = capsys.readouterr().out
    assert "  PDIS2: B-C 0.73 of reach, polarized by V1 from before the fault; started " in out
    assert "  PDIS1: B-C 1.19 of reach, beyond its reach  [reach]\n" in out
    assert call(["why", str(log), "--function", "PDIS1", "--json"]) == 0
    (reason,) = json.loads(capsys.readouterr().out)
    TypeAdapter(list[Reason]).validate_python([reason])
    keys = ["relay", "function", "loop", "t_ns", "operated", "m", "timer_ms", "cause", "text"]
    assert list(reason) == keys
    assert (reason["cause"], reason["operated"]) == ("reach", False)
    assert reason["m"] == pytest.approx(0.95 / 0.8, rel=0.01)
    assert call(["why", str(log), "--at", "60", "--json"]) == 0
    (instant,) = json.loads(capsys.readouterr().out)
    assert (instant["type"], instant["direction"], instant["released"]) == ("BC", "forward", ["BC"])
    assert instant["polarizing_v"] == pytest.approx(abs(NETWORK.solve()[0]), rel=0.01)
    assert instant["zones"][1]["started"] and not instant["zones"][0]["started"]
    assert instant["zones"][0]["m"]["BC"] == pytest.approx(0.95 / 0.8, rel=0.01)
    assert call(["why", str(log), "--at", "-50"]) == 0
    assert "R1 at -50.00 ms: at rest: nothing changed, nothing blocked\n" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["--relay", "R2"], "--relay: there is no relay 'R2'; did you mean 'R1'?"),
        (
            ["--function", "PDIS7"],
            "--function: relay 'R1' has no function 'PDIS7' to tell of; did you mean 'PDIS2'?",
        ),
        (
            ["--at", "60", "--function", "PDIS7"],
            "--function: 'R1' has no zone 'PDIS7'; did you mean 'PDIS2'?",
        ),
        (["--at", "1e9"], "--at: the log of relay 'R1' goes from 0.00 to 83.12 ms"),
    ],
)
def test_a_name_that_is_not_there(
    options: list[str], told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = write(tmp_path / "x.mcap", {}, fault("BC", 0.95)[:400], None)
    assert call(["why", str(log), *options]) == 2
    assert capsys.readouterr().err == f"faultloop: {told}\n"


def test_a_log_with_too_little_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Of another tool, without settings; and one without the elements."""
    path = tmp_path / "x.mcap"
    with LogWriter(path, 0, {}) as log:
        log.add_relay("R1", ("PDIS1",), {})
        zeros = [np.zeros((10, n)) for n in (6, 14, 12)]
        log.relay_block("R1", np.arange(10) * 208_333, np.arange(10), *zeros, *np.zeros((2, 10), np.uint64))
    assert call(["why", str(path)]) == 2
    again = "a new run, or a new replay of the record, logs everything"
    what = "its settings of R1 are missing or not of this version (JSONDecodeError)"
    assert capsys.readouterr().err == f"faultloop: {path}: {what}; {again}\n"


def test_a_relay_that_decides_otherwise_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """As of a log of another version: the settings in it are not those that it was run with."""
    path = write(tmp_path / "a.mcap", {}, fault("BC", 0.7), "BC")
    data = path.read_bytes()
    assert data.count(b'"reach_pu":0.8') == 1
    path.write_bytes(data.replace(b'"reach_pu":0.8', b'"reach_pu":0.6'))
    assert call(["why", str(path)]) == 0
    err = capsys.readouterr().err
    assert "R1: run once more, this version's relay decides otherwise from " in err
    assert "(PDIS1): what is told is of this version; a new run, or" in err


def test_of_a_line_differential_what_the_ends_compared(root: Path, tmp_path: Path) -> None:
    """Its inputs from the other end are traced from the log's frames, and decide the same, bit by bit."""
    both = [f"relay.{name}.settings='settings/ab-differential.toml'" for name in ("RA", "RB")]
    late = ["channel.0.jitter_ms=0.5"]
    found: dict[str, Reason] = {}
    for name, overrides in (("line-differential", late), ("both-ends", both)):
        path = tmp_path / f"{name}.mcap"
        faultloop.run(root / "scenarios" / f"{name}.toml", log=path, overrides=overrides)
        log = open_log(path)
        assert {relay: retrace(log, relay).differs for relay in log.relays} == {"RA": None, "RB": None}
        found[name] = next(r for r in why(log, summarize(log), "RA") if r.function == "PDIF1")
    seen, outside = found["line-differential"], found["both-ends"]
    assert seen.operated and seen.m is not None
    # 127 kV over 300 ohm and what the network adds: 417 A in phase A, pickup 200 A
    assert 1.9 < seen.m < 2.3 and "in phase A" in seen.text
    assert not outside.operated and outside.cause == "pickup" and outside.m is not None and outside.m < 0.5


def test_a_log_of_a_single_sample(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = write(tmp_path / "one.mcap", {}, fault("BC", 0.7)[:1], None)
    assert call(["why", str(path)]) in (0, 2)
    assert "Traceback" not in capsys.readouterr().err


def test_of_no_sample_there_is_no_loop_to_tell_of(tmp_path: Path) -> None:
    log = open_log(write(tmp_path / "quiet.mcap", {}, fault("BC", 0.95)[:300], None))
    known = retrace(log, "R1")
    nothing = why_stages.Facts(log, known.instances[0], known, 0, np.zeros(0, np.int64), (0, 1), [])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        zone = why_zone.Zone(nothing, None)
        assert (zone.called, why_zone.judge_zone(zone).cause) == ("", "quiet")
