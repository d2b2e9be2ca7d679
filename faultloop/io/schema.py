"""Protobuf schemas and record layouts, both derived from the table of messages at run time.

The every-sample messages are written without protobuf: each field is an 8-byte ``double`` or ``fixed64`` that
is always present, and both varints of the timestamp are padded to five bytes, so that a complete MCAP Message
record has a fixed layout and a NumPy structured array is a run of them.  Any protobuf parser reads it.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from typing import Any

import numpy as np
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory, timestamp_pb2
from mcap.opcode import Opcode
from numpy.typing import NDArray

from faultloop.io.messages import LEVELS, SAMPLED, Message
from faultloop.jit import njit

FieldProto = descriptor_pb2.FieldDescriptorProto
PROTO_TYPES = {
    "double": FieldProto.TYPE_DOUBLE,
    "fixed64": FieldProto.TYPE_FIXED64,
    "fixed32": FieldProto.TYPE_FIXED32,
    "uint32": FieldProto.TYPE_UINT32,
    "bool": FieldProto.TYPE_BOOL,
    "string": FieldProto.TYPE_STRING,
    "bytes": FieldProto.TYPE_BYTES,
    "level": FieldProto.TYPE_ENUM,
}
FIXED64 = 1  # protobuf wire type of double and fixed64
TIMESTAMP = "google/protobuf/timestamp.proto"

Records = Any
"""An array of records, as a kernel sees it."""
SECOND_NS = 1_000_000_000

# Sequence number to timestamp.
HEAD = np.dtype(
    [
        ("sequence", "<u4"),
        ("log_time", "<u8"),
        ("publish_time", "<u8"),
        ("stamp", "u1", (3,)),  # tag of field 1, its length, tag of seconds
        ("seconds", "u1", (5,)),
        ("nanos_tag", "u1"),
        ("nanos", "u1", (5,)),
    ]
)
STAMP_TAGS = (0x0A, 12, 0x08)
NANOS_TAG = 0x10


@cache
def file_descriptor(message: Message) -> descriptor_pb2.FileDescriptorProto:
    """The .proto file of one message."""
    package, _, name = message.full_name.rpartition(".")
    file = descriptor_pb2.FileDescriptorProto(
        name=f"{package}/{name}.proto", package=package, syntax="proto3", dependency=[TIMESTAMP]
    )
    proto = file.message_type.add(name=name)
    proto.field.add(
        name="timestamp",
        json_name="timestamp",
        number=1,
        label=FieldProto.LABEL_OPTIONAL,
        type=FieldProto.TYPE_MESSAGE,
        type_name=".google.protobuf.Timestamp",
    )
    for number, field in enumerate(message.fields, start=2):
        added = proto.field.add(
            name=field.name, number=number, label=FieldProto.LABEL_OPTIONAL, type=PROTO_TYPES[field.type]
        )
        if field.type == "level":
            added.type_name = f".{message.full_name}.Level"
            proto.enum_type.add(
                name="Level",
                value=[
                    descriptor_pb2.EnumValueDescriptorProto(name=x, number=i) for i, x in enumerate(LEVELS)
                ],
            )
    return file


@cache
def schema_bytes(message: Message) -> bytes:
    """The FileDescriptorSet, imports included, that MCAP keeps as the schema."""
    files = descriptor_pb2.FileDescriptorSet()
    timestamp_pb2.DESCRIPTOR.CopyToProto(files.file.add())
    files.file.append(file_descriptor(message))
    return files.SerializeToString(deterministic=True)


@cache
def message_class(message: Message) -> Any:
    """The protobuf class, for the rare messages and for reading."""
    pool = descriptor_pool.DescriptorPool()
    for file in descriptor_pb2.FileDescriptorSet.FromString(schema_bytes(message)).file:
        pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(message.full_name))


@cache
def record_dtype(message: Message) -> np.dtype:
    """A whole MCAP Message record, opcode to last field, of an every-sample message; packed."""
    slot = np.dtype([("tag", "u1"), ("value", "<u8")])
    return np.dtype(
        [
            ("opcode", "u1"),
            ("length", "<u8"),
            ("channel", "<u2"),
            ("head", HEAD),
            ("body", slot, (len(message.fields),)),
        ]
    )


@cache
def row_dtype() -> np.dtype:
    """What one sample of one relay writes: the records of all every-sample messages, side by side."""
    return np.dtype([(message.name, record_dtype(message)) for message in SAMPLED])


def record_offset(message: Message) -> int:
    """Where in a row (``row_dtype``) the record of this message begins."""
    before = SAMPLED[: SAMPLED.index(message)]
    return sum(record_dtype(earlier).itemsize for earlier in before)


def tags(message: Message) -> np.ndarray:
    """Tag byte of each field of ``body``."""
    return np.array([number << 3 | FIXED64 for number in range(2, len(message.fields) + 2)], dtype="u1")


def row_template(channels: Iterable[int]) -> np.ndarray:
    """One row (shape ``()``) with all that every sample has in common; ``channels`` as in ``SAMPLED``."""
    row = np.zeros((), row_dtype())
    for message, channel in zip(SAMPLED, channels, strict=True):
        record = row[message.name]
        record["opcode"] = Opcode.MESSAGE
        record["length"] = record.dtype.itemsize - 9
        record["channel"] = channel
        record["head"]["stamp"], record["head"]["nanos_tag"] = STAMP_TAGS, NANOS_TAG
        record["body"]["tag"] = tags(message)
    return row


@njit
def put_heads(head: Records, at: int, first: int, t_ns: NDArray[np.int64], start_ns: int) -> None:
    """The heads (``HEAD``) of one message's records in rows that are the template's, from row ``at`` on:
    numbered from ``first`` on, at ``t_ns`` after ``start_ns`` [ns since 1970]."""
    for row in range(t_ns.shape[0]):
        log_ns = start_ns + t_ns[row]
        seconds = log_ns // SECOND_NS
        nanos = log_ns - SECOND_NS * seconds
        own = head[at + row]
        own.sequence = first + row
        own.log_time = log_ns
        own.publish_time = log_ns
        for byte in range(5):  # varints, padded: all but the last byte carry the continuation bit
            more = 0x80 if byte < 4 else 0
            own.seconds[byte] = (seconds >> (7 * byte)) & 0x7F | more
            own.nanos[byte] = (nanos >> (7 * byte)) & 0x7F | more


@njit
def put_values(body: NDArray[np.uint64], at: int, values: NDArray[np.uint64]) -> None:
    """Eight-byte values (n, k) into as many fields of one message's records, from row ``at`` on."""
    for row in range(values.shape[0]):
        for field in range(values.shape[1]):
            body[at + row, field] = values[row, field]


