"""A log as tables: one Parquet or CSV file per topic, with units and times."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from urllib.parse import quote

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from faultloop.errors import InputError
from faultloop.io.mcap_reader import Log
from faultloop.io.messages import ELEMENTS, LEVELS, Field, message_of

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


def topic_table(log: Log, topic: str) -> pa.Table:
    """One topic as an Arrow table.

    Columns: ``timestamp`` (UTC, ns), ``t_ns`` [ns since the start of the run], then the message's fields; the
    element bit sets are followed by one boolean column per element (``PDIS1.Str``, ``PDIS1.Op``).  A column's
    metadata has ``unit`` and ``description``, the table's the topic, the message and the start.
    """
    message = message_of(topic)
    rows = log.array(topic)
    assert message is not None  # log.array refuses other topics
    columns: list[pa.Array] = [
        pa.array(rows["t_ns"] + log.start_ns, pa.timestamp("ns", tz="UTC")),
        pa.array(rows["t_ns"]),
    ]
    fields = [
        pa.field("timestamp", columns[0].type, metadata={"description": "simulated time"}),
        pa.field(
            "t_ns", pa.int64(), metadata={"unit": "ns", "description": "time since the start of the run"}
        ),
    ]
    for field in message.fields:
        columns.append(_column(rows[field.name], field))
        fields.append(
            pa.field(field.name, columns[-1].type, metadata={"unit": field.unit, "description": field.doc})
        )
    if message is ELEMENTS:
        for word, names in log.bits(topic.split("/")[2]).items():
            for bit, name in enumerate(names):
                if name in {"", *(field.name for field in fields)}:
                    continue
                columns.append(pa.array((rows[word] >> np.uint64(bit) & np.uint64(1)).astype(bool)))
                fields.append(pa.field(name, pa.bool_(), metadata={"description": f"bit {bit} of {word}"}))
    about = {"topic": topic, "message": message.full_name, "start_ns": str(log.start_ns)}
    return pa.Table.from_arrays(columns, schema=pa.schema(fields, metadata=about))


def _column(values: np.ndarray, field: Field) -> pa.Array:
    if field.type == "level":
        return pa.array([LEVELS[level] if level < len(LEVELS) else str(level) for level in values.tolist()])
    return pa.array(values, ARROW_TYPES[field.type])


def table_path(topic: str, suffix: str) -> Path:
    """Where a topic's table goes: ``/relay/R1/samples`` to ``relay/R1/samples.csv``."""
    parts = [quote(part, safe=" +-_.()").replace("..", "%2E%2E") for part in topic.split("/") if part]
    return Path(*parts[:-1], parts[-1] + suffix)


def write_parquet(log: Log, folder: str | Path) -> list[Path]:
    """Writes every topic of a log to ``folder`` as Parquet; returns the files.  Raises InputError."""
    return _write(log, Path(folder), ".parquet", pyarrow.parquet.write_table)


def write_csv(log: Log, folder: str | Path) -> list[Path]:
    """Writes every topic of a log to ``folder`` as CSV with one header line; bytes are hexadecimal.

    Numbers are written so that they read back as the same bits.  Raises InputError.
    """
    return _write(log, Path(folder), ".csv", _write_csv)


def _write_csv(table: pa.Table, path: Path) -> None:
    for place, column in enumerate(table.schema):
        if pa.types.is_binary(column.type):
            texts = [value.hex() for value in table.column(place).to_pylist()]
            table = table.set_column(place, column.name, pa.array(texts, pa.string()))
    pyarrow.csv.write_csv(table, path)


def _write(log: Log, folder: Path, suffix: str, write: Callable[[pa.Table, Path], None]) -> list[Path]:
    """Every table is written aside first; they get their names when all of them are whole."""
    written: dict[Path, Path] = {}
    try:
        for topic in log.topics:
            if message_of(topic) is None:
                continue
            path = folder / table_path(topic, suffix)
            aside = path.with_name(path.name + ".part")
            aside.parent.mkdir(parents=True, exist_ok=True)
            written[aside] = path
            write(topic_table(log, topic), aside)
        for aside, path in written.items():
            aside.replace(path)
    except OSError as error:
        raise InputError(f"cannot be written: {error.strerror or error}", file=folder) from error
    finally:
        for aside in written:
            aside.unlink(missing_ok=True)
    return list(written.values())
