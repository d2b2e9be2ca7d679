"""One byte of a log is changed: nothing breaks, and no topic goes away in silence."""

from __future__ import annotations

import json
import random
import struct
import tracemalloc
import zlib
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import lz4.frame
import numpy as np
import pytest
import zstandard
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.writer import CompressionType
from mcap_protobuf.decoder import DecoderFactory

from faultloop.cli import call
from faultloop.errors import InputError
from faultloop.io.diff import diff_logs
from faultloop.io.mcap_file import LOG_RECORD, ChunkHead, walk
from faultloop.io.mcap_reader import Log, open_log
from faultloop.io.mcap_writer import LogWriter
from faultloop.io.messages import message_of
from faultloop.io.recover import recover_log
from faultloop.io.tables import topic_table
from faultloop.review.export import log_to_can, log_to_comtrade
from faultloop.review.summary import summarize
from tests.io.test_mcap_log import rewrite
from tests.review.review_logs import write_log as write_known

KINDS = ("plain", "zstd", "lz4", "part", "foreign", "foreign without chunks")


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], bytes]:
    """A small log of each kind; every topic has messages in it."""
    folder = tmp_path_factory.mktemp("kinds")
    return cache(lambda kind: log_of(kind, folder))


def log_of(kind: str, folder: Path) -> bytes:
    path = folder / f"{kind}.mcap"
    if kind.startswith("foreign"):
        ours = write_known(folder / "ours.mcap", 720)
        rewrite(ours, path, CompressionType.LZ4, use_chunking=kind == "foreign")
        return path.read_bytes()
    copy_log(open_log(write_known(folder / "ours.mcap", 720)), path, kind if kind in ("zstd", "lz4") else "")
    data = path.read_bytes()
    if kind != "part":
        return data
    *_, last = (record for record in walk(data, 8) if record.opcode == Opcode.CHUNK)
    return data[: (last.start + last.stop) // 2]  # cut in the midst of a chunk


def copy_log(log: Log, path: Path, compression: str) -> None:
    metadata = {name: values for name, values in log.metadata.items() if name != LOG_RECORD}
    with LogWriter(path, log.start_ns, metadata, log.attachments, compression) as out:
        for relay in log.relays:
            bits = log.bits(relay)["pickup"]
            out.add_relay(relay, [name.removesuffix(".Str") for name in bits], log.characteristics(relay))
            arrays = [log.samples(relay), log.phasors(relay), log.loops(relay), log.elements(relay)]
            plain = [
                np.array([list(row)[skip:] for row in rows.tolist()])
                for rows, skip in zip(arrays[:3], (2, 1, 1), strict=True)
            ]
            words = arrays[3]
            out.relay_block(
                relay, arrays[0]["t_ns"], arrays[0]["sample_count"], *plain, words["pickup"], words["operate"]
            )
        for topic in log.topics:
            message = message_of(topic)
            assert message is not None
            if not message.every_sample:
                names = [field.name for field in message.fields]
                for t_ns, *row in log.array(topic).tolist():
                    out.message(topic, t_ns, message.name, **dict(zip(names, row, strict=True)))


def changed(data: bytes, seed: int) -> bytes:
    """One byte is another one: anywhere, or (two of three) where no message lies, at any bit or value."""
    dice = random.Random(seed)
    at = dice.randrange(len(data))
    if seed % 3 == 1:
        at = dice.randrange(min(len(data), 6000))
    elif seed % 3 == 2:
        at = len(data) - 1 - dice.randrange(min(len(data), 6000))
    new = data[at] ^ (1 << dice.randrange(8)) if seed % 2 else dice.randrange(256)
    return data[:at] + bytes([new]) + data[at + 1 :]


def topics_with_messages(log: Log) -> set[str]:
    return {topic for topic in log.topics if len(log.array(topic))}


def read_everything(log: Log, whole: Log, folder: Path) -> set[str]:
    """What review, diff and export do; the topics that have messages."""
    found = topics_with_messages(log)
    summarize(log)
    diff_logs(log, whole)
    for topic in found:
        topic_table(log, topic)
    with suppress(InputError):  # such as a topic of another kind in the place of the samples
        log_to_comtrade(log, folder / "x.cfg")
    log_to_can(log, folder / "x.log")
    return found


def check(data: bytes, kind: str, whole: Log, everything: set[str], folder: Path) -> None:
    path, out = folder / "damaged.mcap", folder / "out.mcap"
    path.write_bytes(data)
    if kind != "part":
        try:
            log = open_log(path)
            found = read_everything(log, whole, folder)
        except InputError as error:
            assert "\n" not in str(error)
        else:
            assert everything <= found or log.warnings, sorted(everything - found)
    try:
        result = recover_log(path, out)
    except InputError as error:
        assert "\n" not in str(error)
        return
    with out.open("rb") as stream:  # mcap's own reader, with checksums, and ours read what comes back
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        assert sum(1 for _ in reader.iter_messages()) == result.messages.total()
    recovered = open_log(out)
    assert not [text for text in recovered.warnings if "summary" in text or "index" in text]
    found = topics_with_messages(recovered)
    assert everything <= found or result.damaged or result.cut_bytes > (kind == "part") * 400
    assert bool(result.warnings) == bool(result.damaged or result.cut_bytes)


@pytest.mark.parametrize("kind", KINDS)
def test_any_byte_changed(kind: str, logs: Callable[[str], bytes], tmp_path: Path) -> None:
    fuzz(kind, logs, tmp_path, range(15))


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_ten_thousand_bytes_changed(kind: str, logs: Callable[[str], bytes], tmp_path: Path) -> None:
    """10,000 in all, one at a time."""
    fuzz(kind, logs, tmp_path, range(100, 100 + 1667))


@pytest.mark.parametrize("seed", [277, 991, 1597])
def test_a_topic_or_a_length_without_a_checksum(
    seed: int, logs: Callable[[str], bytes], tmp_path: Path
) -> None:
    """Outside of chunks nothing seals it; the summary says it again."""
    fuzz("foreign without chunks", logs, tmp_path, range(seed, seed + 1))


def fuzz(kind: str, logs: Callable[[str], bytes], folder: Path, seeds: range) -> None:
    data = logs(kind)
    (folder / "source.mcap").write_bytes(data)
    if kind == "part":
        assert recover_log(folder / "source.mcap", folder / "whole.mcap").damaged == 0
    else:
        (folder / "whole.mcap").write_bytes(data)
    whole = open_log(folder / "whole.mcap")
    everything = topics_with_messages(whole)
    assert len(everything) > 4
    for seed in seeds:
        try:
            check(changed(data, seed), kind, whole, everything, folder)
        except Exception as error:
            raise AssertionError(f"{kind}, seed {seed}: {type(error).__name__}: {error}") from error


# -- the case log-damage ---------------------------------------------------------------------------------


@pytest.mark.parametrize("name", [b"/relay/R1/trips", b"/can\x08", b"/relay/R1/events", b"/plant/faults"])
def test_a_bit_of_a_topics_name_in_the_summary(name: bytes, tmp_path: Path, capsys: Any) -> None:
    path = write_known(tmp_path / "known.mcap")
    whole = open_log(path)
    data = bytearray(path.read_bytes())
    end = next(record.start for record in walk(data, 8) if record.opcode == Opcode.DATA_END)
    data[data.index(name, end) + len(name) - 2] ^= 1
    bad = tmp_path / "bad.mcap"
    bad.write_bytes(data)
    log = open_log(bad)
    assert log.topics == whole.topics and "summary is damaged" in log.warnings[0]
    assert diff_logs(whole, log).equal
    for command in (
        ["review", str(bad)],
        ["diff", str(path), str(bad)],
        ["export", str(bad), "--csv", str(tmp_path)],
    ):
        assert call([*command, "--json"]) == 0
        out = capsys.readouterr()
        assert any("summary is damaged" in text for text in json.loads(out.out)["warnings"])
        assert "bad.mcap: its summary is damaged" in out.err


def bomb(compression: str, size: int) -> bytes:
    """A log whose one chunk is small and claims to hold ``size`` bytes, as it does."""
    chunk = bytes(1 << 20)
    if compression == "zstd":
        packer = zstandard.ZstdCompressor(level=3).compressobj()
        parts = [packer.compress(chunk) for _ in range(size >> 20)] + [packer.flush()]
    else:
        context = lz4.frame.LZ4FrameCompressor()
        parts = [context.begin(), *(context.compress(chunk) for _ in range(size >> 20)), context.flush()]
    packed, text = b"".join(parts), compression.encode()
    head = struct.pack("<QQQII", 0, 0, size, 0, len(text)) + text + struct.pack("<Q", len(packed))
    magic = b"\x89MCAP0\r\n"

    def record(opcode: Opcode, content: bytes) -> bytes:
        return struct.pack("<BQ", opcode, len(content)) + content

    footer = record(Opcode.FOOTER, struct.pack("<QQI", 0, 0, 0))
    body = record(Opcode.HEADER, struct.pack("<II", 0, 0)) + record(Opcode.CHUNK, head + packed)
    return magic + body + record(Opcode.DATA_END, bytes(4)) + footer + magic


@pytest.mark.parametrize("compression", ["zstd", "lz4"])
@pytest.mark.parametrize("claim", [None, 1000, 1 << 20], ids=["honest", "too little", "a little"])
def test_a_chunk_that_unpacks_to_much_more(
    compression: str, claim: int | None, tmp_path: Path, capsys: Any
) -> None:
    data = bytearray(bomb(compression, 320 << 20))
    if claim is not None:  # the chunk's header lies
        at = next(record.start for record in walk(data, 8) if record.opcode == Opcode.CHUNK)
        struct.pack_into("<Q", data, at + 16, claim)
    path = tmp_path / "bomb.mcap"
    path.write_bytes(data)
    tracemalloc.start()
    assert call(["review", str(path)]) == 2
    assert call(["recover", str(path), str(tmp_path / "out.mcap")]) == 0
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    out = capsys.readouterr()
    refused, warned = out.err.splitlines()
    assert "is damaged" in refused and warned.endswith("the chunk at byte 34 is damaged and left out")
    assert "1 damaged" in out.out
    assert peak < 50e6


def test_recover_tells_what_is_left_out(tmp_path: Path, capsys: Any) -> None:
    """A chunk whose content is damaged, and a topic that has less than the summary counts."""
    whole, path = write_known(tmp_path / "x.mcap", 1920), tmp_path / "damaged.mcap"
    data = bytearray(whole.read_bytes())
    chunks = [record for record in walk(bytes(data), 8) if record.opcode == Opcode.CHUNK]
    chunk = max(chunks, key=lambda record: record.stop - record.start)
    data[chunk.stop - 100] ^= 1
    path.write_bytes(data)
    assert call(["recover", str(path), str(tmp_path / "out.mcap"), "--json"]) == 0
    out = capsys.readouterr()
    told = json.loads(out.out)
    assert f"the chunk at byte {chunk.start} is damaged and left out" in told["warnings"]
    lost = next(text for text in told["warnings"] if text.startswith("/relay/R1/samples: "))
    back = open_log(tmp_path / "out.mcap")
    # The chunk had the schemas and channels, too: they come back from the summary, and with them the rest.
    count = len(back.samples("R1"))
    assert 0 < count < 1920 and lost.endswith(f"{count} messages are there, the summary counts 1920")
    assert set(back.topics) == set(open_log(whole).topics)
    assert [line.split(": ", 3)[3] for line in out.err.splitlines()] == told["warnings"]


def every_other(pairs: list[tuple[str, Any]]) -> list[Any]:
    """The second of each two at full size only."""
    return [pytest.param(*pair, marks=pytest.mark.slow) if n % 2 else pair for n, pair in enumerate(pairs)]


PLACE = {"name": 7, "line": 3, "breaker": [1]}
FAULT = {"name": 7, "line": 5, "at_pu": "x", "at_km": [1], "resistance_ohm": "much"}
SECONDARY = {"ohms": "secondary", "ct_ratio": "x", "vt_ratio": 0}
METADATA: dict[str, list[Any]] = {
    "scenario": [
        *("{", "5", "[1,2]", "[" * 100_000),
        *({"relay": [1, 2]}, {"relay": 5}, {"fault": [5]}, {"system": [1]}),
        {"scenario": {"name": 7, "duration_s": "x"}, "relay": [PLACE]},
        {"system": {"frequency_hz": 1e-300}},
        {"system": {"frequency_hz": "abc"}},
        {"fault": [FAULT]},
    ],
    "settings": [
        *("{", "[1]", {"line": {"z1_ohm": ["a", "b"]}}, {"line": {"z1_ohm": "ab"}}),
        *({"line": 5}, {"relay": [1]}, {"relay": {"frequency_hz": "abc"}}),
        {"relay": SECONDARY, "line": {"z1_ohm": [1, 10]}},
    ],
    "faultloop": ["abc", "9" * 40, "-5", "4000000000000000000"],
}


@pytest.mark.parametrize(
    ("record", "value"),
    every_other([(record, value) for record, values in METADATA.items() for value in values]),
    ids=lambda value: str(value)[:20],
)
def test_metadata_that_does_not_parse_counts_as_absent(
    record: str, value: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: Any
) -> None:
    text = value if isinstance(value, str) else json.dumps(value)
    keys = {"scenario": "json", "settings": "R1", "faultloop": "start_ns"}
    add = LogWriter.add_metadata

    def other(self: LogWriter, name: str, values: Any) -> None:
        add(self, name, dict(values) | ({keys[name]: text} if name == record else {}))

    monkeypatch.setattr(LogWriter, "add_metadata", other)
    check_commands(write_known(tmp_path / "x.mcap", 800), tmp_path, capsys)


CHANNEL_METADATA = {
    "pickup_bits": ["{", "5", "[1,2]", json.dumps(["A"] * 70), "[" * 100_000],
    "operate_bits": ["null"],
    "characteristics": ["{", "[1]", '{"Z": 5}', '{"Z": {"ground": [1,2,3], "phase": []}}',
                        '{"Z": {"ground": "text", "phase": "text"}}',
                        '{"Z": {"ground": [[NaN, 1]], "phase": []}}'],
}  # fmt: skip


@pytest.mark.parametrize(
    ("key", "text"),
    every_other([(k, t) for k, ts in CHANNEL_METADATA.items() for t in ts]),
    ids=lambda v: v[:20],
)
def test_channel_metadata_that_does_not_parse(
    key: str, text: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: Any
) -> None:
    channel = LogWriter._channel

    def other(self: LogWriter, topic: str, message: Any, metadata: Any = None) -> int:
        if metadata and key in metadata:
            metadata = {**metadata, key: text}
        return channel(self, topic, message, metadata)

    monkeypatch.setattr(LogWriter, "_channel", other)
    check_commands(write_known(tmp_path / "x.mcap", 800), tmp_path, capsys)


def check_commands(path: Path, folder: Path, capsys: Any) -> None:
    """Each says what counts as absent, and does the rest."""
    assert call(["review", str(path), "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["warnings"] and summary["relays"]["R1"]["samples"] == 800
    assert call(["review", str(path), "--png", str(folder / "x.png")]) == 0
    assert call(["diff", str(path), str(path)]) == 0
    assert call(["export", str(path), "--comtrade", str(folder / "x.cfg")]) == 0
    assert call(["export", str(path), "--parquet", str(folder / "tables")]) == 0
    assert call(["recover", str(path), str(folder / "out.mcap")]) == 0
    assert "Traceback" not in capsys.readouterr().err


def test_a_relay_without_samples(tmp_path: Path, capsys: Any) -> None:
    with LogWriter(tmp_path / "x.mcap", 0) as log:
        log.add_relay("R1", ["PDIS1"])
        log.message("/relay/R1/trips", 5, "Trip", function="PDIS1", loop="AG", poles=7)
        log.message("/plant/faults", 3, "FaultState", on=True, type="AG", fault=70)
    assert call(["review", str(tmp_path / "x.mcap"), "--png", str(tmp_path / "x.png")]) == 0
    assert "R1: no samples" in capsys.readouterr().out
    assert call(["review", str(tmp_path / "x.mcap"), "--html", str(tmp_path / "x.html")]) == 0
    assert call(["export", str(tmp_path / "x.mcap"), "--comtrade", str(tmp_path / "x.cfg")]) == 2


def test_a_damaged_schema_is_one_line(tmp_path: Path) -> None:
    """In a log without checksums: the schema itself is not one any more."""
    path = write_known(tmp_path / "x.mcap", 100)
    data = bytearray(path.read_bytes())
    at = data.index(b"faultloop.Trip", 8)
    data[at + 20 : at + 60] = bytes(40)
    chunk = next(record for record in walk(data, 8) if record.opcode == Opcode.CHUNK)
    head = ChunkHead.read(memoryview(data)[chunk.start : chunk.stop])
    struct.pack_into("<I", data, chunk.start + 24, zlib.crc32(data[chunk.start + head.start : chunk.stop]))
    end = next(record.start for record in walk(data, 8) if record.opcode == Opcode.DATA_END)
    data[data.index(b"faultloop.Trip", end)] ^= 1  # the summary is damaged, too
    path.write_bytes(data)
    for log in (path,):
        try:
            opened = open_log(log)
            topics_with_messages(opened)
        except InputError as error:
            assert "\n" not in str(error)
    recover_log(path, tmp_path / "out.mcap")
