"""A replayed record's own digital channels, beside what our relay did."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

import faultloop
from faultloop.cli import call
from faultloop.io.comtrade import read_comtrade
from faultloop.loop.replay import replay
from faultloop.review.facts import DigitalFacts
from faultloop.review.rows import relay_rows
from faultloop.review.summary import summarize
from faultloop.review.text import beside_rows, trips_beside
from faultloop.review.view import DIGITAL_ROWS, relay_view
from tests.review.review_logs import write_log

MAP = ",".join(
    f"{slot}={place}" for slot, place in zip(("va", "vb", "vc", "ia", "ib", "ic"), range(6), strict=True)
)


@pytest.fixture(scope="module")
def log(records: Path, root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A real breaker failure: trip 0.980, 52b 1.028, by the records' README."""
    path = tmp_path_factory.mktemp("log") / "bf.mcap"
    record = records / "breaker-failure-30kv" / "NOR-T2_osc1.cfg"
    replay(
        record,
        root / "scenarios" / "settings" / "ab-mho.toml",
        mapping=MAP,
        vt_ratio=300,
        ct_ratio=100,
        log=path,
    )
    return path


def test_events_and_spans(log: Path) -> None:
    opened = faultloop.open_log(log)
    assert len({entry.number for entry in opened.digital}) == 32
    summary = summarize(opened)
    told = [e for e in summary.events if e.source == "record"]
    assert len({e.text.rsplit(" ", 1)[0] for e in told}) == len(summary.digital) == 8
    assert [e.t_ns for e in summary.events] == sorted(e.t_ns for e in summary.events)
    assert any(0.97e9 < e.t_ns < 0.99e9 and e.text.endswith(" on") for e in told)
    for channel in summary.digital:
        assert all(off is None or on < off for on, off in channel.on_ms)


def test_they_are_exported(log: Path, tmp_path: Path) -> None:
    assert call(["export", str(log), "--comtrade", str(tmp_path / "x.cfg")]) == 0
    ours = {c.name: c.values for c in read_comtrade(tmp_path / "x.cfg").status if c.circuit == "record"}
    summary = summarize(faultloop.open_log(log))
    assert len(ours) >= len(summary.digital)
    for channel in summary.digital:
        assert ours[channel.name].any() and not ours[channel.name].all()


def test_a_log_with_a_gap_is_exported_with_its_times(shared: Path, tmp_path: Path) -> None:
    folder, log = shared / "cases" / "record-decimated", tmp_path / "d50.mcap"
    replay(folder / "d50.cfg", folder / "relay.toml", log=log)
    assert call(["export", str(log), "--comtrade", str(tmp_path / "x.cfg")]) == 0
    again, t_ns = read_comtrade(tmp_path / "x.cfg"), faultloop.open_log(log).samples("replay")["t_ns"]
    assert np.abs(again.t_ns - t_ns).max() < 1000
    result = replay(tmp_path / "x.cfg", folder / "relay.toml")
    assert [t.loop for t in result.trips] == ["AG"] and "values missing" not in result.warnings[0]


def test_the_timeline_and_the_pages(log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    opened = faultloop.open_log(log)
    view = relay_view(relay_rows(opened, "replay"), summarize(opened))
    rows = [row for row in view.timeline if any(bar.kind == "record" for bar in row.bars)]
    assert 0 < len(rows) <= DIGITAL_ROWS
    html, png = tmp_path / "r.html", tmp_path / "r.png"
    assert call(["review", str(log), "--html", str(html), "--png", str(png), "--json"]) == 0
    assert len(json.loads(capsys.readouterr().out)["digital"]) == 8
    assert rows[0].label in html.read_text(encoding="utf-8")
    assert png.stat().st_size > 10_000


def test_the_records_relay_stands_beside_ours(log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Trip at 0.980 s and breaker-failure trip at 1.140 s, by the records' README, on our time axis."""
    assert call(["review", str(log)]) == 0
    out = capsys.readouterr().out
    assert "The record's own relay beside this one [ms]" in out
    summary = summarize(faultloop.open_log(log))
    rows = beside_rows(summary)
    times = [float(row[0]) for row in rows if row[0]]
    assert times == sorted(times)
    zero_s = summary.inception.zero_ns / 1e9
    theirs = [float(row[0]) / 1e3 + zero_s for row in rows if row[1] and row[0]]
    for known_s in (0.980, 1.140):
        assert min(abs(t - known_s) for t in theirs) < 0.002
    assert sum(bool(row[1]) for row in rows) == 8
    trips = trips_beside(summary)
    assert {"IN1>2 Trip", "Bfail1 Trip 3ph"} <= {row[1] for row in trips if row[1]}


def test_ours_stand_between_theirs(tmp_path: Path) -> None:
    """A log whose times are known, and a record's channel that comes just after our start."""
    summary = summarize(faultloop.open_log(write_log(tmp_path / "known.mcap")))
    start = next(e for e in summary.relays["R1"].elements if e.name == "PDIS1.Str")
    channels = [DigitalFacts("trip", [(start.first_ms + 1.0, None)]), DigitalFacts("start", [(-5.0, 3.0)])]
    rows = beside_rows(dataclasses.replace(summary, digital=channels))
    assert rows[0] == ("-5.00", "start", "3.00", "")
    told = [row[1] or row[3] for row in rows]
    assert told.index("PDIS1 Str") < told.index("trip") < len(told)
    trips = [row[1] or row[3] for row in trips_beside(dataclasses.replace(summary, digital=channels))]
    assert {"trip", "PDIS1 Op"} <= set(trips) and not {"start", "PDIS1 Str"} & set(trips)
    assert beside_rows(summary) == []
