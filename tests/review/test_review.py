"""The summary of a log whose every number is known."""

from __future__ import annotations

import json
import math
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from faultloop.cli import call
from faultloop.io.mcap_reader import open_log
from faultloop.io.mcap_writer import LogWriter
from faultloop.io.recover import recover_log
from faultloop.review.rows import relay_rows, spans_of
from faultloop.review.summary import line_impedance, summarize
from faultloop.review.text import print_review
from tests.review.review_logs import (
    BEFORE,
    BITS,
    DECIDED,
    FAULT,
    FAULT_NS,
    LOOP_OHM,
    OPENED_NS,
    RECEIVED_NS,
    START_NS,
    rows,
    times,
    write_log,
)


def summary_of(path: Path) -> dict[str, Any]:
    """Summarized, and strict JSON at that."""
    summary = summarize(open_log(path))
    assert json.loads(json.dumps(summary, allow_nan=False)) == summary
    return summary


def text_of(summary: dict[str, Any]) -> str:
    console = Console(width=200, record=True, file=StringIO())
    print_review(summary, console)
    return console.export_text()


@pytest.fixture(scope="module")
def known(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_log(tmp_path_factory.mktemp("review") / "known.mcap")


@pytest.fixture(scope="module")
def summary(known: Path) -> dict[str, Any]:
    return summary_of(known)


def test_times_are_the_logs_own(summary: dict[str, Any]) -> None:
    assert summary["inception"] == {
        "t_ns": FAULT_NS, "source": "plant", "text": "as the plant applied the fault",
    }  # fmt: skip
    (trip,) = summary["relays"]["R1"]["trips"]
    assert trip["decided_ns"] == times(DECIDED + 1)[-1]
    assert trip["sample_count"] == DECIDED
    assert trip["received_ns"] == RECEIVED_NS  # and not the other relay's command 50 us before
    assert trip["received_by"] == "breaker"
    assert trip["received_ms"] == (RECEIVED_NS - FAULT_NS) / 1e6
    assert trip["poles_opened_ns"] == dict(zip("ABC", OPENED_NS, strict=True))
    assert trip["opened_ns"] == max(OPENED_NS)
    assert (trip["function"], trip["loop"], trip["poles"], trip["breaker"]) == ("PDIS1", "AG", "ABC", "Q1")


def test_fault_as_applied(summary: dict[str, Any]) -> None:
    (fault,) = summary["faults"]
    assert (fault["on_ns"], fault["off_ns"], fault["type"]) == (FAULT_NS, 300_000_000, "AG")
    assert (fault["name"], fault["line"], fault["at_pu"], fault["resistance_ohm"]) == ("F1", "AB", 0.4, 1.0)


def test_phasors_against_va_before_the_fault(summary: dict[str, Any]) -> None:
    own = summary["relays"]["R1"]
    for key, wanted in (("prefault", BEFORE), ("fault", FAULT)):
        got = own[key]
        for channel, phasor in zip(("va", "vb", "vc", "ia", "ib", "ic"), wanted, strict=True):
            assert got[channel]["magnitude"] == pytest.approx(abs(phasor), rel=1e-12)
            turned = np.degrees(np.angle(phasor * np.exp(-1j * np.radians(30))))
            assert got[channel]["angle_deg"] == pytest.approx(turned, abs=1e-9)
    assert own["prefault"]["t_ns"] < FAULT_NS <= own["prefault"]["t_ns"] + 208_334
    assert FAULT_NS + 20_000_000 <= own["fault"]["t_ns"] < min(OPENED_NS)
    assert own["frequency_hz"] == {"prefault": 50.0, "fault": 50.0}


def test_loop_in_part_of_the_line(known: Path, summary: dict[str, Any]) -> None:
    loop = summary["relays"]["R1"]["loop"]
    assert (loop["loop"], loop["known_from"]) == ("AG", "trip")
    assert complex(loop["r_ohm"], loop["x_ohm"]) == LOOP_OHM
    assert loop["angle_deg"] == pytest.approx(math.degrees(math.atan2(16, 3.5)))
    # secondary settings: 20 ohm x 2000 / 1000
    assert line_impedance(open_log(known), "R1") == 6 + 40j
    assert loop["percent_of_line"] == pytest.approx(40.0)
    load = summary["relays"]["R1"]["load_ohm"]
    assert load["magnitude_ohm"] == pytest.approx(127e3 / 400)
    assert load["angle_deg"] == pytest.approx(10.0)


def test_peaks_elements_breaker_and_bus(summary: dict[str, Any]) -> None:
    own = summary["relays"]["R1"]
    assert own["peak_current"]["ia"]["instantaneous"] == 9000.0
    assert own["peak_current"]["ia"]["t_ns"] == times(601)[-1]
    assert own["peak_current"]["ia"]["rms"] == pytest.approx(4000)
    first = {element["name"]: element["first_ns"] for element in own["elements"]}
    t = times(1920)
    assert first == {
        "PDIS2.Str": t[540], "RDIR1.DirFwd": t[540], "PHS1.AG": t[540], "PDIS1.Str": t[560],
        "PTRC1.Str": t[560], "PDIS1.Op": t[DECIDED], "PTRC1.Tr": t[DECIDED],
    }  # fmt: skip
    assert all(element["last_off_ns"] == t[800] for element in own["elements"])
    assert own["location"] == "RFLO1 fault AG at 0.401 of the line"
    breaker = summary["breakers"]["Q1"]
    assert (breaker["initially_closed"], breaker["finally_closed"]) == ("ABC", "")
    assert [op["opened"] for op in breaker["operations"]] == ["", "", "A", "C", "B"]
    assert summary["can"] == {"frames": 3, "kinds": {"TRIP": 1, "HEARTBEAT": 1, "unknown": 1}}
    assert summary["warnings"] == []


def test_printed(summary: dict[str, Any]) -> None:
    text = text_of(summary)
    for words in (
        "known: 0.3998 s",
        "Fault F1 AG on AB at 40 %, 1 ohm",
        "[ms]",
        "20.84",
        "40.0 %",
        "3 CAN frames",
    ):
        assert words in text


def test_replay_estimates_the_inception(tmp_path: Path) -> None:
    """Without the plant's word: the first changed sample before the first pickup, and it says so."""
    summary = summary_of(write_log(tmp_path / "replay.mcap", truth=False, relay="replay"))
    t = times(1920)
    assert summary["inception"]["source"] == "samples"
    assert summary["inception"]["t_ns"] == t[np.searchsorted(t, FAULT_NS)]
    assert "estimated" in summary["inception"]["text"]
    own = summary["relays"]["replay"]
    assert own["trips"][0]["received_ns"] is None and own["trips"][0]["opened_ns"] is None
    assert own["loop"]["percent_of_line"] == pytest.approx(40.0)
    assert own["fault"]["ia"]["magnitude"] == pytest.approx(4000)
    assert own["prefault"]["ia"]["magnitude"] == pytest.approx(400)
    assert any("does not say when the fault began" in warning for warning in summary["warnings"])


def test_pickup_is_all_there_is(tmp_path: Path) -> None:
    """Steady samples from the first on: the pickup has to do; the text says that the fault was earlier."""
    path = tmp_path / "steady.mcap"
    with LogWriter(path, START_NS) as log:
        log.add_relay("R1", BITS)
        block = {name: array[540:1000] for name, array in rows(1920).items()}
        block["samples"] = np.sin(2 * np.pi * 50 * block["t_ns"] / 1e9)[:, None] * np.ones(6)
        log.relay_block("R1", *block.values())
    summary = summary_of(path)
    assert summary["inception"]["source"] == "pickup"
    assert summary["inception"]["t_ns"] == times(541)[-1]
    assert "began before it" in summary["inception"]["text"]


def test_evolving_fault_is_read_after_its_last_change(tmp_path: Path) -> None:
    path = tmp_path / "evolving.mcap"
    block = rows(1920)
    later = block["t_ns"] >= 200_000_000
    block["phasors"][later, 6] = 7777.0
    block["phasors"][later, 7] = 0.0
    with LogWriter(path, START_NS) as log:
        log.add_relay("R1", BITS)
        log.relay_block("R1", *block.values())
        for fault, t_ns in enumerate((50_000_000, 200_000_000)):
            log.message("/plant/faults", t_ns, "FaultState", fault=fault, on=True, type="AG")
    own = summary_of(path)["relays"]["R1"]
    assert own["fault"]["t_ns"] >= 220_000_000
    assert own["fault"]["ia"]["magnitude"] == pytest.approx(7777.0)


def test_no_relay(tmp_path: Path) -> None:
    path = tmp_path / "none.mcap"
    with LogWriter(path, START_NS) as log:
        log.message("/plant/faults", 5, "FaultState", fault=3, on=True, type="BC")
    summary = summary_of(path)
    assert summary["relays"] == {}
    assert "the log has no relay" in summary["warnings"]
    assert "no relay" in text_of(summary) and "No trip." in text_of(summary)


def test_relay_without_samples(tmp_path: Path) -> None:
    path = tmp_path / "empty.mcap"
    with LogWriter(path, START_NS) as log:
        log.add_relay("R1", BITS)
    assert "R1: no samples" in summary_of(path)["warnings"]


def test_nan_everywhere(tmp_path: Path) -> None:
    summary = summary_of(write_log(tmp_path / "nan.mcap", nan=True))
    own = summary["relays"]["R1"]
    assert own["prefault"] is None and own["fault"] is None and own["loop"] is None
    assert own["peak_current"]["ia"] is None
    assert "R1: va, vb, vc, ia, ib, ic: 1920 of 1920 samples are not numbers" in summary["warnings"]
    assert "R1: no phasor is a number" in summary["warnings"]
    text_of(summary)


def test_interrupted_early(tmp_path: Path) -> None:
    summary = summary_of(write_log(tmp_path / "short.mcap", n=300))
    assert summary["inception"]["t_ns"] is None
    assert any("ended early: 0.0622" in warning for warning in summary["warnings"])
    assert "No trip." in text_of(summary)


def test_recovered_log_says_so(tmp_path: Path, known: Path) -> None:
    broken = tmp_path / "broken.mcap"
    broken.write_bytes(known.read_bytes()[: known.stat().st_size * 2 // 3])
    recover_log(broken, tmp_path / "again.mcap")
    assert any("recovered" in warning for warning in summary_of(tmp_path / "again.mcap")["warnings"])


def test_topics_of_unequal_length_share_a_clock(tmp_path: Path, known: Path) -> None:
    """What a cut leaves: some topics one row longer; each row is at its own time, the missing one NaN."""

    class Cut:
        def __init__(self) -> None:
            self.whole = open_log(known)

        def array(self, topic: str) -> np.ndarray:
            rows = self.whole.array(topic)
            return rows[:-1] if topic.endswith("phasors") else rows

        def __getattr__(self, name: str) -> Any:
            return getattr(self.whole, name)

    found = relay_rows(Cut(), "R1")  # type: ignore[arg-type]
    assert len(found) == 1920
    assert np.isnan(found.phasors[-1]).all() and np.isfinite(found.phasors[-2]).all()
    assert np.isfinite(found.samples).all()


def test_spans() -> None:
    on = np.array([True, False, True, True, False, True])
    assert spans_of(on, np.arange(6) * 10) == [(0, 10), (20, 40), (50, None)]
    assert spans_of(np.zeros(0, bool), np.zeros(0, np.int64)) == []


def test_command_prints_strict_json(known: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert call(["review", str(known), "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["relays"]["R1"]["trips"][0]["received_ns"] == RECEIVED_NS
    assert printed["written"] == []
