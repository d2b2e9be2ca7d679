"""Bringing back a log that was cut off: everything up to its last whole message, as a complete log."""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Metadata, Schema, Statistics
from mcap_protobuf.decoder import DecoderFactory

from faultloop.errors import InputError
from faultloop.io.crc import crc32
from faultloop.io.mcap_contents import Summary
from faultloop.io.mcap_file import (
    COMPRESSORS,
    DAMAGE,
    FOOTER_SIZE,
    LOG_RECORD,
    MAGIC,
    MESSAGE_HEAD,
    RECORD_HEAD,
    Buffer,
    ChunkHead,
    McapFile,
    Raw,
    check_size,
    decompress,
    forget_pages,
    parse,
    record_bytes,
    unpack,
    walk,
)
from faultloop.io.mcap_reader import MOST_NS, map_file
from faultloop.io.messages import message_of
from faultloop.io.output_file import parts_of, write_aside

FORGET_BYTES = 1 << 26  # of the source, after which its pages are given back
FOOTER_HEAD = (Opcode.FOOTER, FOOTER_SIZE - RECORD_HEAD.size)
LOOSE_BYTES = 1 << 20  # messages outside of chunks are put into chunks of about this size


@dataclass
class Recovered:
    """What came back.

    Attributes
    ----------
    source, out : file read (the newest ``.part`` that killed runs left, if there is no log), file written.
    others : older ``.part`` files of the same log, which are not in it.
    whole : the source was complete; nothing was lost.
    messages : number of messages brought back, per topic.
    last_t_ns : time of the last of them [ns since the start of the run], None without messages.
    cut_bytes : how much there is of the last record, which was cut off; its whole messages are brought back.
    damaged : chunks, attachments and messages left out because their checksum or their content is wrong.
    warnings : what is not in the log written, one line each.
    """

    source: Path
    out: Path
    others: tuple[Path, ...] = ()
    whole: bool = False
    messages: Counter[str] = field(default_factory=Counter)
    last_t_ns: int | None = None
    cut_bytes: int = 0
    damaged: int = 0
    warnings: list[str] = field(default_factory=list)

    def left_out(self, what: str, count: int = 1) -> None:
        """Notes something damaged."""
        self.damaged += count
        if what not in self.warnings:
            self.warnings.append(what)

    def __str__(self) -> str:
        count = sum(self.messages.values())
        last = "" if self.last_t_ns is None else f", the last at {self.last_t_ns / 1e9:.6f} s"
        cut = f"; the last record was cut off after {self.cut_bytes} bytes" if self.cut_bytes else ""
        damaged = f"; {self.damaged} damaged records left out" if self.damaged else ""
        topics = len(self.messages)
        others = f"; not taken, as older: {', '.join(map(str, self.others))}" if self.others else ""
        return f"{self.source} -> {self.out}: {count} messages on {topics} topics{last}{cut}{damaged}{others}"


