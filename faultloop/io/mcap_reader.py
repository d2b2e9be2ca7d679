"""The log reader: a whole MCAP log as NumPy arrays, one per topic.

Records that have the writer's fixed layout are viewed as structured arrays, without a loop over messages; a
log that another program has written or rewritten is decoded message by message through its own schema.
"""

from __future__ import annotations

import json
import mmap
import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Metadata, Schema
from mcap_protobuf.decoder import DecoderFactory

from faultloop.config.input_file import check_input
from faultloop.errors import InputError, nearest
from faultloop.io import messages as table
from faultloop.io.mcap_file import DAMAGE, LOG_RECORD, MAGIC, MESSAGE_HEAD, ChunkHead, decompress, parse, walk
from faultloop.io.messages import Message, array_dtype, message_of, source_of
from faultloop.io.schema import is_fixed_layout, record_dtype, schema_bytes


@dataclass(frozen=True)
class Entry:
    """A rare message: when, on which topic, and its fields, which are attributes too (``entry.zone``)."""

    t_ns: int
    topic: str
    fields: dict[str, Any]

    @property
    def source(self) -> str:
        """The relay or breaker it is about; empty for the plant and the bus."""
        return source_of(self.topic)

    def __getattr__(self, name: str) -> Any:
        try:
            return self.__dict__["fields"][name]
        except KeyError:
            raise AttributeError(name) from None


@dataclass
class Segment:
    """Some records: a chunk, or the part of a file that is in no chunk."""

    load: Callable[[], bytes | memoryview]
    index: dict[int, np.ndarray] = field(default_factory=dict)  # offsets of the messages, per channel

    def offsets(self, channel: int) -> np.ndarray:
        if not self.index:  # a file may come without message indexes
            found: dict[int, list[int]] = {}
            content = self.load()
            for record in walk(content):
                if record.opcode == Opcode.MESSAGE:
                    offset = record.start - 9
                    found.setdefault(MESSAGE_HEAD.unpack_from(content, offset)[2], []).append(offset)
            self.index = {number: np.array(offsets, np.uint64) for number, offsets in found.items()}
        return self.index.get(channel, np.empty(0, np.uint64))


