"""A log as the traffic of a process bus."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from faultloop.errors import InputError
from faultloop.io.can.frames import Frame, SampledValues, State, decode, ticks
from faultloop.io.can.table import Kind
from faultloop.io.iec61850.gateway import Gateway
from faultloop.io.mcap_reader import Log, open_log
from faultloop.io.mcap_writer import LogWriter
from faultloop.nodes.goose import Publisher
from faultloop.review.process_bus import log_to_pcap, station_of
from tests.review.review_logs import BITS, START_NS, rows

pytest.importorskip("open61850")

MS = 1_000_000
TABLES = {
    "scenario": {"name": "x"},
    "system": {"frequency_hz": 50, "sampling_hz": 4800},
    "relay": [{"name": "R1"}],
    "breaker": [{"name": "Q1"}],
    "can": {"heartbeat_s": 0.1},
    "iec61850": {"vlan_id": 3},
}


def fields(frame: Frame) -> dict[str, Any]:
    return {"id": frame.id, "data": frame.data, "direction": "tx"}


def a_log(path: Path, n: int = 1920) -> Log:
    metadata = {"scenario": {"json": json.dumps(TABLES)}}
    publisher = Publisher(Kind.TRIP, 0)
    with LogWriter(path, START_NS, metadata) as log:
        log.add_relay("R1", BITS)
        log.relay_block("R1", *rows(n).values())
        for t in range(400):
            publisher.set(7 * (t >= 200), t * MS)
            frame = publisher.poll(t * MS)
            if frame is not None:
                log.message("/can", t * MS + 250_000, "CanFrame", **fields(frame))
        nobodys = State(Kind.TRIP, 9, 0, 1, 0, 0, 0).encode()
        log.message("/can", 399 * MS, "CanFrame", **fields(nobodys))
    return open_log(path)


def test_frames_and_samples_of_a_log_come_back_from_the_file(tmp_path: Path) -> None:
    from open61850.pcap import read_pcap

    log = a_log(tmp_path / "x.mcap")
    (path,) = log_to_pcap(log, tmp_path / "x.pcap")
    station = station_of(log)
    assert (station.relays, station.breakers, station.options.vlan_id) == (("R1",), ("Q1",), 3)
    gateway = Gateway(station, start_ns=log.start_ns)
    frames = [(round(f.timestamp * 1e9) - log.start_ns, f.data) for f in read_pcap(path)]
    assert all(a <= b for (a, _), (b, _) in pairwise(frames))
    messages = [(t, decode(f)) for t, data in frames for f in gateway.decode(data, t)]
    assert not gateway.refused
    states = [(t, m.poles) for t, m in messages if isinstance(m, State) and m.sq_num == 0]
    assert [poles for _, poles in states] == [0, 7]
    assert states[1][0] == pytest.approx(200.25 * MS, abs=1000)
    assert [m.time for _, m in messages if isinstance(m, State) and m.sq_num == 0] == [0, ticks(200 * MS)]
    samples = [m for _, m in messages if isinstance(m, SampledValues)]
    own = log.samples("R1")
    assert [m.sample_count for m in samples] == own["sample_count"].tolist()
    got = np.array([m.values for m in samples])
    wanted = np.stack([own[c] for c in ("va", "vb", "vc", "ia", "ib", "ic")], axis=1)
    np.testing.assert_allclose(got[:, :3], wanted[:, :3], atol=0.0051)
    np.testing.assert_allclose(got[:, 3:], wanted[:, 3:], atol=0.00051)


def test_pieces_of_a_long_log_make_the_same_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    log = a_log(tmp_path / "x.mcap")
    whole = log_to_pcap(log, tmp_path / "whole.pcap")[0].read_bytes()
    edges = [-(1 << 62), *(400 * MS * k // 7 for k in range(1, 7)), 1 << 62]
    monkeypatch.setattr(Log, "windows", lambda *_: list(pairwise(edges)))
    assert log_to_pcap(log, tmp_path / "pieces.pcap")[0].read_bytes() == whole


def test_another_suffix_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"x\.txt.*\.pcap"):
        log_to_pcap(a_log(tmp_path / "x.mcap"), tmp_path / "x.txt")