class Salvage:
    """Copies the sound records of one file into another.

    ``known``: its summary, if that is sound; it repeats the schemas and channels that a damaged chunk had.
    """

    def __init__(self, result: Recovered, target: McapFile, known: Summary) -> None:
        self.result, self.target, self.known = result, target, known
        self.topics: dict[int, str] = {}
        self.counts: Counter[int] = Counter()  # messages written, by channel
        self.schemas: dict[int, Schema | None] = {0: None}
        self.start_ns: int | None = None
        self.first_ns = self.last_ns = -1
        self.decoders = DecoderFactory()
        self.decode: dict[int, Callable[[bytes], object] | None] = {}  # of our topics, by channel
        self.parts: list[Buffer] = []  # of the chunk in the making
        self.places: dict[int, list[tuple[int, int]]] = {}
        self.size = 0

    def take(self, records: Buffer, *, sealed: bool) -> int:
        """Copies the whole and sound records of a chunk's content; returns where they end.

        What no checksum has sealed is looked into, message by message.
        """
        begin = end = 0
        for record in walk(records):
            end = record.stop
            if not (
                (sealed or said_again(self.known, record, records))
                and self._sound(record, records, self.size - begin)
                and (sealed or self._readable(record, records))
            ):
                self.result.left_out(self._what(record, records))
                self._keep(records, begin, record.start - RECORD_HEAD.size)
                begin = end
        self._keep(records, begin, end)
        return end

    def _what(self, record: Raw, records: Buffer) -> str:
        """What to call a record that is left out."""
        if record.opcode != Opcode.MESSAGE or record.stop - record.start < MESSAGE_HEAD.size:
            return "records that are no messages are damaged and left out"
        _, _, channel, *_ = MESSAGE_HEAD.unpack_from(records, record.start - RECORD_HEAD.size)
        return f"{self.topics.get(channel, f'channel {channel}')}: messages are damaged and left out"

    def _keep(self, records: Buffer, begin: int, end: int) -> None:
        if end > begin:
            self.parts.append(records[begin:end])
            self.size += end - begin

    def _readable(self, record: Raw, records: Buffer) -> bool:
        """Whether a message of ours is what its schema says.  Called after ``_sound``."""
        if record.opcode != Opcode.MESSAGE:
            return True
        offset = record.start - RECORD_HEAD.size
        _, _, channel, _, _, _ = MESSAGE_HEAD.unpack_from(records, offset)
        try:
            decode = self.decode.get(channel)
            if decode is not None:
                decode(bytes(records[offset + MESSAGE_HEAD.size : record.stop]))
        except DAMAGE:
            self.places[channel].pop()
            if not self.places[channel]:
                del self.places[channel]
            return False
        return True

    def _decoder(self, channel: Channel) -> Callable[[bytes], object] | None:
        schema = self.schemas[channel.schema_id]
        if message_of(channel.topic) is None:
            return None
        decode = self.decoders.decoder_for(channel.message_encoding, schema)
        if decode is None:
            raise ValueError("encoding")
        return decode

    def _sound(self, record: Raw, records: Buffer, shift: int) -> bool:
        """Whether a record can be kept; notes the place (its own plus ``shift``) of a message that can."""
        try:
            if record.opcode == Opcode.MESSAGE:
                offset = record.start - RECORD_HEAD.size
                _, length, channel, _, log_ns, _ = MESSAGE_HEAD.unpack_from(records, offset)
                if channel not in self.topics:
                    self._restore(channel)
                if length < MESSAGE_HEAD.size - RECORD_HEAD.size or channel not in self.topics:
                    return False
                if log_ns > MOST_NS:
                    return False
                self.places.setdefault(channel, []).append((log_ns, offset + shift))
                self.last_ns = max(self.last_ns, log_ns)
            elif record.opcode == Opcode.SCHEMA:
                schema: Schema = parse(Schema, records[record.start : record.stop])
                self.schemas[schema.id] = schema
                self.target.declare(schema)
            elif record.opcode == Opcode.CHANNEL:
                channel_record: Channel = parse(Channel, records[record.start : record.stop])
                if channel_record.schema_id not in self.schemas:
                    return False
                self.decode[channel_record.id] = self._decoder(channel_record)
                self.topics[channel_record.id] = channel_record.topic
                self.target.declare(channel_record)
        except DAMAGE:
            return False
        return True

    def _restore(self, number: int) -> None:
        """A channel, and its schema, that only the summary still has."""
        for channel in self.known.channels:
            if channel.id != number:
                continue
            for schema in self.known.schemas:
                if schema.id == channel.schema_id and schema.id not in self.schemas:
                    self.schemas[schema.id] = schema
                    self.target.restore(schema)
            self.decode[number] = self._decoder(channel)
            self.topics[number] = channel.topic
            self.target.restore(channel)

    def flush(self) -> None:
        """Writes the chunk in the making; without a message in it, its records wait for the next one."""
        if not self.places:
            return
        for channel, pairs in self.places.items():
            self.counts[channel] += len(pairs)
            self.result.messages[self.topics[channel]] += len(pairs)
            self.first_ns = min(pairs[0][0], self.first_ns) if self.first_ns >= 0 else pairs[0][0]
        self.target.chunk(self.parts, {c: np.array(pairs, np.uint64) for c, pairs in self.places.items()})
        self.parts, self.places, self.size = [], {}, 0

    def chunk(self, content: memoryview, place: int) -> None:
        """A whole Chunk record, of which ``content`` begins at byte ``place``."""
        try:
            head = ChunkHead.read(content)
            records = decompress(head.compression, content[head.start : head.stop], head.size)
            if head.crc and crc32(records) != head.crc:
                raise ValueError("checksum")
        except DAMAGE:
            self.result.left_out(f"the chunk at byte {place} is damaged and left out")
            return
        self.flush()
        end = self.take(records, sealed=bool(head.crc))
        if end != len(records):
            self.result.left_out(f"the end of the chunk at byte {place} is damaged and left out")
        self.flush()

    def cut_chunk(self, content: memoryview, place: int) -> None:
        """What there is of the last Chunk record, of which ``content`` begins at byte ``place``."""
        try:
            head = ChunkHead.read(content)
        except DAMAGE:
            return
        if head.stop <= len(content):  # all there: it is the record's length that is wrong
            self.chunk(content, place)
            return
        data: Buffer = content[head.start :]
        try:
            check_size(head.size, head.stop - head.start)
            if head.compression:
                data = unpack(head.compression, data, head.size)
        except DAMAGE:
            self.result.left_out(f"the chunk at byte {place} is damaged and left out")
            return
        self.flush()
        self.take(data[: head.size], sealed=False)
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
                if crc and crc != crc32(content[:-4]):
                    raise ValueError("checksum")
                self.target.attachment(parse(Attachment, content))
            elif record.opcode == Opcode.MESSAGE_INDEX:  # made anew; but no other record may pass for one
                if struct.unpack_from("<I", content, 2) != (len(content) - 6,) or (len(content) - 6) % 16:
                    raise ValueError("index")
            elif record.opcode in (Opcode.MESSAGE, Opcode.SCHEMA, Opcode.CHANNEL):
                self.take(data[record.start - RECORD_HEAD.size : record.stop], sealed=False)
                if self.size > LOOSE_BYTES:
                    self.flush()
            elif record.opcode != Opcode.HEADER or record.start != len(MAGIC) + RECORD_HEAD.size:
                raise ValueError("kind")
        except DAMAGE:
            kind = OTHER_RECORDS.get(record.opcode, "a record of no kind that belongs there")
            self.result.left_out(f"{kind} at byte {record.start} is damaged and left out")


