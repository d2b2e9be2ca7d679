"""A log that a thread of its own writes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import faultloop
from faultloop.errors import InputError
from faultloop.io.log_thread import LogThread
from faultloop.io.mcap_writer import LogWriter


@pytest.mark.parametrize("compress", [False, True])
def test_the_bytes_are_the_same(compress: bool, root: Path, tmp_path: Path) -> None:
    for name, beside in (("a.mcap", False), ("b.mcap", True)):
        faultloop.run(
            root / "scenarios" / "ag-zone1.toml", log=tmp_path / name, compress=compress, log_thread=beside
        )
    assert (tmp_path / "a.mcap").read_bytes() == (tmp_path / "b.mcap").read_bytes()


def test_what_the_thread_could_not_write_ends_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise InputError("cannot be written: No space left on device", file=tmp_path / "run.mcap")

    log = LogThread(LogWriter(tmp_path / "run.mcap", 0))
    log.add_relay("R1", [])
    monkeypatch.setattr(LogWriter, "relay_block", full)
    with pytest.raises(InputError, match="No space"):  # and the queue never stands full
        for _ in range(1000):
            log.relay_block("R1", np.zeros(1, np.int64))
    with pytest.raises(InputError, match="No space"):
        log.close()
    assert log.abort().exists()


def test_arrays_may_be_used_again_at_once(tmp_path: Path) -> None:
    log = LogThread(LogWriter(tmp_path / "run.mcap", 0))
    log.add_relay("R1", [])
    shapes = [(), (6,), (14,), (12,), (), ()]
    for n in range(50):
        arrays = [np.full((1, *shape), n, np.uint64 if shape == () else np.float64) for shape in shapes]
        t_ns = np.array([n * 1_000_000])
        log.relay_block("R1", t_ns, *arrays)
        for array in (t_ns, *arrays):
            array[:] = 99
    read = faultloop.open_log(log.close()).samples("R1")
    assert read["sample_count"].tolist() == read["va"].tolist() == list(range(50))
