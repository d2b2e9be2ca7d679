"""What is in an MCAP file, and where: its records at the top level, checked against each other.

A chunk has a checksum, the summary has one, and the summary counts what the chunks should hold.  What stands
outside of both (metadata, message indexes, the heads of chunks) is checked against them.  Damage that leaves
the messages readable is noted in ``warnings``; any other raises.
"""

from __future__ import annotations

import mmap
import struct
from collections import Counter, OrderedDict
from dataclasses import dataclass, field

import numpy as np
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    ChunkIndex,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)

from faultloop.io.crc import crc32
from faultloop.io.mcap_file import (
    DAMAGE,
    FOOTER_SIZE,
    MAGIC,
    MESSAGE_HEAD,
    RECORD_HEAD,
    Buffer,
    ChunkHead,
    Raw,
    decompress,
    forget_pages,
    parse,
    walk,
)

LOOSE_BYTES = 1 << 22  # messages outside of chunks are taken together up to this size
HELD_BYTES = 1 << 26  # content of chunks that is kept at hand
IN_DATA = {
    Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.CHUNK, Opcode.MESSAGE_INDEX, Opcode.ATTACHMENT,
    Opcode.METADATA,
}  # fmt: skip
Index = dict[int, np.ndarray]
"""Per channel (n, 2): log time and place of each message in its segment."""


@dataclass(eq=False)
class Segment:
    """Records that are read together: a chunk (``head``), or messages of a file that stand in no chunk.

    ``data[start:stop]`` is the content, as it is stored; up to ``end`` follow its message indexes.  ``index``
    is None where it has to be found by walking the content.
    """

    start: int
    stop: int
    end: int
    first_ns: int
    last_ns: int
    head: ChunkHead | None = None
    index: Index | None = None
    checked: bool = False

    def may_hold(self, channel: int) -> bool:
        """Whether messages of a channel are in it; True where that is not known yet."""
        return self.index is None or channel in self.index


@dataclass
class Summary:
    """The part of a file behind its messages that repeats and counts them."""

    schemas: list[Schema] = field(default_factory=list)
    channels: list[Channel] = field(default_factory=list)
    statistics: Statistics | None = None
    chunks: list[ChunkIndex] = field(default_factory=list)
    attachments: list[AttachmentIndex] = field(default_factory=list)
    metadata: list[MetadataIndex] = field(default_factory=list)

    @classmethod
    def read(cls, data: memoryview, begin: int, footer: int) -> Summary:
        """What stands from ``begin`` to the footer.  Raises one of ``DAMAGE`` where it cannot be trusted."""
        (crc,) = struct.unpack_from("<I", data, footer + FOOTER_SIZE - 4)
        if begin > footer:
            raise ValueError("place")
        if crc and crc32(data[begin : footer + FOOTER_SIZE - 4]) != crc:
            raise ValueError("checksum")
        summary, end = cls(), begin
        for record in walk(data[:footer], begin):
            summary._take(record, data)
            end = record.stop
        if end != footer:
            raise ValueError("length")
        return summary

    def _take(self, record: Raw, data: memoryview) -> None:
        content = data[record.start : record.stop]
        if record.opcode == Opcode.STATISTICS:
            self.statistics = parse(Statistics, content)
            return
        kinds = {
            Opcode.SCHEMA: (Schema, self.schemas),
            Opcode.CHANNEL: (Channel, self.channels),
            Opcode.CHUNK_INDEX: (ChunkIndex, self.chunks),
            Opcode.ATTACHMENT_INDEX: (AttachmentIndex, self.attachments),
            Opcode.METADATA_INDEX: (MetadataIndex, self.metadata),
        }
        kind, into = kinds.get(Opcode(record.opcode), (None, []))
        if kind is not None:
            into.append(parse(kind, content))


class Chunks:
    """Content of segments, unpacked and checked; the last 64 MB stay at hand."""

    def __init__(self, data: mmap.mmap | bytes) -> None:
        self._map, self._data = data, memoryview(data)
        self._held: OrderedDict[Segment, Buffer] = OrderedDict()
        self._holding = 0

    def load(self, segment: Segment) -> Buffer:
        """Raises ValueError where the content is not what the head says."""
        if segment in self._held:
            self._held.move_to_end(segment)
            return self._held[segment]
        content: Buffer = self._data[segment.start : segment.stop]
        if segment.head is not None:
            content = decompress(segment.head.compression, content, segment.head.size)
            if segment.head.crc and not segment.checked and crc32(content) != segment.head.crc:
                raise ValueError("a chunk does not match its checksum")
        segment.checked = True
        self._held[segment] = content
        self._holding += len(content)
        while self._holding > HELD_BYTES and len(self._held) > 1:
            old, gone = self._held.popitem(last=False)
            self._holding -= len(gone)
            forget_pages(self._map, old.start, old.end)
        return content


