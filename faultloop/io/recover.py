"""Bringing back a log that was cut off: everything up to its last whole message, as a complete log."""

from __future__ import annotations

import struct
import zlib
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import lz4.frame
import numpy as np
import zstandard
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Metadata, Schema

from faultloop.errors import InputError
from faultloop.io.mcap_file import (
    COMPRESSORS,
    DAMAGE,
    LOG_RECORD,
    MAGIC,
    MESSAGE_HEAD,
    RECORD_HEAD,
    Buffer,
    ChunkHead,
    McapFile,
    Raw,
    decompress,
    parse,
    walk,
)
from faultloop.io.mcap_reader import map_file

LOOSE_BYTES = 1 << 20  # messages outside of chunks are put into chunks of about this size


@dataclass
class Recovered:
    """What came back.

    Attributes
    ----------
    source, out : file read (the ``.part`` that a killed run leaves, if there is no log), file written.
    whole : the source was complete; nothing was lost.
    messages : number of messages brought back, per topic.
    last_t_ns : time of the last of them [ns since the start of the run], None without messages.
    cut_bytes : how much there is of the last record, which was cut off; its whole messages are brought back.
    damaged : chunks, attachments and messages left out because their checksum or their content is wrong.
    """

    source: Path
    out: Path
    whole: bool = False
    messages: Counter[str] = field(default_factory=Counter)
    last_t_ns: int | None = None
    cut_bytes: int = 0
    damaged: int = 0

    def __str__(self) -> str:
        count = sum(self.messages.values())
        last = "" if self.last_t_ns is None else f", the last at {self.last_t_ns / 1e9:.6f} s"
        cut = f"; the last record was cut off after {self.cut_bytes} bytes" if self.cut_bytes else ""
        damaged = f"; {self.damaged} damaged records left out" if self.damaged else ""
        topics = len(self.messages)
        return f"{self.source} -> {self.out}: {count} messages on {topics} topics{last}{cut}{damaged}"


class Salvage:
    """Copies the sound records of one file into another."""

    def __init__(self, result: Recovered, target: McapFile) -> None:
        self.result, self.target = result, target
        self.topics: dict[int, str] = {}
        self.schemas: set[int] = {0}
        self.start_ns: int | None = None
        self.first_ns = self.last_ns = -1
        self.parts: list[Buffer] = []  # of the chunk in the making
        self.places: dict[int, list[tuple[int, int]]] = {}
        self.size = 0

    def take(self, records: Buffer) -> int:
        """Copies the whole and sound records of a chunk's content; returns where they end."""
        begin = end = 0
        for record in walk(records):
            end = record.stop
            if not self._sound(record, records, self.size - begin):
                self.result.damaged += 1
                self._keep(records, begin, record.start - RECORD_HEAD.size)
                begin = end
        self._keep(records, begin, end)
        return end

    def _keep(self, records: Buffer, begin: int, end: int) -> None:
        if end > begin:
            self.parts.append(records[begin:end])
            self.size += end - begin

    def _sound(self, record: Raw, records: Buffer, shift: int) -> bool:
        """Whether a record can be kept; notes the place (its own plus ``shift``) of a message that can."""
        try:
            if record.opcode == Opcode.MESSAGE:
                offset = record.start - RECORD_HEAD.size
                _, length, channel, _, log_ns, _ = MESSAGE_HEAD.unpack_from(records, offset)
                if length < MESSAGE_HEAD.size - RECORD_HEAD.size or channel not in self.topics:
                    return False
                self.places.setdefault(channel, []).append((log_ns, offset + shift))
                self.last_ns = max(self.last_ns, log_ns)
            elif record.opcode == Opcode.SCHEMA:
                schema: Schema = parse(Schema, records[record.start : record.stop])
                self.schemas.add(schema.id)
                self.target.declare(schema)
            elif record.opcode == Opcode.CHANNEL:
                channel_record: Channel = parse(Channel, records[record.start : record.stop])
                if channel_record.schema_id not in self.schemas:
                    return False
                self.topics[channel_record.id] = channel_record.topic
                self.target.declare(channel_record)
        except DAMAGE:
            return False
        return True

    def flush(self) -> None:
        """Writes the chunk in the making; without a message in it, its records wait for the next one."""
        if not self.places:
            return
        for channel, pairs in self.places.items():
            self.result.messages[self.topics[channel]] += len(pairs)
            self.first_ns = min(pairs[0][0], self.first_ns) if self.first_ns >= 0 else pairs[0][0]
        self.target.chunk(self.parts, {c: np.array(pairs, np.uint64) for c, pairs in self.places.items()})
        self.parts, self.places, self.size = [], {}, 0

    def chunk(self, content: memoryview) -> None:
        """A whole Chunk record."""
        try:
            head = ChunkHead.read(content)
            records = decompress(head.compression, content[head.start : head.stop], head.size)
            if head.crc and zlib.crc32(records) != head.crc:
                raise ValueError("checksum")
        except DAMAGE:
            self.result.damaged += 1
            return
        self.flush()
        self.take(records)
        self.flush()

    def cut_chunk(self, content: memoryview) -> None:
        """What there is of the last Chunk record."""
        try:
            head = ChunkHead.read(content)
        except DAMAGE:
            return
        if head.stop <= len(content):  # all there: it is the record's length that is wrong
            self.chunk(content)
            return
        data = content[head.start :]
        try:
            if head.compression == "zstd":
                data = zstandard.ZstdDecompressor().decompressobj().decompress(data)
            elif head.compression == "lz4":
                data = lz4.frame.LZ4FrameDecompressor().decompress(data)
        except (RuntimeError, zstandard.ZstdError, MemoryError):
            return
        self.flush()
        self.take(data[: head.size])
        self.flush()

    def other(self, record: Raw, data: memoryview) -> None:
        """A record that is no chunk."""
        content = data[record.start : record.stop]
        try:
            if record.opcode == Opcode.METADATA:
                metadata = parse(Metadata, content)
                if metadata.name == LOG_RECORD and metadata.metadata.get("start_ns", "").isdecimal():
                    self.start_ns = int(metadata.metadata["start_ns"])
                self.target.metadata(metadata.name, metadata.metadata)
            elif record.opcode == Opcode.ATTACHMENT:
                (crc,) = struct.unpack("<I", content[-4:])
                if crc and crc != zlib.crc32(content[:-4]):
                    raise ValueError("checksum")
                self.target.attachment(parse(Attachment, content))
            elif record.opcode in (Opcode.MESSAGE, Opcode.SCHEMA, Opcode.CHANNEL):
                self.take(data[record.start - RECORD_HEAD.size : record.stop])
                if self.size > LOOSE_BYTES:
                    self.flush()
        except DAMAGE:
            self.result.damaged += 1


