"""The MCAP container: writing chunks of ready-made records, and walking the records of any file.

``mcap.writer.Writer`` takes messages one by one; here a whole chunk with its message indexes is handed over
at once.  Everything else (schemas, channels, metadata, summary) uses the library's own records.
"""

from __future__ import annotations

import mmap
import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from io import BytesIO
from typing import IO, Any, NamedTuple

import lz4.frame
import numpy as np
import zstandard
from google.protobuf.message import DecodeError
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.writer import MCAP0_MAGIC as MAGIC

from faultloop.io.crc import crc32

LIBRARY = (
    "faultloop"  # without a version: the versions are metadata, the bytes of a log do not depend on them
)
LOG_RECORD = "faultloop"  # the metadata record that says where the run's time starts
# What parsing the content of a damaged record may raise, in struct, mcap and protobuf; MemoryError and
# OverflowError come from lengths that are nonsense.
DAMAGE = (
    ValueError,
    TypeError,
    LookupError,
    AttributeError,
    OverflowError,
    MemoryError,
    RecursionError,
    struct.error,
    McapError,
    DecodeError,
)
RECORD_HEAD = struct.Struct("<BQ")  # opcode, length of what follows
MESSAGE_HEAD = struct.Struct("<BQHIQQ")  # then channel, sequence, log time, publish time

FOOTER_SIZE = 29  # of its whole record
MOST_BYTES = 1 << 28  # of a chunk, unpacked; faultloop's own have some 1 MB
FREE_BYTES = 1 << 24  # up to here a chunk may be packed as densely as it likes
MOST_RATIO = 1000  # of what is unpacked to what is stored, above that

Buffer = bytes | memoryview  # of single bytes, so that len() counts them

COMPRESSORS: dict[str, Callable[[bytes], bytes] | None] = {
    "": None,
    "lz4": lz4.frame.compress,
    "zstd": zstandard.ZstdCompressor(level=1).compress,
}