class Contents:
    """The records of a file that was closed whole.

    Attributes
    ----------
    metadata, attachments : by name.
    schemas : by number; ``channels`` by topic.
    segments : in the order of the file.
    chunks : what the segments hold.
    warnings : what is damaged and could be left out or found in another way, one line each.

    Raises one of ``DAMAGE`` where the messages themselves cannot be found.
    """

    def __init__(self, data: mmap.mmap | bytes) -> None:
        self._map = data
        self._data = memoryview(data)
        self.chunks = Chunks(data)
        self.metadata: dict[str, dict[str, str]] = {}
        self.attachments: dict[str, bytes] = {}
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[str, list[Channel]] = {}
        self.segments: list[Segment] = []
        self.warnings: list[str] = []
        footer = len(data) - len(MAGIC) - FOOTER_SIZE
        opcode, length = RECORD_HEAD.unpack_from(data, footer)
        if opcode != Opcode.FOOTER or length != FOOTER_SIZE - RECORD_HEAD.size:
            raise ValueError("it has no footer")
        begin, summary = self._summary(footer)
        self._scan(begin)
        if summary is not None:
            for record in (*summary.schemas, *summary.channels):
                self._declare(record)
        self._find_channels(summary is None)
        if summary is not None:
            self._compare(summary)
        forget_pages(self._map, 0, len(data))

    def warn(self, text: str) -> None:
        """Notes what is damaged, once."""
        if text not in self.warnings:
            self.warnings.append(text)

    # -- the file's records ---------------------------------------------------------------------------------

    def _summary(self, footer: int) -> tuple[int | None, Summary | None]:
        """Where the summary begins, and what it says; None for what cannot be trusted."""
        begin, _, crc = struct.unpack_from("<QQI", self._data, footer + RECORD_HEAD.size)
        if begin == 0 and crc == 0:
            return footer, None
        try:
            return begin, Summary.read(self._data, begin, footer)
        except DAMAGE:
            self.warn("its summary is damaged: topics and messages were found by reading every chunk")
            return None, None

    def _scan(self, stop: int | None) -> None:
        """Takes in every record before the summary; the content of chunks only where it has to."""
        position, seen = len(MAGIC), 0
        loose: list[Raw] = []
        for record in walk(self._data, position):
            if stop is not None and record.start - RECORD_HEAD.size >= stop:
                break
            position = record.stop
            if loose and (record.opcode != Opcode.MESSAGE or position - loose[0].start > LOOSE_BYTES):
                self._add_loose(loose)
                loose = []
            if record.opcode == Opcode.DATA_END and record.stop - record.start == 4:
                if stop in (None, position):
                    stop = position
                    break
                self.warn(f"a record at byte {record.start} says that the messages end, and they go on")
            elif record.opcode == Opcode.MESSAGE:
                loose.append(record)
            elif record.opcode in IN_DATA:
                self._take(record)
            elif record.opcode != Opcode.HEADER or record.start != len(MAGIC) + RECORD_HEAD.size:
                self.warn(
                    f"a record at byte {record.start} is of a kind ({record.opcode:#04x}) unknown there"
                )
            if position - seen > HELD_BYTES:
                forget_pages(self._map, seen, position)
                seen = position
        self._add_loose(loose)
        if position != stop:
            raise ValueError(f"its records break off at byte {position}")

    def _take(self, record: Raw) -> None:
        content = self._data[record.start : record.stop]
        if record.opcode == Opcode.CHUNK:
            head = ChunkHead.read(content)
            if head.stop != len(content):
                raise ValueError(f"the chunk at byte {record.start} is not as long as its record")
            start = record.start + head.start
            self.segments.append(
                Segment(start, record.stop, record.stop, head.first_ns, head.last_ns, head, {})
            )
        elif record.opcode == Opcode.MESSAGE_INDEX:
            self._take_index(content, record.stop)
        elif record.opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            self._declare(parse(Schema if record.opcode == Opcode.SCHEMA else Channel, content))
        else:
            try:
                self._take_information(record.opcode, content)
            except DAMAGE:
                kind = "a metadata record" if record.opcode == Opcode.METADATA else "an attachment"
                self.warn(f"{kind} at byte {record.start} is damaged and left out")

    def _take_index(self, content: memoryview, end: int) -> None:
        if not self.segments or self.segments[-1].head is None:
            self.warn("a message index stands where no chunk was before it")
            return
        segment = self.segments[-1]
        segment.end = end
        size = len(content) - 6
        if size < 0 or size % 16 or struct.unpack_from("<I", content, 2) != (size,):
            self._distrust(segment)
        elif size and segment.index is not None:
            (channel,) = struct.unpack_from("<H", content)
            segment.index[channel] = np.frombuffer(content, np.uint64, offset=6).reshape(-1, 2)

    def _distrust(self, segment: Segment) -> None:
        segment.index = None
        self.warn("the message index of a chunk is damaged: its messages were found in the chunk itself")

    def _take_information(self, opcode: int, content: memoryview) -> None:
        if opcode == Opcode.METADATA:
            metadata = parse(Metadata, content)
            self.metadata[metadata.name] = metadata.metadata
            return
        (crc,) = struct.unpack("<I", content[-4:])
        if crc and crc != crc32(content[:-4]):
            raise ValueError("checksum")
        attachment = parse(Attachment, content)
        self.attachments[attachment.name] = attachment.data

    def _declare(self, record: Schema | Channel) -> None:
        if isinstance(record, Schema):
            self.schemas[record.id] = record
            return
        same = self.channels.setdefault(record.topic, [])
        if all(known.id != record.id for known in same):
            same.append(record)

    def _add_loose(self, records: list[Raw]) -> None:
        if not records:
            return
        start = records[0].start - RECORD_HEAD.size
        index: dict[int, list[tuple[int, int]]] = {}
        for record in records:
            offset = record.start - RECORD_HEAD.size
            _, _, channel, _, log_ns, _ = MESSAGE_HEAD.unpack_from(self._data, offset)
            index.setdefault(channel, []).append((log_ns, offset - start))
        arrays = {channel: np.array(pairs, np.uint64) for channel, pairs in index.items()}
        first = min(int(pairs[:, 0].min()) for pairs in arrays.values())
        last = max(int(pairs[:, 0].max()) for pairs in arrays.values())
        stop = records[-1].stop
        self.segments.append(Segment(start, stop, stop, first, last, None, arrays))

    def _find_channels(self, everything: bool) -> None:
        """Channels, schemas and message indexes from the chunks, where the summary does not give them all."""
        channels = [channel for same in self.channels.values() for channel in same]
        known = {channel.id for channel in channels}
        complete = {channel.schema_id for channel in channels} <= self.schemas.keys() | {0}  # 0: no schema
        for segment in self.segments:
            told = complete and not everything and segment.index and known.issuperset(segment.index)
            if segment.head is not None and not told:
                self._walk(segment, keep=not everything and bool(segment.index))

    def _walk(self, segment: Segment, *, keep: bool) -> None:
        """Takes in a chunk's schemas and channels, and makes its message index anew, or keeps what it has."""
        content = memoryview(self.chunks.load(segment))
        found: dict[int, list[tuple[int, int]]] = {}
        end = 0
        for record in walk(content):
            end = record.stop
            if record.opcode == Opcode.MESSAGE:
                offset = record.start - RECORD_HEAD.size
                _, _, channel, _, log_ns, _ = MESSAGE_HEAD.unpack_from(content, offset)
                found.setdefault(channel, []).append((log_ns, offset))
            elif record.opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                kind = Schema if record.opcode == Opcode.SCHEMA else Channel
                self._declare(parse(kind, content[record.start : record.stop]))
        if end != len(content):
            raise ValueError("the records of a chunk break off before its end")
        if not keep:
            segment.index = {channel: np.array(pairs, np.uint64) for channel, pairs in found.items()}

    def _compare(self, summary: Summary) -> None:
        """What the summary, which has a checksum, counts and repeats must be there."""
        chunks = [segment for segment in self.segments if segment.head is not None]
        places = {index.chunk_start_offset: index for index in summary.chunks}
        for segment in chunks:
            assert segment.head is not None
            index = places.get(segment.start - segment.head.start - RECORD_HEAD.size)
            if index is not None and (index.message_start_time, index.message_end_time) != (
                segment.first_ns,
                segment.last_ns,
            ):
                self.warn("the head of a chunk is damaged: its times are the summary's")
                segment.first_ns, segment.last_ns = index.message_start_time, index.message_end_time
        for name in sorted({index.name for index in summary.metadata} - self.metadata.keys()):
            self.warn(f"the metadata record '{name}' is damaged or missing")
        for name in sorted({index.name for index in summary.attachments} - self.attachments.keys()):
            self.warn(f"the attachment '{name}' is damaged or missing")
        if summary.statistics is None:
            return
        wanted = {c: n for c, n in summary.statistics.channel_message_counts.items() if n}
        if self.counts() != wanted:
            self.warn("its message indexes do not fit the summary's counts: every chunk was read instead")
            for segment in chunks:
                self._walk(segment, keep=False)
        found = self.counts()
        topics = {channel.id: topic for topic, same in self.channels.items() for channel in same}
        for number in sorted({*wanted, *found}):
            have, should = found.get(number, 0), wanted.get(number, 0)
            if have != should:
                name = topics.get(number, f"channel {number}")
                self.warn(f"{name}: {have} messages are there, the summary counts {should}")

    def counts(self) -> dict[int, int]:
        """Number of messages per channel, as the message indexes have it."""
        found: Counter[int] = Counter()
        for segment in self.segments:
            for channel, entries in (segment.index or {}).items():
                found[channel] += len(entries)
        return dict(found)

    def index(self, segment: Segment, channel: int) -> np.ndarray:
        """Log times and places (n, 2) of a channel's messages in a segment."""
        if segment.index is None:
            self._walk(segment, keep=False)
        assert segment.index is not None
        return segment.index.get(channel, np.empty((0, 2), np.uint64))

    def distrust(self, segment: Segment) -> None:
        """The index of a segment was found wrong: the next look at it walks the content."""
        self._distrust(segment)
