"""`why` of what answers others: pilot scheme, breaker failure, reclosing; and when a fault is over."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import faultloop
from faultloop.io.mcap_reader import open_log
from faultloop.review.summary import summarize
from faultloop.review.why import Reason, why
from tests.review.why_cases import FAULT_S, NETWORK, write

Told = dict[tuple[str, str], Reason]


def reasons(log: Path) -> Told:
    """By relay and function; of several of one function the first."""
    opened = open_log(log)
    found: Told = {}
    for reason in why(opened, summarize(opened)):
        found.setdefault((reason.relay, reason.function), reason)
    return found


def run(root: Path, name: str, folder: Path, *overrides: str) -> Told:
    log = folder / f"{name}.mcap"
    faultloop.run(root / "scenarios" / f"{name}.toml", log=log, overrides=list(overrides))
    return reasons(log)


def timer(reason: Reason) -> float:
    found = re.search(r"timer was at (\d+) of", reason.text)
    assert reason.cause == "timer" and found is not None, reason.text
    return float(found[1])


def test_a_breaker_that_fails_keeps_the_fault(root: Path, tmp_path: Path) -> None:
    """Pole A of QA stays closed until QX opens 40 ms after RBRF1's time of 150 ms: so long zone 2 runs."""
    told = run(root, "breaker-failure", tmp_path)
    failed = told["RA", "RBRF1"]
    assert (failed.cause, failed.operated) == ("operated", True)
    assert "current of pole A still flows" in failed.text and "(OpEx)" in failed.text
    assert 180 < timer(told["RA", "PDIS2"]) < 205
    cleared = told["RB", "RBRF1"]
    assert (cleared.cause, cleared.operated) == ("timer", False) and "the current was gone" in cleared.text
    assert timer(told["RB", "PDIS2"]) < 60


def test_a_scheme_that_waits_for_a_signal_says_so(root: Path, tmp_path: Path) -> None:
    told = run(root, "pott", tmp_path, "channel.0.loss=1.0")
    assert told["RA", "PSCH1"].cause == "no-signal" and "nothing was received" in told["RA", "PSCH1"].text
    # RB has opened after 53 ms, and RA's breaker not before the log's end
    assert timer(told["RA", "PDIS4"]) > 360


def test_a_scheme_that_trips_says_what_came_together(root: Path, tmp_path: Path) -> None:
    told = run(root, "pott", tmp_path)
    assert told["RA", "PSCH1"].operated
    assert re.search(r"sent from \d+\.\d ms, received from 18\.\d ms; operated 22", told["RA", "PSCH1"].text)
    assert "the trip was another's" in told["RB", "PSCH1"].text


def test_of_reclosing_each_step(root: Path, tmp_path: Path) -> None:
    """A fault that is gone, and one that stays: closed onto it, tripped, locked out."""
    gone = run(root, "reclosing", tmp_path)["RA", "RREC1"]
    assert gone.operated and "Op close poles ABC" in gone.text and "Lockout" not in gone.text
    stays = [f"fault.F{n}.duration_s=9" for n in (1, 2)]
    stayed = run(root, "reclosing", tmp_path, *stays)["RA", "RREC1"]
    assert stayed.operated and "Lockout: that was the last shot" in stayed.text


def test_a_trip_before_the_fault(root: Path, tmp_path: Path) -> None:
    """In a swing at 2 Hz overfrequency trips long before the fault: with its own start, time, measure."""
    settings = (root / "scenarios/settings/ab-mho.toml").read_text()
    (tmp_path / "settings").mkdir()
    (tmp_path / "settings/ab-mho.toml").write_text(f"{settings}\n[[ptof]]\nstart_hz = 50.5\ndelay_ms = 100\n")
    scenario = (root / "scenarios/ag-zone1.toml").read_text().replace("after_s = 0.1", "after_s = 0.7")
    scenario = scenario.replace("duration_s = 0.4", "duration_s = 0.9")
    swing = '\n[[swing]]\nsource = "SA"\nat_s = [0.1, 0.8]\nangle_deg = [0, 504]\n'
    (tmp_path / "a.toml").write_text(scenario + swing)
    faultloop.run(tmp_path / "a.toml", log=tmp_path / "a.mcap")
    reason = reasons(tmp_path / "a.mcap")["RA", "PTOF1"]
    assert reason.operated and reason.m is not None and 1.0 < reason.m < 1.06  # 2 Hz more, of 50.5
    assert reason.timer_ms == pytest.approx(100, abs=0.5)
    assert "after 100.0 ms" in reason.text


def test_of_a_record_the_time_after_the_fault_does_not_count(tmp_path: Path) -> None:
    """The record's own breaker opens, and the line's voltage is gone for longer than the fault was there."""
    zones = [{"zone": 1, "reach_pu": 0.8}, {"zone": 2, "reach_pu": 1.3, "delay_ms": 1000.0}]
    stages = [(0.0, NETWORK.solve()), (FAULT_S, NETWORK.solve("AG", 0.95))]
    stages.append((FAULT_S + 0.1, np.zeros(6, complex)))
    log = write(tmp_path / "record.mcap", {"pdis": zones}, NETWORK.samples(stages, 0.8), None)
    told = reasons(log)
    assert told["R1", "PDIS1"].cause == "reach"
    assert told["R1", "PDIS1"].m == pytest.approx(0.95 / 0.8, abs=0.02)
    assert timer(told["R1", "PDIS2"]) < 110


def test_of_a_stage_its_quantity_and_its_time(tmp_path: Path) -> None:
    """3I0 and what an inverse curve takes at it; a rate of the frequency that none reaches."""
    stages = [
        {"quantity": "residual", "pickup_a": 200.0, "curve": "iec-normal-inverse", "time_multiplier": 0.5}
    ]
    during = NETWORK.solve("AG", 0.5)
    samples = NETWORK.samples([(0.0, NETWORK.solve()), (FAULT_S, during), (0.4, NETWORK.solve())], 0.5)
    tables = {"ptoc": stages, "pfrc": [{"start_hz_per_s": 19.0}]}
    told = reasons(write(tmp_path / "a.mcap", tables, samples, "AG"))
    m = abs(during[3:].sum()) / 200
    ptoc = told["R1", "PTOC1"]
    assert ptoc.cause == "timer" and ptoc.m == pytest.approx(m, rel=0.02)
    found = re.search(r"3I0 (.*) kA, .* its time, (\d+) ms at this current", ptoc.text)
    assert found is not None
    assert float(found[1]) == pytest.approx(abs(during[3:].sum()) / 1e3, rel=0.02)
    assert float(found[2]) == pytest.approx(0.5 * 0.14 / (m**0.02 - 1) * 1e3, rel=0.02)
    assert told["R1", "PFRC1"].cause == "pickup" and "Hz/s, set to 19.00 Hz/s" in told["R1", "PFRC1"].text
