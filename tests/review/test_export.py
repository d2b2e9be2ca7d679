"""A log as COMTRADE: written in stretches, each relay at its own times."""

from __future__ import annotations

import tracemalloc
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from faultloop.errors import InputError
from faultloop.io.comtrade import read_comtrade
from faultloop.io.mcap_reader import Log, open_log
from faultloop.io.mcap_writer import LogWriter
from faultloop.review.export import log_to_comtrade
from tests.review.review_logs import BITS, START_NS, rows, write_log


def two_relays(path: Path, away: slice = slice(0, 0), n: int = 1920) -> Path:
    """R1 and R2 see the same; R2 is away for a while, as one that restarts."""
    with LogWriter(path, START_NS) as log:
        for name in ("R1", "R2"):
            log.add_relay(name, BITS)
        log.relay_block("R1", *rows(n).values())
        there = np.ones(n, bool)
        there[away] = False
        log.relay_block("R2", *(array[there] for array in rows(n).values()))
    return path


@pytest.mark.parametrize("format", ["ASCII", "BINARY", "FLOAT32"])
@pytest.mark.parametrize("windows", [7, 40])
def test_a_long_log_is_written_as_in_one_piece(
    windows: int, format: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    path = write_log(tmp_path / "x.mcap")
    whole = log_to_comtrade(open_log(path), tmp_path / "whole.cff", format=format)[0].read_bytes()
    edges = [-(1 << 62), *(400_000_000 * k // windows for k in range(1, windows)), 1 << 62]
    monkeypatch.setattr(Log, "windows", lambda *_: list(pairwise(edges)))
    pieces = log_to_comtrade(open_log(path), tmp_path / "pieces.cff", format=format)[0].read_bytes()
    assert pieces == whole and len(whole) > 1920 * 6


@pytest.mark.parametrize("away", [slice(700, 844), slice(0, 30), slice(1800, 1920)])
def test_a_relay_that_was_away_keeps_its_times(away: slice, tmp_path: Path) -> None:
    """Its values are missing there; none is moved to another time."""
    log = open_log(two_relays(tmp_path / "x.mcap", away))
    record = read_comtrade(log_to_comtrade(log, tmp_path / "x.cfg")[-1])
    assert len(record) == 1920
    values = {channel.name: channel.values for channel in record.analog}
    there = np.ones(1920, bool)
    there[away] = False
    assert np.isnan(values["R2 IA"][~there]).all() and np.isfinite(values["R1 IA"]).all()
    np.testing.assert_array_equal(values["R2 IA"][there], values["R1 IA"][there])
    states = {channel.name: channel.values for channel in record.status}
    np.testing.assert_array_equal(states["R2 PDIS1.Op"], states["R1 PDIS1.Op"] & there)


def test_only_one_relay_has_samples(tmp_path: Path) -> None:
    log = open_log(two_relays(tmp_path / "x.mcap", slice(0, 1920)))
    record = read_comtrade(log_to_comtrade(log, tmp_path / "x.cfg")[-1])
    assert len(record) == 1920 and np.isnan(record.analog[6].values).all()
    with pytest.raises(InputError, match="no sampled values"):
        log_to_comtrade(log, tmp_path / "y.cfg", relay="R2")
    assert not (tmp_path / "y.cfg").exists()


def test_a_wrong_name_is_refused_before_the_work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    log = open_log(write_log(tmp_path / "x.mcap", 300))
    monkeypatch.setattr(Log, "windows", lambda self: pytest.fail("the work has begun"))
    for target, options in (("x.txt", {}), ("x.cfg", {"format": "FLOAT"}), ("x.cfg", {"revision": "1991"})):
        with pytest.raises(InputError):
            log_to_comtrade(log, tmp_path / target, **options)


def test_memory_does_not_grow_with_the_log(tmp_path: Path) -> None:
    def peak(seconds: int) -> int:
        path = tmp_path / f"{seconds}.mcap"
        with LogWriter(path, START_NS) as log:
            log.add_relay("R1", BITS)
            block = rows(4800)
            for second in range(seconds):
                log.relay_block("R1", block["t_ns"] + second * 10**9, *list(block.values())[1:])
        opened = open_log(path)
        tracemalloc.start()
        log_to_comtrade(opened, tmp_path / "x.cfg")
        found = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return found

    short, long = peak(12), peak(36)  # some 28 and 85 MB of messages, in windows of 16
    assert long < 1.3 * short


def test_a_log_without_relays_is_one_line(tmp_path: Path) -> None:
    with LogWriter(tmp_path / "frames.mcap", START_NS):
        pass
    with pytest.raises(InputError, match="holds no sampled values to export"):
        log_to_comtrade(open_log(tmp_path / "frames.mcap"), tmp_path / "x.cfg")
