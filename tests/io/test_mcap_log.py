"""The log: its bytes, what other programs read from it, and what the reader gives back."""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from google.protobuf.json_format import MessageToDict
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import NonSeekingReader, make_reader
from mcap.records import ChunkIndex
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer
from mcap_protobuf.decoder import DecoderFactory
from numpy.testing import assert_array_equal

from faultloop.errors import InputError
from faultloop.io.mcap_reader import open_log
from faultloop.io.mcap_writer import CHUNK_NS, LogWriter
from faultloop.io.messages import BY_NAME, MESSAGES, SAMPLED, message_of, values

START_NS = 1_577_836_800_000_000_000


def assert_same_rows(a: np.ndarray, b: np.ndarray) -> None:
    """Structured arrays equal bit for bit (NaN included), texts by value."""
    assert a.dtype == b.dtype and len(a) == len(b)
    for name in a.dtype.names or ():
        x, y = a[name], b[name]
        assert x.tolist() == y.tolist() if x.dtype == object else x.tobytes() == y.tobytes(), name


def test_same_input_same_bytes_whatever_the_blocks(make_log: Callable[..., Path], tmp_path: Path) -> None:
    first = make_log(tmp_path / "a.mcap", rows=2500, block=1).read_bytes()
    for block in (7, 200, 240):
        assert make_log(tmp_path / "b.mcap", rows=2500, block=block).read_bytes() == first


@pytest.mark.parametrize("compression", ["", "lz4", "zstd"])
def test_round_trip(
    compression: str, make_log: Callable[..., Path], make_arrays: Callable[..., Any], tmp_path: Path
) -> None:
    log = open_log(make_log(tmp_path / "run.mcap", compression=compression))
    assert log.start_ns == START_NS
    assert log.relays == ("R1", "R2")
    assert log.breakers == ("B1",)
    assert log.metadata["scenario"] == {"name": "test"}
    assert log.attachments == {"relay.toml": b"[relay]\n"}
    for place, relay in enumerate(log.relays):
        t_ns, count, samples, phasors, loops, pickup, operate = make_arrays(1200, place)
        for rows in (log.samples(relay), log.phasors(relay), log.loops(relay), log.elements(relay)):
            assert_array_equal(rows["t_ns"], t_ns)
        assert_array_equal(log.samples(relay)["sample_count"], count)
        for rows, written in ((log.samples, samples), (log.phasors, phasors), (log.loops, loops)):
            assert values(rows(relay)).tobytes() == written.tobytes()
        assert_array_equal(log.elements(relay)["pickup"], pickup)
        assert_array_equal(log.elements(relay)["operate"], operate)
    assert log.bits("R1")["operate"] == ("PDIS1.Op", "PDIS2.Op", "PTRC1.Tr", "")
    ground, phase = log.characteristics("R2")["PDIS1"]
    assert_array_equal(ground, [[0, 0], [5, 1], [4, 9.5]])
    assert_array_equal(phase, 2 * ground)


def test_rare_messages_come_back(log_path: Path) -> None:
    log = open_log(log_path)
    (trip,) = log.trips
    assert (trip.t_ns, trip.source, trip.zone, trip.loop, trip.poles) == (90_000_000, "R1", 1, "AG", 7)
    (event,) = log.events
    assert (event.level, event.message) == (3, "Trip: Ü")
    assert [(frame.id, frame.data, frame.extended) for frame in log.can] == [
        (0x010, bytes(range(8)), False),
        (0x1ABCDEFF, b"", True),
    ]
    assert [state.source for state in log.breaker_states] == ["B1"]
    assert log.faults[0].type == "AG"
    assert [(e.number, e.name, e.on, e.normal) for e in log.digital] == [(3, "51G", True, False)]
    with pytest.raises(AttributeError):
        _ = trip.no_such_field


def test_mcap_readers_agree_with_ours(log_path: Path) -> None:
    """mcap with checksums on, and mcap_protobuf, read every message as ``open_log`` does."""
    log = open_log(log_path)
    with log_path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        counts: Counter[str] = Counter()
        previous = 0
        for schema, channel, message, proto in reader.iter_decoded_messages(log_time_order=True):
            assert message.log_time == message.publish_time >= previous
            previous = message.log_time
            assert proto.timestamp.seconds * 10**9 + proto.timestamp.nanos == message.log_time
            table = message_of(channel.topic)
            assert table is not None and schema is not None and schema.name == table.full_name
            row = log.array(channel.topic)[counts[channel.topic]]
            counts[channel.topic] += 1
            assert row["t_ns"] == message.log_time - START_NS
            assert_array_equal([getattr(proto, f.name) for f in table.fields], list(row.tolist()[1:]))
        summary = reader.get_summary()
    assert summary is not None and summary.statistics is not None
    statistics = summary.statistics
    assert counts == {summary.channels[c].topic: n for c, n in statistics.channel_message_counts.items()}
    assert statistics.message_count == counts.total()
    assert statistics.message_start_time == START_NS
    assert statistics.message_end_time == START_NS + 1199 * 10**9 // 4800
    assert all(_span(chunk) < CHUNK_NS for chunk in summary.chunk_indexes)
    assert statistics.chunk_count == len(summary.chunk_indexes) == 3  # two windows, and what came late
    assert {a.name for a in summary.attachment_indexes} == {"relay.toml"}


