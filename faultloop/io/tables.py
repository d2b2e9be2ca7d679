"""A log as tables: one Parquet or CSV file per topic, with units and times."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Protocol
from urllib.parse import quote

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from faultloop.io.mcap_reader import Log
from faultloop.io.messages import ELEMENTS, LEVELS, Field, message_of
from faultloop.io.output_file import OutputFiles, missing_folders

ROW_GROUP_BYTES = 1 << 25  # of the log, at a time
ARROW_TYPES = {
    "double": pa.float64(),
    "fixed64": pa.uint64(),
    "uint32": pa.uint32(),
    "fixed32": pa.uint32(),
    "bool": pa.bool_(),
    "string": pa.string(),
    "bytes": pa.binary(),
    "level": pa.string(),
}


def topic_table(log: Log, topic: str, from_ns: int | None = None, to_ns: int | None = None) -> pa.Table:
    """One topic, or a stretch of it, as an Arrow table.

    Columns: ``timestamp`` (UTC, ns), ``t_ns`` [ns since the start of the run], then the message's fields; the
    element bit sets are followed by one boolean column per element (``PDIS1.Str``, ``PDIS1.Op``).  A column's
    metadata has ``unit`` and ``description``, the table's the topic, the message and the start.
    """
    message = message_of(topic)
    rows = log.array(topic, from_ns, to_ns)
    assert message is not None  # log.array refuses other topics
    stamps = pa.array(rows["t_ns"] + log.start_ns, pa.timestamp("ns", tz="UTC"))
    columns: list[pa.Array] = [stamps, pa.array(rows["t_ns"])]
    columns += [_column(rows[field.name], field) for field in message.fields]
    columns += [
        pa.array((rows[word] >> np.uint64(bit) & np.uint64(1)).astype(bool))
        for _, word, bit in _bit_columns(log, topic)
    ]
    return pa.Table.from_arrays(columns, schema=topic_schema(log, topic))


def topic_schema(log: Log, topic: str) -> pa.Schema:
    """The columns of ``topic_table``."""
    message = message_of(topic)
    assert message is not None
    time = {"unit": "ns", "description": "time since the start of the run"}
    fields = [
        pa.field("timestamp", pa.timestamp("ns", tz="UTC"), metadata={"description": "simulated time"}),
        pa.field("t_ns", pa.int64(), metadata=time),
    ]
    fields += [
        pa.field(field.name, ARROW_TYPES[field.type], metadata={"unit": field.unit, "description": field.doc})
        for field in message.fields
    ]
    fields += [
        pa.field(name, pa.bool_(), metadata={"description": f"bit {bit} of {word}"})
        for name, word, bit in _bit_columns(log, topic)
    ]
    about = {"topic": topic, "message": message.full_name, "start_ns": str(log.start_ns)}
    return pa.schema(fields, metadata=about)


def _bit_columns(log: Log, topic: str) -> list[tuple[str, str, int]]:
    """Name, word and bit of each element, of the element topics; a name that is taken has none."""
    if message_of(topic) is not ELEMENTS:
        return []
    taken = {"", "timestamp", "t_ns", *(field.name for field in ELEMENTS.fields)}
    out = []
    for word, names in log.bits(topic.split("/")[2]).items():
        for bit, name in enumerate(names):
            if name not in taken:
                taken.add(name)
                out.append((name, word, bit))
    return out


def _column(values: np.ndarray, field: Field) -> pa.Array:
    if field.type == "level":
        return pa.array([LEVELS[level] if level < len(LEVELS) else str(level) for level in values.tolist()])
    return pa.array(values, ARROW_TYPES[field.type])


def table_path(topic: str, suffix: str) -> Path:
    """Where a topic's table goes: ``/relay/R1/samples`` to ``relay/R1/samples.csv``."""
    parts = [quote(part, safe=" +-_.()").replace("..", "%2E%2E") for part in topic.split("/") if part]
    return Path(*parts[:-1], parts[-1] + suffix)


class Writer(Protocol):
    """Takes the tables of one topic, one after the other."""

    def write_table(self, table: pa.Table) -> None: ...

    def close(self) -> None: ...


def write_parquet(log: Log, folder: str | Path) -> list[Path]:
    """Writes every topic of a log to ``folder`` as Parquet; returns the files.  Raises InputError."""
    return _write(log, Path(folder), ".parquet", pyarrow.parquet.ParquetWriter)


def write_csv(log: Log, folder: str | Path) -> list[Path]:
    """Writes every topic of a log to ``folder`` as CSV with one header line; bytes are hexadecimal.

    Numbers are written so that they read back as the same bits.  Raises InputError.
    """
    return _write(log, Path(folder), ".csv", _CsvWriter)


class _CsvWriter:
    def __init__(self, path: Path, schema: pa.Schema) -> None:
        for place, column in enumerate(schema):
            if pa.types.is_binary(column.type):
                schema = schema.set(place, pa.field(column.name, pa.string()))
        self._writer = pyarrow.csv.CSVWriter(path, schema)

    def write_table(self, table: pa.Table) -> None:
        for place, column in enumerate(table.schema):
            if pa.types.is_binary(column.type):
                texts = [value.hex() for value in table.column(place).to_pylist()]
                table = table.set_column(place, column.name, pa.array(texts, pa.string()))
        self._writer.write_table(table)

    def close(self) -> None:
        self._writer.close()


def _write(log: Log, folder: Path, suffix: str, opened: Callable[[Path, pa.Schema], Writer]) -> list[Path]:
    """All tables at once, stretch by stretch; they get their names when all of them are whole."""
    paths = {topic: folder / table_path(topic, suffix) for topic in log.topics if message_of(topic)}
    with ExitStack() as stack, OutputFiles(folder) as files:
        writers: dict[str, Writer] = {}
        with ExitStack() as closing:
            for topic, path in paths.items():
                stack.enter_context(missing_folders(path.parent))
                writers[topic] = opened(files.new(path), topic_schema(log, topic))
                closing.callback(writers[topic].close)
            for span in log.windows(ROW_GROUP_BYTES):
                for topic, writer in writers.items():
                    table = topic_table(log, topic, *span)
                    if len(table):
                        writer.write_table(table)
    return list(paths.values())
