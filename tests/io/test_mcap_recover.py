"""Recovery of logs that were cut off, by a kill and at any byte."""

from __future__ import annotations

import random
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from faultloop.errors import InputError
from faultloop.io.mcap_reader import Log, open_log
from faultloop.io.mcap_writer import LogWriter
from faultloop.io.recover import recover_log

START_NS = 1_577_836_800_000_000_000
LOSS_NS = 250_000_000  # the contract

WRITE_FOREVER = """
import sys
import numpy as np
from faultloop.io.mcap_writer import LogWriter
log = LogWriter(sys.argv[1], 0, compression=sys.argv[2])
log.add_relay("R1", ["PDIS1"])
log.add_relay("R2", ["PDIS1"])
block, first = 48, 0
while True:
    count = np.arange(first, first + block)
    t_ns = count * 1_000_000_000 // 4800
    rows = [np.random.default_rng(first).normal(size=(block, width)) for width in (6, 14, 12)]
    bits = np.zeros(block, np.uint64)
    for name in ("R1", "R2"):
        log.relay_block(name, t_ns, count, *rows, bits, bits)
    log.message("/can", int(t_ns[-1]), "CanFrame", id=first)
    print(t_ns[-1], flush=True)
    first += block
"""


def accepted(path: Path) -> Log:
    """A recovered log, after mcap's own reader has read all of it with checksums."""
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        assert reader.get_summary() is not None
        count = sum(1 for _ in reader.iter_decoded_messages())
    log = open_log(path)
    assert sum(len(log.array(topic)) for topic in log.topics) == count
    return log


