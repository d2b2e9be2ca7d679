"""The summary of a log whose every number is known."""

from __future__ import annotations

import json
import math
from io import StringIO
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

import faultloop.review.summary as summary_module
from faultloop.cli import call
from faultloop.io.mcap_reader import Log, open_log
from faultloop.io.mcap_writer import LogWriter
from faultloop.io.recover import recover_log
from faultloop.review.facts import BusFacts, Frequency, Inception, Summary, as_json
from faultloop.review.relay_summary import line_impedance
from faultloop.review.rows import relay_rows, spans_of
from faultloop.review.summary import summarize
from faultloop.review.text import print_review, tables
from faultloop.review.view import fault_view, markers
from tests.review.review_logs import (
    BEFORE,
    BITS,
    DECIDED,
    FAULT,
    FAULT_NS,
    LOOP_OHM,
    OPENED_NS,
    RECEIVED_NS,
    SCENARIO,
    START_NS,
    check_tables,
    rows,
    times,
    write_log,
)


def summary_of(path: Path) -> Summary:
    """Summarized, and strict JSON at that."""
    summary = summarize(open_log(path))
    told = as_json(summary)
    assert json.loads(json.dumps(told, allow_nan=False)) == told
    return summary


def text_of(summary: Summary) -> str:
    console = Console(width=200, record=True, file=StringIO())
    print_review(summary, console)
    return console.export_text()