class Log:
    """An opened log.  Arrays are made when first asked for, and are read-only.

    Attributes
    ----------
    path : the file.
    start_ns : start of the run [ns since 1970-01-01 UTC]; every ``t_ns`` counts from it.
    topics : names of all topics, ours or not, sorted.
    relays, breakers : names, in the order of the file.
    metadata : metadata records by name.
    attachments : contents by name.
    """

    def __init__(self, path: Path, data: mmap.mmap | bytes) -> None:
        self.path = path
        self.metadata: dict[str, dict[str, str]] = {}
        self.attachments: dict[str, bytes] = {}
        self._data = memoryview(data)
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[str, list[Channel]] = {}
        self._segments: list[Segment] = []
        self._arrays: dict[str, np.ndarray] = {}
        self._first_ns: int | None = None
        self._decoders = DecoderFactory()
        self._scan()
        recorded = self.metadata.get(LOG_RECORD, {}).get("start_ns")
        self.start_ns = int(recorded) if recorded is not None else self._first_ns or 0
        self.topics = tuple(sorted(self._channels))
        self.relays = self._sources("relay")
        self.breakers = self._sources("breaker")

    def _sources(self, kind: str) -> tuple[str, ...]:
        return tuple(dict.fromkeys(source_of(t) for t in self._channels if t.startswith(f"/{kind}/")))

    # -- the file's records ---------------------------------------------------------------------------------

    def _scan(self) -> None:
        """Takes in every record at the top level; the content of chunks only where it has to."""
        loose: dict[int, list[int]] = {}
        ended, footer = False, False
        for record in walk(self._data, len(MAGIC)):
            opcode, content = record.opcode, self._data[record.start : record.stop]
            if opcode == Opcode.CHUNK:
                self._add_chunk(ChunkHead.read(content), content)
            elif opcode == Opcode.MESSAGE_INDEX and self._segments:
                channel, _ = struct.unpack_from("<HI", content)
                entries = np.frombuffer(content, np.uint64, offset=6).reshape(-1, 2)
                if len(entries):
                    self._segments[-1].index[channel] = entries[:, 1]
            elif opcode == Opcode.MESSAGE:
                head = MESSAGE_HEAD.unpack_from(self._data, record.start - 9)
                loose.setdefault(head[2], []).append(record.start - 9)
                self._starts_at(head[4])
            elif opcode == Opcode.METADATA:
                metadata = parse(Metadata, content)
                self.metadata[metadata.name] = metadata.metadata
            elif opcode == Opcode.ATTACHMENT:
                attachment = parse(Attachment, content)
                self.attachments[attachment.name] = attachment.data
            else:
                self._declare(opcode, content)
            ended, footer = ended or opcode == Opcode.DATA_END, opcode == Opcode.FOOTER
        if not (ended and footer):
            raise ValueError("its records break off before the footer")
        if loose:
            index = {channel: np.array(offsets, np.uint64) for channel, offsets in loose.items()}
            self._segments.append(Segment(lambda: self._data, index))
        self._find_channels()

    def _starts_at(self, log_ns: int) -> None:
        self._first_ns = log_ns if self._first_ns is None else min(self._first_ns, log_ns)

    def _declare(self, opcode: int, content: memoryview) -> None:
        if opcode == Opcode.SCHEMA:
            schema = parse(Schema, content)
            self._schemas[schema.id] = schema
        elif opcode == Opcode.CHANNEL:
            channel = parse(Channel, content)
            same = self._channels.setdefault(channel.topic, [])
            if all(known.id != channel.id for known in same):
                same.append(channel)

    def _add_chunk(self, head: ChunkHead, content: memoryview) -> None:
        self._starts_at(head.first_ns)
        loaded: list[bytes | memoryview] = []

        def load() -> bytes | memoryview:
            if not loaded:
                records = decompress(head.compression, content[head.start : head.stop], head.size)
                if head.crc and zlib.crc32(records) != head.crc:
                    raise ValueError("a chunk does not match its checksum")
                loaded.append(records)
            return loaded[0]

        self._segments.append(Segment(load))

    def _find_channels(self) -> None:
        """Channels and schemas from the chunks, for a file whose summary does not repeat them all."""
        channels = [channel for same in self._channels.values() for channel in same]
        known = {channel.id for channel in channels}
        if (
            all(segment.index and known.issuperset(segment.index) for segment in self._segments)
            and {channel.schema_id for channel in channels} <= self._schemas.keys() | {0}  # 0: no schema
        ):
            return
        for segment in self._segments:
            content = memoryview(segment.load())
            for record in walk(content):
                self._declare(record.opcode, content[record.start : record.stop])

    # -- topics ----------------------------------------------------------------------------------------------

    def array(self, topic: str) -> np.ndarray:
        """All messages of a topic: a structured array (n,), ``t_ns`` [ns since the start], then the fields.

        Numbers are numbers, texts and bytes are objects; ordered by time.  Raises InputError for a topic that
        the log or the table of messages does not have, and for damaged content.
        """
        if topic not in self._arrays:
            message = message_of(topic)
            if topic not in self._channels or message is None:
                ours = [name for name in self.topics if message_of(name)]
                raise InputError(f"no topic of that name; {nearest(topic, ours)}", file=self.path, key=topic)
            try:
                parts = [
                    self._read(segment, channel, message)
                    for channel in self._channels[topic]
                    for segment in self._segments
                    if len(segment.offsets(channel.id))
                ]
                rows = np.concatenate([np.empty(0, array_dtype(message)), *parts])
            except DAMAGE as error:
                raise InputError(f"is damaged: {error}", file=self.path, key=topic) from error
            if (np.diff(rows["t_ns"]) < 0).any():
                rows = rows[np.argsort(rows["t_ns"], kind="stable")]
            rows.flags.writeable = False
            self._arrays[topic] = rows
        return self._arrays[topic]

    def _read(self, segment: Segment, channel: Channel, message: Message) -> np.ndarray:
        content, offsets = segment.load(), segment.offsets(channel.id)
        schema = self._schemas.get(channel.schema_id)
        if message.every_sample and schema is not None and schema.data == schema_bytes(message):
            records = _records(content, offsets, record_dtype(message))
            if records is not None and is_fixed_layout(records, message, channel.id):
                return self._from_records(records, message)
        decode = self._decoders.decoder_for(channel.message_encoding, schema)
        if decode is None:
            raise ValueError(f"encoding {channel.message_encoding!r}; it should be protobuf, with a schema")
        rows = []
        for offset in offsets.tolist():
            opcode, length, number, _, log_ns, _ = MESSAGE_HEAD.unpack_from(content, offset)
            if opcode != Opcode.MESSAGE or number != channel.id or offset + 9 + length > len(content):
                raise ValueError(f"no message at byte {offset} of a chunk, where its index has one")
            proto = decode(bytes(content[offset + MESSAGE_HEAD.size : offset + 9 + length]))
            rows.append((log_ns - self.start_ns, *(getattr(proto, f.name, f.absent) for f in message.fields)))
        return np.array(rows, array_dtype(message))

    def _from_records(self, records: np.ndarray, message: Message) -> np.ndarray:
        rows = np.empty(len(records), array_dtype(message))
        rows["t_ns"] = records["head"]["log_time"].astype(np.int64) - self.start_ns
        # All fields are 8 bytes: one copy of the whole block instead of one per field.
        rows.view("<u8").reshape(len(rows), -1)[:, 1:] = records["body"]["value"]
        return rows

    def samples(self, relay: str) -> np.ndarray:
        """Sampled values: t_ns, sample_count, va vb vc [V], ia ib ic [A], primary."""
        return self.array(table.SAMPLED_VALUES.topic_for(relay))

    def phasors(self, relay: str) -> np.ndarray:
        """Phasors: t_ns, va_re ... ic_im [V, A RMS, primary], frequency_hz, rocof_hz_per_s."""
        return self.array(table.PHASORS.topic_for(relay))

    def loops(self, relay: str) -> np.ndarray:
        """Loop impedances: t_ns, ag_r ag_x ... ca_x [ohm, primary]."""
        return self.array(table.LOOP_IMPEDANCES.topic_for(relay))

    def elements(self, relay: str) -> np.ndarray:
        """Element bit sets: t_ns, pickup, operate; ``bits`` names them."""
        return self.array(table.ELEMENTS.topic_for(relay))

    def bits(self, relay: str) -> dict[str, tuple[str, ...]]:
        """Names of the bits of ``pickup`` and ``operate``, lowest first."""
        metadata = self.channel_metadata(table.ELEMENTS.topic_for(relay))
        return {word: tuple(json.loads(metadata.get(f"{word}_bits", "[]"))) for word in ("pickup", "operate")}

    def characteristics(self, relay: str) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Per zone the ground and the phase polygon, each (k, 2) of R, X [ohm, primary]."""
        metadata = self.channel_metadata(table.LOOP_IMPEDANCES.topic_for(relay))
        zones = json.loads(metadata.get("characteristics", "{}"))
        return {
            zone: (np.array(shapes["ground"]).reshape(-1, 2), np.array(shapes["phase"]).reshape(-1, 2))
            for zone, shapes in zones.items()
        }

    def channel_metadata(self, topic: str) -> dict[str, str]:
        """What the writer noted with a topic: units, bit names, characteristics."""
        return dict(self._channels[topic][0].metadata) if topic in self._channels else {}

    def entries(self, *kinds: Message) -> list[Entry]:
        """The messages of these kinds from all their topics, by time."""
        found = []
        for topic in self.topics:
            message = message_of(topic)
            if message in kinds and message is not None:
                names = [f.name for f in message.fields]
                for row in self.array(topic).tolist():
                    found.append(Entry(row[0], topic, dict(zip(names, row[1:], strict=True))))
        return sorted(found, key=lambda entry: entry.t_ns)

    @property
    def trips(self) -> list[Entry]:
        return self.entries(table.TRIP)

    @property
    def events(self) -> list[Entry]:
        return self.entries(table.EVENT)

    @property
    def breaker_states(self) -> list[Entry]:
        return self.entries(table.BREAKER_STATUS)

    @property
    def faults(self) -> list[Entry]:
        return self.entries(table.FAULT_STATE)

    @property
    def digital(self) -> list[Entry]:
        """A replayed record's own digital channels: the states at the start, then the changes."""
        return self.entries(table.RECORD_DIGITAL)

    @property
    def can(self) -> list[Entry]:
        return self.entries(table.CAN_FRAME)