def record_bytes(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return builder.end()


class McapFile:
    """Writes an MCAP file to an open binary stream, chunk by chunk; every chunk is flushed to the system.

    Parameters
    ----------
    stream : opened for writing, empty.
    compression : ``""``, ``"lz4"`` or ``"zstd"``.
    """

    def __init__(self, stream: IO[bytes], compression: str = "") -> None:
        self._stream, self._compression, self._compress = stream, compression, COMPRESSORS[compression]
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._counts: dict[int, int] = {}
        self._span: tuple[int, int] | None = None
        self._chunks: list[ChunkIndex] = []
        self._attachments: list[AttachmentIndex] = []
        self._metadata: list[MetadataIndex] = []
        self._pending = b""  # schemas and channels that the next chunk begins with
        self._offset = 0
        self._write(MAGIC + record_bytes(Header(profile="", library=LIBRARY)))

    def _write(self, *parts: Buffer) -> int:
        """Writes and flushes; returns where the first part begins."""
        start = self._offset
        for part in parts:
            self._stream.write(part)
            self._offset += len(part)
        self._stream.flush()
        return start

    def metadata(self, name: str, values: Mapping[str, str]) -> None:
        data = record_bytes(Metadata(name=name, metadata=dict(values)))
        self._metadata.append(MetadataIndex(offset=self._write(data), length=len(data), name=name))

    def attachment(self, attachment: Attachment) -> None:
        data = record_bytes(attachment)
        self._attachments.append(
            AttachmentIndex(
                offset=self._write(data),
                length=len(data),
                log_time=attachment.log_time,
                create_time=attachment.create_time,
                data_size=len(attachment.data),
                name=attachment.name,
                media_type=attachment.media_type,
            )
        )

    def schema(self, name: str, data: bytes) -> int:
        """Number of the schema with this name; made, and written with the next chunk, if it is new."""
        known = next((schema.id for schema in self._schemas.values() if schema.name == name), None)
        if known is not None:
            return known
        schema = Schema(id=len(self._schemas) + 1, data=data, encoding="protobuf", name=name)
        self._pending += record_bytes(schema)
        self.declare(schema)
        return schema.id

    def channel(self, topic: str, schema_id: int, metadata: Mapping[str, str]) -> int:
        """Number of a new channel; it is written with the next chunk."""
        channel = Channel(
            id=len(self._channels) + 1,
            topic=topic,
            message_encoding="protobuf",
            metadata=dict(metadata),
            schema_id=schema_id,
        )
        self._pending += record_bytes(channel)
        self.declare(channel)
        return channel.id

    def restore(self, record: Schema | Channel) -> None:
        """Takes a schema or channel with the number that it has; it is written with the next chunk."""
        self._pending += record_bytes(record)
        self.declare(record)

    def declare(self, record: Schema | Channel) -> None:
        """Takes a schema or channel whose record a chunk brings along itself into the summary."""
        if isinstance(record, Schema):
            self._schemas[record.id] = record
        else:
            self._channels[record.id] = record

    def chunk(self, parts: Sequence[Buffer], index: Mapping[int, np.ndarray]) -> None:
        """Writes one chunk.

        Parameters
        ----------
        parts : one after the other, complete Message records (and Schema and Channel records, each also given
            to ``declare``).
        index : per channel an array (n, 2) of uint64, n > 0: log time, and offset of the record in the parts.
            The arrays are the callee's from here on.
        """
        prefix, self._pending = self._pending, b""
        first = min(int(np.minimum.reduce(entries[:, 0])) for entries in index.values())
        last = max(int(np.maximum.reduce(entries[:, 0])) for entries in index.values())
        parts, size, crc = [prefix, *parts], 0, 0
        for part in parts:
            crc = crc32(part, crc)
            size += len(part)
        if self._compress is not None:  # without compression the parts are written as they are, not copied
            parts = [self._compress(b"".join(parts))]
        stored = sum(len(part) for part in parts)
        text = self._compression.encode()
        content = struct.pack("<QQQII", first, last, size, crc, len(text)) + text + struct.pack("<Q", stored)
        head = RECORD_HEAD.pack(Opcode.CHUNK, len(content) + stored) + content
        start = self._write(head, *parts)
        begin = self._offset
        self._chunks.append(
            ChunkIndex(
                chunk_length=begin - start,
                chunk_start_offset=start,
                compression=self._compression,
                compressed_size=stored,
                message_end_time=last,
                message_index_offsets=self._write_indexes(index, len(prefix)),
                message_index_length=self._offset - begin,
                message_start_time=first,
                uncompressed_size=size,
            )
        )
        self._span = (
            (first, last) if self._span is None else (min(self._span[0], first), max(self._span[1], last))
        )

    def _write_indexes(self, index: Mapping[int, np.ndarray], shift: int) -> dict[int, int]:
        """Writes the chunk's MessageIndex records; returns where in the file each begins."""
        offsets: dict[int, int] = {}
        parts: list[Buffer] = []
        position = self._offset
        for channel, entries in index.items():
            if shift:
                entries[:, 1] += np.uint64(shift)
            head = struct.pack("<BQHI", Opcode.MESSAGE_INDEX, 6 + entries.nbytes, channel, entries.nbytes)
            parts += [head, entries.data.cast("B")]
            offsets[channel] = position
            position += len(head) + entries.nbytes
            self._counts[channel] = self._counts.get(channel, 0) + len(entries)
        self._write(*parts)
        return offsets

    def finish(self) -> None:
        """Writes the summary and the footer.  The stream stays open."""
        if self._pending:  # channels that never had a message: a file may hold them outside of chunks
            self._write(self._pending)
        self._write(record_bytes(DataEnd(data_section_crc=0)))
        first, last = self._span or (0, 0)
        statistics = Statistics(
            attachment_count=len(self._attachments),
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=len(self._chunks),
            message_count=sum(self._counts.values()),
            message_end_time=last,
            message_start_time=first,
            metadata_count=len(self._metadata),
            schema_count=len(self._schemas),
        )
        groups: list[tuple[Opcode, list[McapRecord]]] = [
            (Opcode.SCHEMA, list(self._schemas.values())),
            (Opcode.CHANNEL, list(self._channels.values())),
            (Opcode.STATISTICS, [statistics]),
            (Opcode.CHUNK_INDEX, list(self._chunks)),
            (Opcode.ATTACHMENT_INDEX, list(self._attachments)),
            (Opcode.METADATA_INDEX, list(self._metadata)),
        ]
        start, summary, offsets = self._offset, b"", b""
        for opcode, records in groups:
            group = b"".join(record_bytes(record) for record in records)
            if group:
                offsets += record_bytes(SummaryOffset(opcode, start + len(summary), len(group)))
            summary += group
        offset_start = start + len(summary)
        summary += offsets
        covered = summary + struct.pack("<BQQQ", Opcode.FOOTER, 20, start, offset_start)
        footer = Footer(summary_start=start, summary_offset_start=offset_start, summary_crc=crc32(covered))
        self._write(summary + record_bytes(footer) + MAGIC)


class ChunkHead(NamedTuple):
    """What stands before a chunk's data, which is ``content[start:stop]``, and ``size`` bytes in clear."""

    first_ns: int
    last_ns: int
    size: int
    crc: int
    compression: str
    start: int
    stop: int

    @classmethod
    def read(cls, content: memoryview) -> ChunkHead:
        """Of a Chunk record's content, which may be cut off.  Raises struct.error if the head itself is."""
        first_ns, last_ns, size, crc, text = struct.unpack_from("<QQQII", content)
        compression = str(content[32 : 32 + text], "utf-8")
        (length,) = struct.unpack_from("<Q", content, 32 + text)
        return cls(first_ns, last_ns, size, crc, compression, 40 + text, 40 + text + length)


def parse(kind: Any, content: Buffer) -> Any:
    """A record of one of ``mcap.records``' classes from its content."""
    return kind.read(ReadDataStream(BytesIO(content)))


class Raw(NamedTuple):
    """A record as it stands in a buffer: ``data[start:stop]`` is its content."""

    opcode: int
    start: int
    stop: int


def walk(data: Buffer, start: int = 0) -> Iterator[Raw]:
    """The whole records in ``data`` from ``start`` on; ends before the first that is cut off."""
    size = len(data)
    while start + RECORD_HEAD.size <= size:
        opcode, length = RECORD_HEAD.unpack_from(data, start)
        start += RECORD_HEAD.size
        if opcode == 0 or length > size - start:
            return
        yield Raw(opcode, start, start + length)
        start += length


def decompress(compression: str, data: Buffer, size: int) -> Buffer:
    """Content of a chunk.

    Raises ValueError if it is damaged, of another size, of unknown compression, or larger than a chunk may
    be: whatever a header claims, not more than that is unpacked.
    """
    if compression not in COMPRESSORS:
        raise ValueError(f"compression {compression!r} is not known; known: lz4, zstd")
    check_size(size, len(data))
    content = data if compression == "" else unpack(compression, data, size + 1)
    if len(content) != size:
        more = "more than " if len(content) > size else ""
        raise ValueError(f"is {more}{min(len(content), size)} bytes long, its header says {size}")
    return content


def check_size(size: int, stored: int) -> None:
    """Raises ValueError where a chunk claims more than one may hold, as one does that is to fill memory."""
    if size > MOST_BYTES or size > max(FREE_BYTES, MOST_RATIO * stored):
        limit = min(MOST_BYTES, max(FREE_BYTES, MOST_RATIO * stored))
        raise ValueError(f"a chunk of {stored} bytes claims to hold {size}; the limit for it is {limit}")


def unpack(compression: str, data: Buffer, most: int) -> bytes:
    """What can be unpacked of data that may be cut off, at most so many bytes.  Raises ValueError."""
    try:
        if compression == "lz4":
            return lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=most)
        with zstandard.ZstdDecompressor(max_window_size=MOST_BYTES).stream_reader(data) as reader:
            return reader.read(most)
    except (RuntimeError, EOFError, zstandard.ZstdError, MemoryError) as error:
        raise ValueError(f"cannot be decompressed ({error})") from error


def forget_pages(data: mmap.mmap | bytes, start: int, stop: int) -> None:
    """Gives pages of a mapped file back: they count as this process's memory while they are mapped."""
    if isinstance(data, mmap.mmap) and hasattr(data, "madvise"):
        start -= start % mmap.PAGESIZE
        if stop > start:
            data.madvise(mmap.MADV_DONTNEED, start, stop - start)