def said_again(known: Summary, record: Raw, records: Buffer) -> bool:
    """Whether a schema or a channel is what the summary, which has a checksum, says again, and byte for byte
    as it is written: behind one whose own length is wrong lie messages, and a length in it that is wrong has
    another reader take what follows for its text."""
    if record.opcode not in (Opcode.SCHEMA, Opcode.CHANNEL):
        return True
    kind, again = (Schema, known.schemas) if record.opcode == Opcode.SCHEMA else (Channel, known.channels)
    content = bytes(records[record.start : record.stop])
    try:
        found = parse(kind, content)
    except DAMAGE:
        return False
    whole = record_bytes(found)[RECORD_HEAD.size :] == content
    return whole and all(one == found for one in again if one.id == found.id)


OTHER_RECORDS: dict[int, str] = {
    Opcode.METADATA: "a metadata record",
    Opcode.ATTACHMENT: "an attachment",
    Opcode.MESSAGE_INDEX: "a message index",
}


def recover_log(broken: str | Path, out: str | Path) -> Recovered:
    """Writes to ``out`` a complete log of everything whole in ``broken``.

    If ``broken`` does not exist, the newest ``broken.part``, ``broken.2.part`` ... (what killed runs leave)
    is taken.  A complete log of faultloop comes out as the same bytes.  Raises InputError if the input cannot
    be read, is not MCAP, or is the output.
    """
    source, out = Path(broken), Path(out)
    parts = [] if source.exists() else parts_of(source)
    if parts:
        source = parts[0]
    mapped = map_file(source)
    data = memoryview(mapped)
    if out.exists() and out.samefile(source):
        raise InputError("is the output too; give another output file", file=source)
    result = Recovered(source, out, others=tuple(parts[1:]))
    if result.others:
        result.warnings.append(f"not taken, as older: {', '.join(map(str, result.others))}")
    with write_aside(out) as aside, aside.open("wb") as stream:
        salvage = Salvage(result, McapFile(stream, _compression(data)), _summary(data))
        _salvage(data, salvage, partial(forget_pages, mapped))
    return result