@pytest.mark.parametrize(("seed", "compression"), [(1, ""), (2, "lz4"), (3, "zstd")])
def test_killed_run_loses_at_most_a_quarter_second(seed: int, compression: str, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    command = [sys.executable, "-c", WRITE_FOREVER, str(path), compression]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        for _ in range(random.Random(seed).randrange(1, 400)):
            last = int(process.stdout.readline())
        process.kill()  # SIGKILL
        for line in process.stdout:
            last = int(line) if line.endswith("\n") else last
    assert not path.exists()
    result = recover_log(path, tmp_path / "out.mcap")
    assert result.source == tmp_path / "run.mcap.part"
    log = accepted(tmp_path / "out.mcap")
    for relay in ("R1", "R2"):
        t_ns = log.samples(relay)["t_ns"] if relay in log.relays else [-1]
        assert t_ns[-1] >= last - LOSS_NS
        assert len(t_ns) == 0 or t_ns[-1] == (len(t_ns) - 1) * 10**9 // 4800  # and none is missing before it
    assert result.last_t_ns is None or result.last_t_ns >= last - LOSS_NS


def test_what_is_on_disk_is_never_older_than_a_quarter_second(
    make_arrays: Callable[..., Any], tmp_path: Path
) -> None:
    """After every block, even when one of the relays has fallen silent."""
    arrays = make_arrays(4000)
    log = LogWriter(tmp_path / "run.mcap", START_NS)
    for name in ("R1", "R2"):
        log.add_relay(name, [])
    for start in range(0, 4000, 100):
        block = [array[start : start + 100] for array in arrays]
        log.relay_block("R1", *block)
        if start < 1000:
            log.relay_block("R2", *block)
        last = int(block[0][-1])
        if last > LOSS_NS and start % 300 == 0:
            result = recover_log(tmp_path / "run.mcap", tmp_path / "out.mcap")
            assert result.last_t_ns is not None
            assert result.last_t_ns >= last - LOSS_NS
    log.close()


@pytest.mark.parametrize("compression", ["", "lz4", "zstd"])
def test_whole_log_comes_out_as_the_same_bytes(
    compression: str, make_log: Callable[..., Path], tmp_path: Path
) -> None:
    path = make_log(tmp_path / "run.mcap", rows=2000, compression=compression)
    result = recover_log(path, tmp_path / "out.mcap")
    assert result.whole and not result.cut_bytes and not result.damaged
    assert result.messages.total() == 2000 * 8 + 7
    assert (tmp_path / "out.mcap").read_bytes() == path.read_bytes()


@pytest.fixture(scope="module", params=["", "lz4", "zstd"])
def small_log(
    request: pytest.FixtureRequest, make_log: Callable[..., Path], tmp_path_factory: pytest.TempPathFactory
) -> Path:
    return make_log(tmp_path_factory.mktemp("small") / "x.mcap", rows=40, compression=request.param)


def check_any_bytes(data: bytes, folder: str) -> tuple[int, Path] | None:
    """Whatever the bytes: open_log gives a log or InputError, recover a log or InputError.

    Returns how many messages recover says it wrote, and where; None if it refused.
    """
    cut, out = Path(folder, "cut.mcap"), Path(folder, "out.mcap")
    cut.write_bytes(data)
    try:
        log = open_log(cut)
        for topic in log.topics:
            log.array(topic)
        del log
    except InputError:
        pass
    try:
        return recover_log(cut, out).messages.total(), out
    except InputError:
        assert not out.exists()
        return None


def check_sound(data: bytes) -> None:
    """As above, and mcap's own reader finds every message of the recovered log, with checksums."""
    with tempfile.TemporaryDirectory() as folder:
        found = check_any_bytes(data, folder)
        if found is not None:
            with found[1].open("rb") as stream:
                assert found[0] == sum(1 for _ in make_reader(stream, validate_crcs=True).iter_messages())


@given(data=st.data())
@settings(max_examples=60, deadline=None, derandomize=True)
def test_cut_at_any_byte(small_log: Path, data: st.DataObject) -> None:
    whole = small_log.read_bytes()
    check_sound(whole[: data.draw(st.integers(0, len(whole)))])


def damage(whole: bytes, data: st.DataObject) -> bytes:
    """One byte changed; in half of the cases near the start, where the structure is."""
    where = data.draw(st.one_of(st.integers(0, 600), st.integers(0, len(whole) - 1)))
    return whole[:where] + bytes([data.draw(st.integers(0, 255))]) + whole[where + 1 :]


@given(data=st.data())
@settings(max_examples=60, deadline=None, derandomize=True)
def test_any_changed_byte(small_log: Path, data: st.DataObject) -> None:
    check_sound(damage(small_log.read_bytes(), data))


@given(data=st.data())
@settings(max_examples=60, deadline=None, derandomize=True)
def test_any_damage(small_log: Path, data: st.DataObject) -> None:
    """Several wrong bytes: what no checksum covers any more may be kept, but nothing breaks."""
    damaged = small_log.read_bytes()
    for _ in range(data.draw(st.integers(2, 5))):
        damaged = damage(damaged, data)
    with tempfile.TemporaryDirectory() as folder:
        check_any_bytes(damaged, folder)


def test_cut_chunk_gives_its_whole_messages(make_log: Callable[..., Path], tmp_path: Path) -> None:
    path = make_log(tmp_path / "run.mcap", rows=900)  # one chunk of R1's rows, then R2's
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(path.read_bytes()[:300_000])
    recover_log(cut, tmp_path / "out.mcap")
    log, whole = accepted(tmp_path / "out.mcap"), open_log(path)
    rows = len(log.samples("R1"))
    assert 580 < rows < 610  # 495 bytes each
    assert log.samples("R1").tobytes() == whole.samples("R1")[:rows].tobytes()
    assert log.metadata["recovered"]["damaged_records"] == "0"


def test_inputs_that_are_refused(log_path: Path, tmp_path: Path) -> None:
    (tmp_path / "text.mcap").write_text("hello, no log at all", encoding="utf-8")
    (tmp_path / "empty.mcap").write_bytes(b"")
    out = tmp_path / "out.mcap"
    for name, says in (("text", "not an MCAP"), ("empty", "is empty"), ("none", "no such file")):
        with pytest.raises(InputError, match=says):
            recover_log(tmp_path / f"{name}.mcap", out)
    with pytest.raises(InputError, match="another output"):
        recover_log(log_path, log_path)
    with pytest.raises(InputError, match="cannot be written"):
        recover_log(log_path, tmp_path / "no folder" / "out.mcap")
    assert [path.name for path in tmp_path.iterdir() if "out" in path.name] == []


def test_part_of_a_killed_run_is_recovered_in_place(log_path: Path, tmp_path: Path) -> None:
    (tmp_path / "run.mcap.part").write_bytes(log_path.read_bytes()[:-100])
    result = recover_log(tmp_path / "run.mcap", tmp_path / "run.mcap")
    assert result.source.name == "run.mcap.part"
    assert "run.mcap.part" in str(result)
    accepted(tmp_path / "run.mcap")
