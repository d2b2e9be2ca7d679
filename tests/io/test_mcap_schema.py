"""The table of messages, the protobuf schemas and the fixed record layout made from it."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from google.protobuf import descriptor_pb2
from hypothesis import given, settings
from hypothesis import strategies as st

from faultloop.io import messages as table
from faultloop.io.messages import BY_NAME, MESSAGES, SAMPLED, Message, array_dtype, bit_names, message_of
from faultloop.io.schema import (
    message_class,
    put_heads,
    put_values,
    record_dtype,
    row_dtype,
    row_template,
    schema_bytes,
)

PHASOR_FIELDS = [f"{c}_{part}" for c in ("va", "vb", "vc", "ia", "ib", "ic") for part in ("re", "im")]
CONTRACT = {  # public names; a field may be added, none may go
    "SampledValues": ["sample_count", "va", "vb", "vc", "ia", "ib", "ic"],
    "Phasors": [*PHASOR_FIELDS, "frequency_hz", "rocof_hz_per_s"],
    "LoopImpedances": [f"{loop}_{part}" for loop in ("ag", "bg", "cg", "ab", "bc", "ca") for part in "rx"],
    "Elements": ["pickup", "operate"],
    "Trip": ["function", "zone", "loop", "poles", "sample_count"],
    "foxglove.Log": ["level", "message", "name", "file", "line"],
    "BreakerStatus": ["pole_a", "pole_b", "pole_c", "command"],
    "FaultState": ["fault", "on", "type"],
    "CanFrame": ["id", "data", "extended", "fd", "direction"],
}


@pytest.mark.parametrize("name", CONTRACT)
def test_contract_fields_keep_their_names_and_numbers(name: str) -> None:
    fields = [field.name for field in BY_NAME[name].fields]
    assert fields[: len(CONTRACT[name])] == CONTRACT[name]


def test_docs_list_every_field(root: Path) -> None:
    text = (root / "docs" / "log.md").read_text(encoding="utf-8")
    words = set(re.findall(r"`([^`\n]+)`", text))
    for message in MESSAGES:
        assert {message.topic, message.full_name} <= words
        assert {field.name for field in message.fields} <= words, message.name


def test_topics_find_their_message() -> None:
    for message in MESSAGES:
        assert message_of(message.topic_for("R1")) is message
    assert message_of("/relay/R1/samples/x") is None
    assert message_of("/somewhere") is None


@pytest.mark.parametrize("message", MESSAGES, ids=lambda m: m.name)
def test_schema_describes_the_table(message: Message) -> None:
    files = descriptor_pb2.FileDescriptorSet.FromString(schema_bytes(message)).file
    assert files[0].name == "google/protobuf/timestamp.proto"
    assert files[1].syntax == "proto3"
    descriptor = message_class(message).DESCRIPTOR
    assert descriptor.full_name == message.full_name
    assert [(field.name, field.number) for field in descriptor.fields] == [
        ("timestamp", 1),
        *((field.name, number) for number, field in enumerate(message.fields, start=2)),
    ]


@pytest.mark.parametrize("message", SAMPLED, ids=lambda m: m.name)
def test_every_sample_fields_have_one_byte_tags_and_eight_byte_values(message: Message) -> None:
    assert len(message.fields) + 1 <= 15
    assert {field.type for field in message.fields} <= {"double", "fixed64"}


@given(
    log_ns=st.integers(0, 2**63 - 1),
    sequence=st.integers(0, 2**32 - 1),
    values=st.lists(st.floats(allow_nan=False), min_size=14, max_size=14),
)
@settings(deadline=None, derandomize=True)
def test_packed_records_are_protobuf(log_ns: int, sequence: int, values: list[float]) -> None:
    start_ns = min(log_ns, 1_700_000_000_000_000_000)
    rows = np.empty(1, row_dtype())
    rows[0] = row_template([1, 2, 3, 4])
    put_heads(rows["Phasors"]["head"], 0, sequence, np.array([log_ns - start_ns]), start_ns)
    put_values(rows["Phasors"]["body"]["value"], 0, np.array([values]).view("<u8"))
    record = rows[0]["Phasors"].tobytes()
    assert len(record) == record_dtype(table.PHASORS).itemsize == 9 + int.from_bytes(record[1:9], "little")
    proto = message_class(table.PHASORS).FromString(record[31:])
    assert proto.timestamp.seconds * 10**9 + proto.timestamp.nanos == log_ns
    assert [getattr(proto, field.name) for field in table.PHASORS.fields] == values
    assert int.from_bytes(record[11:15], "little") == sequence
    assert int.from_bytes(record[15:23], "little") == int.from_bytes(record[23:31], "little") == log_ns


def test_bit_names_follow_iec_61850() -> None:
    assert bit_names(("PDIS1", "PTRC1", "RDIR1.DirFwd")) == {
        "pickup": ("PDIS1.Str", "PTRC1.Str", "RDIR1.DirFwd"),
        "operate": ("PDIS1.Op", "PTRC1.Tr", ""),
    }


def test_float_matrix_is_a_view() -> None:
    rows = np.zeros(3, array_dtype(table.SAMPLED_VALUES))
    rows["ib"] = [1, 2, 3]
    matrix = table.values(rows)
    assert matrix.shape == (3, 6)
    assert np.shares_memory(matrix, rows)
    assert matrix[:, 4].tolist() == [1, 2, 3]
