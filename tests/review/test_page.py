"""The page of a log: what is in it is what the log has, and what it leaves out it says."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from faultloop.io.mcap_reader import open_log
from faultloop.io.mcap_writer import LogWriter
from faultloop.review import page, page_data
from faultloop.review.page_data import content
from faultloop.review.rows import relay_rows
from faultloop.review.summary import summarize
from tests.review.page_content import drawn, estimates
from tests.review.review_logs import BITS, DECIDED, FAULT_NS, START_NS, rows, write_log

LSB = 1 / 32767


@pytest.fixture(scope="module")
def known(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_log(tmp_path_factory.mktemp("page") / "known.mcap")


def test_page(known: Path, tmp_path: Path) -> None:
    log = open_log(known)
    page.write_html(log, summarize(log), tmp_path / "a.html")
    text = (tmp_path / "a.html").read_text(encoding="utf-8")
    assert not re.findall(
        r"""(?:src|href)\s*=\s*["']?https?:|@import|url\(\s*["']?https?:|fetch\(|XMLHttp""", text
    )
    for words in ("known", "PDIS1", "Faulted loop", "RFLO1 fault AG at 0.401", "MIT License", "Leon Sorokin"):
        assert words in text
    assert len(text) < 1e6
    record = re.search(r'<script id="record" type="application/json">(.*?)</script>', text, re.S)
    assert record is not None
    assert json.loads(record[1])["relays"][0]["name"] == "R1"


def test_every_sample_and_estimate_of_the_window_is_there(known: Path) -> None:
    log = open_log(known)
    summary = summarize(log)
    relay, own = content(log, summary)["relays"][0], relay_rows(log, "R1")
    ms, samples = drawn(relay)
    np.testing.assert_array_equal(ms, (own.t_ns - FAULT_NS) / 1e6)
    greatest = np.abs(own.samples).max(axis=0)
    assert (np.abs(samples - own.samples) <= 0.51 * LSB * greatest).all()
    np.testing.assert_allclose(estimates(relay, "phasors"), own.phasors, rtol=1e-6)
    np.testing.assert_allclose(estimates(relay, "impedances"), own.loops, rtol=1e-6)
    assert (relay["detail"], relay["step"], relay["stretch_ms"]) == ([0, len(own)], 1, 0.0)
    assert relay["reference_deg"] == pytest.approx(30.0)
    assert relay["ratios"] == (1000.0, 2000.0)
    label, bars = next(lane for lane in relay["lanes"] if lane[0] == "PDIS1")
    start = next(bar[0] for bar in bars if bar[2] == "operate")
    assert (label, start) == ("PDIS1", ms[DECIDED])


def long_log(path: Path, seconds: int) -> Path:
    """A fault at 0.1 s, and a spike of one sample far from it."""
    block = rows(4800 * seconds)
    block["samples"][4800 * seconds // 2, 1] = 5e6
    with LogWriter(path, START_NS) as log:
        log.add_relay("R1", BITS)
        log.relay_block("R1", *block.values())
        log.message("/plant/faults", FAULT_NS, "FaultState", fault=0, on=True, type="AG")
    return path


def test_outside_the_window_the_greatest_and_least_are_there(tmp_path: Path) -> None:
    log = open_log(long_log(tmp_path / "long.mcap", 20))
    relay, own = content(log, summarize(log))["relays"][0], relay_rows(log, "R1")
    ms, samples = drawn(relay)
    assert (np.diff(ms) > 0).all() and len(ms) < 12_000
    first, end = relay["detail"]
    inside = np.isin((own.t_ns - FAULT_NS) / 1e6, ms[first:end])
    assert inside.sum() == end - first > 1000
    # Each stretch of the overview has what its samples reach, the spike, too.
    t = (own.t_ns - FAULT_NS) / 1e6
    after = np.flatnonzero(t > ms[end - 1])
    for k in range(6):
        digit = LSB * np.abs(own.samples[:, k]).max()
        assert np.nanmax(samples[end:, k]) == pytest.approx(own.samples[after, k].max(), abs=digit)
        assert np.nanmin(samples[end:, k]) == pytest.approx(own.samples[after, k].min(), abs=digit)
    spike = ms[np.nanargmax(samples[:, 1])]
    assert abs(spike - t[4800 * 10]) <= relay["stretch_ms"]
    assert relay["stretch_ms"] == pytest.approx(20_000 / page_data.STRETCHES, rel=0.01)


def test_ten_seconds_of_two_relays_are_under_two_megabytes(tmp_path: Path) -> None:
    block = rows(48_000)
    with LogWriter(tmp_path / "two.mcap", START_NS) as log:
        for name in ("R1", "R2"):
            log.add_relay(name, BITS)
            log.relay_block(name, *block.values())
        log.message("/plant/faults", FAULT_NS, "FaultState", fault=0, on=True, type="AG")
        log.message("/plant/faults", 3_000_000_000, "FaultState", fault=0, on=False, type="AG")
    opened = open_log(tmp_path / "two.mcap")
    page.write_html(opened, summarize(opened), tmp_path / "two.html")
    text = (tmp_path / "two.html").read_text(encoding="utf-8")
    assert len(text) < 2e6
    assert "Shaded: least and greatest of each" in text


def test_what_is_no_number_stays_so(tmp_path: Path) -> None:
    log = open_log(write_log(tmp_path / "nan.mcap", nan=True))
    relay = content(log, summarize(log))["relays"][0]
    assert np.isnan(drawn(relay)[1]).all() and np.isnan(estimates(relay, "phasors")).all()
    page.write_html(log, summarize(log), tmp_path / "nan.html")