def _span(chunk: ChunkIndex) -> int:
    return chunk.message_end_time - chunk.message_start_time


def test_streaming_readers_read_it(log_path: Path) -> None:
    with log_path.open("rb") as stream:
        kinds = Counter(type(record).__name__ for record in StreamReader(stream, validate_crcs=True).records)
    assert kinds["Message"] == 1200 * 8 + 7
    with log_path.open("rb") as stream:
        assert len(list(NonSeekingReader(stream, validate_crcs=True).iter_messages())) == 1200 * 8 + 7


@given(data=st.data())
@settings(max_examples=40, deadline=None, derandomize=True)
def test_any_values_come_back(data: st.DataObject) -> None:
    floats = st.floats(width=64)  # NaN and infinities included
    rows = data.draw(st.integers(1, 3))
    t_ns = np.cumsum(data.draw(st.lists(st.integers(0, 10**9), min_size=rows, max_size=rows)))
    block = [data.draw(st.lists(floats, min_size=n * rows, max_size=n * rows)) for n in (6, 14, 12)]
    arrays = [np.array(flat).reshape(rows, -1) for flat in block]
    words = [
        np.array(data.draw(st.lists(st.integers(0, 2**64 - 1), min_size=rows, max_size=rows)), np.uint64)
    ] * 3
    text, payload = data.draw(st.text()), data.draw(st.binary(max_size=64))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "x.mcap")
        with LogWriter(path, data.draw(st.integers(0, 2**62))) as log:
            log.add_relay("R", [])
            log.relay_block("R", t_ns, words[0], *arrays, words[1], words[2])
            log.message("/can", int(t_ns[-1]), "CanFrame", id=2**29 - 1, data=payload, sender=text)
        log = open_log(path)
        assert_array_equal(log.phasors("R")["t_ns"], t_ns)
        assert_array_equal(log.elements("R")["operate"], words[2])
        for rows_of, array in zip((log.samples, log.phasors, log.loops), arrays, strict=True):
            assert_array_equal(values(rows_of("R")), array)
        assert (log.can[0].sender, log.can[0].data) == (text, payload)
        del log  # the file is mapped: Windows could not delete it


def rewrite(source: Path, target: Path, compression: CompressionType, **options: bool) -> None:
    """The messages of a log as another program writes them, encoded by protobuf itself (zeros left out)."""
    with source.open("rb") as stream, target.open("wb") as out:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        writer = Writer(out, compression=compression, chunk_size=30_000, **options)
        writer.start()
        schemas: dict[int, int] = {}
        channels: dict[int, int] = {}
        for schema, channel, message, proto in reader.iter_decoded_messages():
            assert schema is not None
            if schema.id not in schemas:
                schemas[schema.id] = writer.register_schema(schema.name, schema.encoding, schema.data)
            if channel.id not in channels:
                channels[channel.id] = writer.register_channel(
                    channel.topic, channel.message_encoding, schemas[schema.id], channel.metadata
                )
            data = proto.SerializeToString()
            writer.add_message(channels[channel.id], message.log_time, data, message.publish_time)
        writer.finish()


@pytest.mark.parametrize(
    "options",
    [{}, {"use_chunking": False}, {"repeat_channels": False, "repeat_schemas": False}],
    ids=["chunks", "no chunks", "no repeated channels"],
)
def test_a_log_rewritten_by_another_program_reads_the_same(
    options: dict[str, bool], make_log: Callable[..., Path], tmp_path: Path
) -> None:
    ours = make_log(tmp_path / "ours.mcap", rows=300)
    rewrite(ours, tmp_path / "theirs.mcap", CompressionType.LZ4, **options)
    a, b = open_log(ours), open_log(tmp_path / "theirs.mcap")
    assert set(b.topics) == {topic for topic in a.topics if len(a.array(topic))}
    assert b.start_ns == START_NS  # without our metadata, the first message
    for topic in b.topics:
        assert_same_rows(a.array(topic), b.array(topic))


def test_a_log_copied_message_by_message_reads_the_same(log_path: Path, tmp_path: Path) -> None:
    """The bytes of the messages as they are, interleaved by time, through mcap's own writer."""
    with log_path.open("rb") as stream, (tmp_path / "copy.mcap").open("wb") as out:
        writer = Writer(out, chunk_size=100_000)
        writer.start()
        channels: dict[int, int] = {}
        for schema, channel, message in make_reader(stream).iter_messages():
            assert schema is not None
            if channel.id not in channels:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.id] = writer.register_channel(channel.topic, "protobuf", number)
            writer.add_message(channels[channel.id], message.log_time, message.data, message.log_time)
        writer.finish()
    a, b = open_log(log_path), open_log(tmp_path / "copy.mcap")
    assert len(b.topics) == 14
    for topic in b.topics:
        assert_same_rows(a.array(topic), b.array(topic))