@pytest.fixture(scope="module")
def known(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_log(tmp_path_factory.mktemp("review") / "known.mcap")


@pytest.fixture(scope="module")
def summary(known: Path) -> Summary:
    return summary_of(known)


def test_times_are_the_logs_own(summary: Summary) -> None:
    assert summary.inception == Inception(FAULT_NS, "plant", "as the plant applied the fault")
    (trip,) = summary.relays["R1"].trips
    assert trip.decided_ns == times(DECIDED + 1)[-1]
    assert trip.sample_count == DECIDED
    assert trip.received_ns == RECEIVED_NS  # and not the other relay's command 50 us before
    assert trip.received_by == "breaker"
    assert trip.received_ms == (RECEIVED_NS - FAULT_NS) / 1e6
    assert trip.poles_opened_ns == dict(zip("ABC", OPENED_NS, strict=True))
    assert trip.opened_ns == max(OPENED_NS)
    assert (trip.function, trip.loop, trip.poles, trip.breaker) == ("PDIS1", "AG", "ABC", "Q1")


def test_fault_as_applied(summary: Summary) -> None:
    (fault,) = summary.faults
    assert (fault.on_ns, fault.off_ns, fault.type) == (FAULT_NS, 300_000_000, "AG")
    assert (fault.name, fault.line, fault.at_pu, fault.resistance_ohm) == ("F1", "AB", 0.4, 1.0)


def test_phasors_against_va_before_the_fault(summary: Summary) -> None:
    own = summary.relays["R1"]
    for key, wanted in (("prefault", BEFORE), ("fault", FAULT)):
        got = getattr(own, key)
        for channel, phasor in zip(("va", "vb", "vc", "ia", "ib", "ic"), wanted, strict=True):
            assert got[channel].magnitude == pytest.approx(abs(phasor), rel=1e-12)
            turned = np.degrees(np.angle(phasor * np.exp(-1j * np.radians(30))))
            assert got[channel].angle_deg == pytest.approx(turned, abs=1e-9)
    assert own.prefault.t_ns < FAULT_NS <= own.prefault.t_ns + 208_334
    assert FAULT_NS + 20_000_000 <= own.fault.t_ns < min(OPENED_NS)
    assert own.frequency_hz == Frequency(prefault=50.0, fault=50.0)


def test_loop_in_part_of_the_line(known: Path, summary: Summary) -> None:
    loop = summary.relays["R1"].loop
    assert (loop.loop, loop.known_from) == ("AG", "trip")
    assert complex(loop.r_ohm, loop.x_ohm) == LOOP_OHM
    assert loop.angle_deg == pytest.approx(math.degrees(math.atan2(16, 3.5)))
    # secondary settings: 20 ohm x 2000 / 1000
    assert line_impedance(open_log(known), "R1") == 6 + 40j
    assert loop.percent_of_line == pytest.approx(40.0)
    load = summary.relays["R1"].load_ohm
    assert load.magnitude_ohm == pytest.approx(127e3 / 400)
    assert load.angle_deg == pytest.approx(10.0)


def test_peaks_elements_breaker_and_bus(summary: Summary) -> None:
    own = summary.relays["R1"]
    assert own.peak_current["ia"].instantaneous == 9000.0
    assert own.peak_current["ia"].t_ns == times(601)[-1]
    assert own.peak_current["ia"].rms == pytest.approx(4000)
    first = {element.name: element.first_ns for element in own.elements}
    t = times(1920)
    assert first == {
        "PDIS2.Str": t[540], "RDIR1.DirFwd": t[540], "PHS1.AG": t[540], "PDIS1.Str": t[560],
        "PTRC1.Str": t[560], "PDIS1.Op": t[DECIDED], "PTRC1.Tr": t[DECIDED],
    }  # fmt: skip
    assert all(element.last_off_ns == t[800] for element in own.elements)
    assert own.location == "RFLO1 fault AG at 0.401 of the line"
    breaker = summary.breakers["Q1"]
    assert (breaker.initially_closed, breaker.finally_closed) == ("ABC", "")
    assert [op.opened for op in breaker.operations] == ["", "", "A", "C", "B"]
    assert summary.can == BusFacts(3, {"TRIP": 1, "HEARTBEAT": 1, "unknown": 1})
    assert summary.warnings == []


def test_printed(summary: Summary) -> None:
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


@pytest.mark.parametrize("relay", ["R1", "a relay of the " + "very " * 20 + "long name"])
def test_a_terminal_of_80_columns_loses_nothing(
    relay: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The shipped scenarios' logs: tests/golden."""
    monkeypatch.setenv("COLUMNS", "80")
    path = write_log(tmp_path / "x.mcap", relay=relay)
    capsys.readouterr()
    assert call(["review", str(path)]) == 0
    check_tables(capsys.readouterr().out, path)


def test_replay_estimates_the_inception(tmp_path: Path) -> None:
    """Without the plant's word: the first changed sample before the first pickup, and it says so."""
    summary = summary_of(write_log(tmp_path / "replay.mcap", truth=False, relay="replay"))
    t = times(1920)
    assert summary.inception.source == "samples"
    assert summary.inception.t_ns == t[np.searchsorted(t, FAULT_NS)]
    assert "estimated" in summary.inception.text
    own = summary.relays["replay"]
    assert own.trips[0].received_ns is None and own.trips[0].opened_ns is None
    assert own.loop.percent_of_line == pytest.approx(40.0)
    assert own.fault["ia"].magnitude == pytest.approx(4000)
    assert own.prefault["ia"].magnitude == pytest.approx(400)
    assert any("does not say when the fault began" in warning for warning in summary.warnings)


def test_pickup_is_all_there_is(tmp_path: Path) -> None:
    """Steady samples from the first on: the pickup has to do; the text says that the fault was earlier."""
    path = tmp_path / "steady.mcap"
    with LogWriter(path, START_NS) as log:
        log.add_relay("R1", BITS)
        block = {name: array[540:1000] for name, array in rows(1920).items()}
        block["samples"] = np.sin(2 * np.pi * 50 * block["t_ns"] / 1e9)[:, None] * np.ones(6)
        log.relay_block("R1", *block.values())
    summary = summary_of(path)
    assert summary.inception.source == "pickup"
    assert summary.inception.t_ns == times(541)[-1]
    assert "began before it" in summary.inception.text


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
    own = summary_of(path).relays["R1"]
    assert own.fault.t_ns >= 220_000_000
    assert own.fault["ia"].magnitude == pytest.approx(7777.0)


def test_no_relay(tmp_path: Path) -> None:
    path = tmp_path / "none.mcap"
    with LogWriter(path, START_NS) as log:
        log.message("/plant/faults", 5, "FaultState", fault=3, on=True, type="BC")
    summary = summary_of(path)
    assert summary.relays == {}
    assert "the log has no relay" in summary.warnings
    assert "no relay" in text_of(summary) and "No trip." in text_of(summary)


def test_relay_without_samples(tmp_path: Path) -> None:
    path = tmp_path / "empty.mcap"
    with LogWriter(path, START_NS) as log:
        log.add_relay("R1", BITS)
    assert "R1: no samples" in summary_of(path).warnings


def test_nan_everywhere(tmp_path: Path) -> None:
    summary = summary_of(write_log(tmp_path / "nan.mcap", nan=True))
    own = summary.relays["R1"]
    assert own.prefault is None and own.fault is None and own.loop is None
    assert own.peak_current["ia"] is None
    assert "R1: va, vb, vc, ia, ib, ic: no sample is a number" in summary.warnings
    assert "R1: no phasor is a number" in summary.warnings
    text_of(summary)


def test_interrupted_early(tmp_path: Path) -> None:
    summary = summary_of(write_log(tmp_path / "short.mcap", n=300))
    assert summary.inception.t_ns is None
    assert any("ended early: 0.0622" in warning for warning in summary.warnings)
    assert "No trip." in text_of(summary)


def test_recovered_log_says_so(tmp_path: Path, known: Path) -> None:
    broken = tmp_path / "broken.mcap"
    broken.write_bytes(known.read_bytes()[: known.stat().st_size * 2 // 3])
    recover_log(broken, tmp_path / "again.mcap")
    assert any("recovered" in warning for warning in summary_of(tmp_path / "again.mcap").warnings)


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


def test_two_faults_each_trip_answers_its_own(tmp_path: Path) -> None:
    """A second fault at 250 ms: its trip is counted from it, has its instant and its lane."""
    path, second_ns = tmp_path / "two.mcap", 250_000_000
    with LogWriter(path, START_NS, {"scenario": {"json": json.dumps(SCENARIO)}}) as log:
        log.add_relay("R1", BITS, {})
        log.relay_block("R1", *rows(1920).values())
        closed = {"pole_a": True, "pole_b": True, "pole_c": True}
        log.message("/breaker/Q1", 0, "BreakerStatus", **closed)
        for number, (on_ns, loop) in enumerate(((FAULT_NS, "AG"), (second_ns, "BC"))):
            log.message("/plant/faults", on_ns, "FaultState", fault=number, on=True, type=loop)
            trip = {"function": "PDIS1", "zone": 1, "loop": loop, "poles": 7, "sample_count": 0}
            log.message("/relay/R1/trips", on_ns + 20_000_000, "Trip", **trip)
            log.message("/breaker/Q1", on_ns + 21_000_000, "BreakerStatus", command="open", **closed)
    opened = open_log(path)
    summary = summarize(opened)
    first, second = summary.relays["R1"].trips
    assert (first.fault, second.fault) == ("F1", "1")  # the scenario knows of one
    assert first.after_fault_ms == second.after_fault_ms == 21.0
    assert second.received_ms == pytest.approx((second_ns + 21_000_000 - FAULT_NS) / 1e6)
    names = [name for _, name in markers(summary, "R1")]
    assert names == ["fault", "trip", "fault", "trip"]
    view = fault_view(opened, "R1", summary)
    lanes = [(bar.lane, bar.lanes) for bar in view.timeline[0].bars]
    assert lanes == [(0, 2), (1, 2)]
    (columns,) = [columns for title, columns, _ in tables(summary) if title.startswith("Trips")]
    assert "fault" in columns and ">after it" in columns


def test_a_start_that_came_earlier_is_not_dropped(tmp_path: Path) -> None:
    """On from before the inception into the fault: that is its start; one that was over is told of."""
    path, block = tmp_path / "x.mcap", rows(1920)
    block["pickup"][:] = 0
    for begin, end in ((100, 120), (470, 500), (560, 600)):  # over; into the fault; in it
        block["pickup"][begin:end] = 1
    with LogWriter(path, START_NS) as log:
        log.add_relay("R1", BITS, {})
        log.relay_block("R1", *block.values())
        log.message("/plant/faults", FAULT_NS, "FaultState", fault=0, on=True, type="AG")
    summary = summarize(open_log(path))
    (element,) = [e for e in summary.relays["R1"].elements if e.name == "PDIS1.Str"]
    assert element.first_ns == 470 * 10**9 // 4800 and element.times == 3
    assert element.earlier_ms == [pytest.approx((100 * 10**9 // 4800 - FAULT_NS) / 1e6)]


@pytest.mark.parametrize("windows", [1, 7, 40])
def test_a_long_log_is_summarized_as_in_one_piece(
    windows: int, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Read in stretches, the figures are those of the whole."""
    path = write_log(tmp_path / "x.mcap")
    whole = summarize(open_log(path))
    edges = [-(1 << 62), *(400_000_000 * k // windows for k in range(1, windows)), 1 << 62]
    monkeypatch.setattr(Log, "windows", lambda *_: list(pairwise(edges)))
    assert summarize(open_log(path)) == whole


def test_of_very_many_events_those_around_time_zero_are_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And a channel of a record that never rests is left out, by name; the log says both."""
    monkeypatch.setattr(summary_module, "MOST_EVENTS", 6)
    with LogWriter(tmp_path / "many.mcap", START_NS) as writer:
        for k in range(20):
            writer.message("/plant/events", 1000 * k, "foxglove.Log", level="INFO", message=f"event {k}")
            writer.message("/record/digital", 1000 * k, "RecordDigital", number=0, name="D0", on=bool(k % 2))
        writer.message("/plant/faults", 10_000, "FaultState", fault=0, on=True, type="AG")
        for on in (False, True):
            writer.message("/record/digital", 30_000, "RecordDigital", number=1, name="D1", on=on)
    log = open_log(tmp_path / "many.mcap")
    found = summarize(log)
    assert [e.text for e in found.events if e.source != "record"] == [f"event {k}" for k in range(7, 13)]
    assert [own.name for own in found.digital] == ["D1"]
    assert "of 20 events the 6 around time zero are shown" in found.warnings
    assert "of 20 changes of the record's channels the 6 around time zero are shown" in found.warnings
    assert "channels of the record that change more than 6 times are left out: D0" in found.warnings