def _records(content: bytes | memoryview, offsets: np.ndarray, dtype: np.dtype) -> np.ndarray | None:
    """The records at ``offsets`` as one structured array; None if one would reach beyond the content."""
    if int(offsets.max()) + dtype.itemsize > len(content):
        return None
    steps = np.diff(offsets)
    if len(steps) and (steps == steps[0]).all() and dtype.itemsize <= int(steps[0]) < len(content):
        # The writer's own order: a view, no copy.  The gather below takes 0.4 us a row, measured.
        return np.ndarray((len(offsets),), dtype, content, int(offsets[0]), (int(steps[0]),))
    where = offsets.astype(np.int64)[:, None] + np.arange(dtype.itemsize)
    return np.frombuffer(content, np.uint8)[where].view(dtype)[:, 0]


def map_file(path: str | Path) -> mmap.mmap | bytes:
    """The bytes of a file, mapped.  Raises InputError if it cannot be read or does not begin as MCAP does."""
    path = Path(path)
    check_input(path, "a log")
    try:
        with path.open("rb") as stream:
            size = stream.seek(0, 2)
            data = mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) if size else b""
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", file=path) from error
    if not size:
        raise InputError("is empty; it should be an MCAP log", file=path)
    if data[: len(MAGIC)] != MAGIC:
        raise InputError("is not an MCAP file: it does not begin with MCAP's magic bytes", file=path)
    return data


def open_log(path: str | Path) -> Log:
    """Opens a log that was closed whole.

    Raises InputError if the file is missing, empty, not MCAP, damaged, or half-written; it recovers nothing
    silently: that is ``recover_log``.
    """
    path = Path(path)
    part = Path(f"{path}.part")  # with_name would refuse "." and "/"
    if not path.exists():
        hint = (
            f"; a run that was cut off left {part.name}: faultloop recover {path} OUT.mcap"
            if part.exists()
            else ""
        )
        raise InputError(f"no such file{hint}", file=path)
    data = map_file(path)
    if data[-len(MAGIC) :] != MAGIC or len(data) < 2 * len(MAGIC):
        raise InputError(
            f"is half-written: it has no footer; faultloop recover {path} OUT.mcap brings back what is whole",
            file=path,
        )
    try:
        return Log(path, data)
    except DAMAGE as error:
        raise InputError(
            f"is damaged: {error}; faultloop recover may bring back a part of it", file=path
        ) from error