def _summary(data: memoryview) -> Summary:
    """Of a log that was closed; an empty one where there is none, or none that can be trusted."""
    footer = len(data) - len(MAGIC) - FOOTER_SIZE
    try:
        opcode, length, begin, _, crc = struct.unpack_from("<BQQQI", data, footer)
        if data[-len(MAGIC) :] == MAGIC and (opcode, length) == FOOTER_HEAD and begin and crc:
            return Summary.read(data, begin, footer)
    except DAMAGE:
        pass
    return Summary()


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


def _salvage(data: memoryview, salvage: Salvage, forget: Callable[[int, int], None]) -> None:
    result, end, seen = salvage.result, len(MAGIC), 0
    for record in walk(data, len(MAGIC)):
        end = record.stop
        if _ends_the_data(record, data):  # what follows is the summary, which is made anew
            salvage.flush()
            closed = data[-len(MAGIC) :] == MAGIC
            if closed:
                _tell_missing(data, end, salvage)
            result.whole = closed and result.damaged == 0
            result.cut_bytes = 0 if closed else len(data) - end
            break
        if record.opcode == Opcode.CHUNK:
            salvage.chunk(data[record.start : record.stop], record.start)
        else:
            salvage.other(record, data)
        if end - seen > FORGET_BYTES and not salvage.parts:
            forget(seen, end)
            seen = end
    else:
        result.cut_bytes = len(data) - end
        if len(data) - end > RECORD_HEAD.size and data[end] == Opcode.CHUNK:
            salvage.cut_chunk(data[end + RECORD_HEAD.size :], end + RECORD_HEAD.size)
    salvage.flush()
    if result.cut_bytes:
        result.warnings.append(f"the log was cut off: its last {result.cut_bytes} bytes are no whole record")
    if not result.whole:
        lost = {"cut_bytes": str(result.cut_bytes), "damaged_records": str(result.damaged)}
        salvage.target.metadata("recovered", lost)
    salvage.target.finish()
    if salvage.last_ns >= 0:
        start_ns = salvage.start_ns if salvage.start_ns is not None else salvage.first_ns
        result.last_t_ns = salvage.last_ns - start_ns


def _ends_the_data(record: Raw, data: memoryview) -> bool:
    """Whether a record is the DataEnd of a file: behind it is a summary, whole or cut off, and no message."""
    if record.opcode != Opcode.DATA_END or record.stop - record.start != 4:
        return False
    messages = (Opcode.CHUNK, Opcode.MESSAGE, Opcode.DATA_END)
    return all(after.opcode not in messages for after in walk(data, record.stop))


def _tell_missing(data: memoryview, begin: int, salvage: Salvage) -> None:
    """Notes the channels that have fewer messages than a sound summary counts."""
    result, footer = salvage.result, len(data) - len(MAGIC) - FOOTER_SIZE
    opcode, length, start, _, crc = struct.unpack_from("<BQQQI", data, footer)
    if (opcode, length) != FOOTER_HEAD:
        result.left_out("the footer is damaged: what the log should hold is not known")
        return
    if not start:
        return
    if start != begin or (crc and crc32(data[begin : footer + FOOTER_SIZE - 4]) != crc):
        result.left_out("the summary is damaged: what the log should hold is not known")
        return
    for record in walk(data, begin):
        if record.opcode == Opcode.STATISTICS:
            wanted = parse(Statistics, data[record.start : record.stop]).channel_message_counts
            for channel, count in wanted.items():
                if salvage.counts[channel] < count:
                    name = salvage.topics.get(channel, f"channel {channel}")
                    have = salvage.counts[channel]
                    result.left_out(f"{name}: {have} messages are there, the summary counts {count}")
            return