@njit
def put_places(
    places: NDArray[np.uint64],
    t_ns: NDArray[np.int64],
    start_ns: int,
    first: int,
    row_bytes: int,
    offsets: NDArray[np.int64],
) -> None:
    """Log time and place of every record of rows at ``t_ns`` after ``start_ns``, (messages, n, 2): the first
    row's place is ``first``, the records' in a row ``offsets`` (messages,)."""
    for message in range(offsets.shape[0]):
        for row in range(t_ns.shape[0]):
            places[message, row, 0] = start_ns + t_ns[row]
            places[message, row, 1] = first + row * row_bytes + offsets[message]


@cache
def _fixed_bytes(message: Message, channel: int) -> tuple[np.ndarray, np.ndarray]:
    """Where a record of this channel has always the same bytes, and which."""
    dtype = record_dtype(message)
    record, mask = np.zeros((), dtype), np.zeros((), dtype)
    for one, opcode, length, number, stamp, nanos, tag in (
        (record, Opcode.MESSAGE, dtype.itemsize - 9, channel, STAMP_TAGS, NANOS_TAG, tags(message)),
        (mask, 0xFF, 2**64 - 1, 0xFFFF, 0xFF, 0xFF, 0xFF),
    ):
        one["opcode"], one["length"], one["channel"] = opcode, length, number
        one["head"]["stamp"], one["head"]["nanos_tag"], one["body"]["tag"] = stamp, nanos, tag
    where = np.flatnonzero(np.frombuffer(mask.tobytes(), np.uint8))
    return where, np.frombuffer(record.tobytes(), np.uint8)[where]


def is_fixed_layout(records: np.ndarray, message: Message, channel: int) -> bool:
    """Whether every record of ``records`` (of ``record_dtype``) is this channel's, laid out as here."""
    where, wanted = _fixed_bytes(message, channel)
    return _all_have(records.view([("bytes", "u1", (records.dtype.itemsize,))])["bytes"], where, wanted)


@njit
def _all_have(content: NDArray[np.uint8], where: NDArray[np.int64], wanted: NDArray[np.uint8]) -> bool:
    """Whether every row of ``content`` has the ``wanted`` bytes there: no copy, a fifth of NumPy's time."""
    for row in range(content.shape[0]):
        for k in range(where.shape[0]):
            if content[row, where[k]] != wanted[k]:
                return False
    return True
