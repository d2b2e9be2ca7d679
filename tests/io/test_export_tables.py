"""Parquet and CSV exports read back as what the log holds."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from numpy.testing import assert_array_equal

from faultloop.errors import InputError
from faultloop.io.mcap_reader import open_log
from faultloop.io.mcap_writer import LogWriter
from faultloop.io.messages import message_of
from faultloop.io.tables import table_path, write_csv, write_parquet


def test_parquet_round_trip(log_path: Path, tmp_path: Path) -> None:
    log = open_log(log_path)
    files = write_parquet(log, tmp_path)
    assert len(files) == len(log.topics)
    for topic in log.topics:
        message, rows = message_of(topic), log.array(topic)
        assert message is not None
        table = pq.read_table(tmp_path / table_path(topic, ".parquet"))
        assert table.schema.metadata[b"topic"].decode() == topic
        assert_array_equal(table["timestamp"].cast("int64").to_numpy(), rows["t_ns"] + log.start_ns)
        for field in message.fields:
            assert table.schema.field(field.name).metadata[b"unit"].decode() == field.unit
            column = table[field.name]
            if field.type == "double":
                assert column.to_numpy().tobytes() == np.ascontiguousarray(rows[field.name]).tobytes()
            elif field.type != "level":
                assert column.to_pylist() == rows[field.name].tolist()
    assert pq.read_table(tmp_path / "relay/R1/events.parquet")["level"].to_pylist() == ["WARNING"]


def test_csv_round_trip(log_path: Path, tmp_path: Path) -> None:
    log = open_log(log_path)
    write_csv(log, tmp_path)
    for topic in log.topics:
        message, rows = message_of(topic), log.array(topic)
        assert message is not None
        with (tmp_path / table_path(topic, ".csv")).open(encoding="utf-8", newline="") as stream:
            lines = list(csv.DictReader(stream))
        assert [int(line["t_ns"]) for line in lines] == rows["t_ns"].tolist()
        for field in message.fields:
            texts = [line[field.name] for line in lines]
            if field.type == "double":
                assert_array_equal([float(text) for text in texts], rows[field.name])
            elif field.type in ("fixed64", "uint32"):
                assert [int(text) for text in texts] == rows[field.name].tolist()
            elif field.type == "bytes":
                assert [bytes.fromhex(text) for text in texts] == rows[field.name].tolist()
    first = (tmp_path / "relay/R1/samples.csv").read_text(encoding="utf-8").splitlines()[2]
    assert first.startswith("2020-01-01 00:00:00.000208333")


def test_element_bits_are_columns(log_path: Path, tmp_path: Path) -> None:
    log = open_log(log_path)
    write_parquet(log, tmp_path)
    table = pq.read_table(tmp_path / "relay/R1/elements.parquet")
    words = log.elements("R1")["operate"]
    assert table["PTRC1.Tr"].to_pylist() == [bool(word >> 2 & 1) for word in words.tolist()]
    assert {"PDIS1.Str", "PDIS2.Op", "RDIR1.DirFwd"} <= set(table.column_names)


def test_names_cannot_leave_the_folder(tmp_path: Path) -> None:
    with LogWriter(tmp_path / "x.mcap", 0) as log:
        log.message("/breaker/..", 0, "BreakerStatus")
        log.message("/breaker/a:b?", 0, "BreakerStatus")
    files = write_csv(open_log(tmp_path / "x.mcap"), tmp_path / "out")
    assert sorted(file.relative_to(tmp_path / "out").as_posix() for file in files) == [
        "breaker/%2E%2E.csv",
        "breaker/a%3Ab%3F.csv",
    ]


def test_nothing_half_made_is_left(log_path: Path, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "relay").write_text("a file where a folder should be", encoding="utf-8")
    with pytest.raises(InputError, match="cannot be written"):
        write_csv(open_log(log_path), tmp_path / "out")
    assert not list((tmp_path / "out").rglob("*.part"))