def recover_log(broken: str | Path, out: str | Path) -> Recovered:
    """Writes to ``out`` a complete log of everything whole in ``broken``.

    If ``broken`` does not exist, ``broken.part`` (what a killed run leaves) is taken.  A complete log of
    faultloop comes out as the same bytes.  Raises InputError if the input cannot be read, is not MCAP, or is
    the output.
    """
    source, out = Path(broken), Path(out)
    part = Path(f"{source}.part")
    if not source.exists() and part.exists():
        source = part
    data = memoryview(map_file(source))
    if out.exists() and out.samefile(source):
        raise InputError("is the output too; give another output file", file=source)
    if out.exists() and not out.is_file():
        raise InputError("is no regular file; a log needs a file's name", file=out)
    aside = out.with_name(out.name + ".recovering")  # not .part: that may be the source
    result = Recovered(source, out)
    try:
        with aside.open("wb") as stream:
            _salvage(data, Salvage(result, McapFile(stream, _compression(data))))
    except OSError as error:
        aside.unlink(missing_ok=True)
        raise InputError(f"cannot be written: {error.strerror}", file=aside) from error
    aside.replace(out)
    return result


def _compression(data: memoryview) -> str:
    """That of the first chunk, so that chunks come out as they went in."""
    for record in walk(data, len(MAGIC)):
        if record.opcode == Opcode.CHUNK:
            try:
                found = ChunkHead.read(data[record.start : record.stop]).compression
            except DAMAGE:
                continue
            return found if found in COMPRESSORS else ""
    return ""


def _salvage(data: memoryview, salvage: Salvage) -> None:
    result, end = salvage.result, len(MAGIC)
    for record in walk(data, len(MAGIC)):
        end = record.stop
        if record.opcode == Opcode.DATA_END:  # what follows is the summary, which is made anew
            result.whole = data[-len(MAGIC) :] == MAGIC and result.damaged == 0
            break
        if record.opcode == Opcode.CHUNK:
            salvage.chunk(data[record.start : record.stop])
        else:
            salvage.other(record, data)
    else:
        result.cut_bytes = len(data) - end
        if len(data) - end > RECORD_HEAD.size and data[end] == Opcode.CHUNK:
            salvage.cut_chunk(data[end + RECORD_HEAD.size :])
    salvage.flush()
    if not result.whole:
        lost = {"cut_bytes": str(result.cut_bytes), "damaged_records": str(result.damaged)}
        salvage.target.metadata("recovered", lost)
    salvage.target.finish()
    if salvage.last_ns >= 0:
        start_ns = salvage.start_ns if salvage.start_ns is not None else salvage.first_ns
        result.last_t_ns = salvage.last_ns - start_ns