def test_relays_far_apart_in_time_stay_in_chunks_of_a_window(
    make_arrays: Callable[..., Any], tmp_path: Path
) -> None:
    """Blocks of a second each, one relay after the other: late rows get chunks of their own window."""
    arrays = make_arrays(4800)
    with LogWriter(tmp_path / "x.mcap", START_NS) as log:
        log.add_relay("R1", [])
        log.add_relay("R2", [])
        log.relay_block("R1", *arrays)
        log.relay_block("R2", *arrays)
    with (tmp_path / "x.mcap").open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    assert all(_span(chunk) < CHUNK_NS for chunk in summary.chunk_indexes)
    log = open_log(tmp_path / "x.mcap")
    assert_same_rows(log.samples("R2"), log.samples("R1"))


def test_nothing_under_the_final_name_until_closed(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    log = LogWriter(path, 0)
    assert not path.exists() and (tmp_path / "run.mcap.part").exists()
    log.close()
    assert path.exists() and not (tmp_path / "run.mcap.part").exists()
    with pytest.raises(RuntimeError, match="stop"), LogWriter(tmp_path / "failed.mcap", 0):
        raise RuntimeError("stop")
    assert not (tmp_path / "failed.mcap").exists() and (tmp_path / "failed.mcap.part").exists()


def test_empty_log_opens(tmp_path: Path) -> None:
    with LogWriter(tmp_path / "x.mcap", START_NS) as log:
        log.add_relay("R1", ["PDIS1"])
    opened = open_log(tmp_path / "x.mcap")
    assert opened.relays == ("R1",)
    assert len(opened.samples("R1")) == 0
    with (tmp_path / "x.mcap").open("rb") as stream:
        assert list(make_reader(stream).iter_messages()) == []


def test_wrong_blocks_are_refused(make_arrays: Callable[..., Any], tmp_path: Path) -> None:
    arrays = list(make_arrays(5))
    with LogWriter(tmp_path / "x.mcap", 0) as log:
        log.add_relay("R1", [])
        with pytest.raises(ValueError, match="already"):
            log.add_relay("R1", [])
        with pytest.raises(ValueError, match=r"\(n, 6\)"):
            log.relay_block("R1", *arrays[:2], arrays[2][:, :5], *arrays[3:])
        with pytest.raises(ValueError, match=r"\(n, 6\)"):
            log.relay_block("R1", *arrays[:2], arrays[2][:1], *arrays[3:])
    with pytest.raises(ValueError, match="1970"):
        LogWriter(tmp_path / "y.mcap", -1)


def test_wrong_files_say_what_is_wrong(log_path: Path, tmp_path: Path) -> None:
    whole = log_path.read_bytes()
    cases = {
        "empty.mcap": (b"", "is empty"),
        "text.mcap": (b"hello, this is a text file", "not an MCAP"),
        "cut.mcap": (whole[: len(whole) // 2], "faultloop recover"),
        "tail.mcap": (whole[:-1], "faultloop recover"),
        "hole.mcap": (whole[:5000] + whole[9000:], "damaged"),
    }
    for name, (data, says) in cases.items():
        (tmp_path / name).write_bytes(data)
        with pytest.raises(InputError, match=says) as caught:
            open_log(tmp_path / name)
        assert caught.value.file == str(tmp_path / name)
        assert "\n" not in str(caught.value)
    for path in (tmp_path / "none.mcap", tmp_path):
        with pytest.raises(InputError):
            open_log(path)
    (tmp_path / "killed.mcap.part").write_bytes(whole[:5000])
    with pytest.raises(InputError, match=r"killed\.mcap\.part: faultloop recover"):
        open_log(tmp_path / "killed.mcap")
    with pytest.raises(InputError, match="did you mean '/relay/R1/samples'"):
        open_log(log_path).array("/relay/R1/sample")


def test_changed_byte_is_noticed(log_path: Path, tmp_path: Path) -> None:
    data = bytearray(log_path.read_bytes())
    data[len(data) // 2] ^= 0x01
    (tmp_path / "x.mcap").write_bytes(data)
    with pytest.raises(InputError, match="damaged"):
        log = open_log(tmp_path / "x.mcap")
        for topic in log.topics:
            log.array(topic)


def test_units_are_in_the_channels(log_path: Path) -> None:
    metadata = open_log(log_path).channel_metadata("/relay/R1/phasors")
    assert '"va_re": "V"' in metadata["units"] and '"rocof_hz_per_s": "Hz/s"' in metadata["units"]


def test_protobuf_json_keeps_our_field_names(log_path: Path) -> None:
    with log_path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        for _, channel, _, proto in reader.iter_decoded_messages(topics=["/relay/R1/trips"]):
            assert channel.topic == "/relay/R1/trips"
            names = MessageToDict(proto, preserving_proto_field_name=True)
            assert set(names) == {"timestamp", *(f.name for f in BY_NAME["Trip"].fields)}


def test_every_message_of_the_table_is_in_the_test_log(log_path: Path) -> None:
    found = {message_of(topic) for topic in open_log(log_path).topics}
    assert found == set(MESSAGES)
    assert len(SAMPLED) == 4
