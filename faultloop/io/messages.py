"""The one table of messages: what is logged, under which topic, with which fields and units.

The protobuf schemas, the writer's record layout, the reader's arrays, the CSV and Parquet columns and
``docs/log.md`` all follow from ``MESSAGES``.  Adding a field is adding a line here; a field is never renamed,
removed or moved, because its position is its protobuf number.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

PACKAGE = "faultloop"
CHANNELS = ("va", "vb", "vc", "ia", "ib", "ic")
LOOPS = ("AG", "BG", "CG", "AB", "BC", "CA")
POLES = ("A", "B", "C")  # bit 0, 1, 2 of every pole mask
LEVELS = ("UNKNOWN", "DEBUG", "INFO", "WARNING", "ERROR", "FATAL")  # foxglove.Log.Level

SCALAR_DTYPES = {
    "double": "<f8",
    "fixed64": "<u8",
    "uint32": "<u4",
    "fixed32": "<u4",
    "bool": "?",
    "level": "u1",
}


@dataclass(frozen=True)
class Field:
    """One field: its protobuf type (``level`` is the enum of foxglove.Log), unit and meaning."""

    name: str
    type: str
    unit: str = ""
    doc: str = ""

    @property
    def absent(self) -> Any:
        """Its value in the messages of a version that did not have it yet, as protobuf has it."""
        return {"string": "", "bytes": b""}.get(self.type, 0)


@dataclass(frozen=True, eq=False)  # each is made once: compared, and found in a cache, by identity
class Message:
    """One message type.  Field number 1 is always ``timestamp``; ``fields`` follow from 2 on.

    ``every_sample`` messages hold only 8-byte fields, so their records have a fixed size on the wire.
    """

    name: str
    topic: str
    rate: str
    doc: str
    fields: tuple[Field, ...]

    @property
    def full_name(self) -> str:
        return self.name if "." in self.name else f"{PACKAGE}.{self.name}"

    @property
    def every_sample(self) -> bool:
        return self.rate == "every sample"

    def topic_for(self, source: str) -> str:
        """The topic of relay or breaker ``source``."""
        return re.sub(r"\{\w+\}", lambda _: source, self.topic)


def _phasor_fields() -> tuple[Field, ...]:
    def unit(channel: str) -> str:
        return "V" if channel[0] == "v" else "A"

    return tuple(
        Field(
            f"{channel}_{part}", "double", unit(channel), f"{word} part of the {channel} phasor, RMS, primary"
        )
        for channel in CHANNELS
        for part, word in (("re", "real"), ("im", "imaginary"))
    )


def _loop_fields() -> tuple[Field, ...]:
    return tuple(
        Field(
            f"{loop.lower()}_{part}",
            "double",
            "ohm",
            f"{word} of loop {loop}, primary; NaN where not defined",
        )
        for loop in LOOPS
        for part, word in (("r", "resistance"), ("x", "reactance"))
    )


SAMPLED_VALUES = Message(
    "SampledValues",
    "/relay/{relay}/samples",
    "every sample",
    "Instantaneous primary voltages and currents, after the relay's front end.",
    (
        Field(
            "sample_count", "fixed64", "", "number of the sample; sample 0 is taken at the start of the run"
        ),
        *(
            Field(name, "double", "V", f"voltage of phase {name[1].upper()} to ground")
            for name in CHANNELS[:3]
        ),
        *(
            Field(name, "double", "A", f"current of phase {name[1].upper()}, positive into the line")
            for name in CHANNELS[3:]
        ),
    ),
)
PHASORS = Message(
    "Phasors",
    "/relay/{relay}/phasors",
    "every sample",
    "The estimator's phasors, against cos(2 pi f0 t) at the sample's own time.",
    (
        *_phasor_fields(),
        Field("frequency_hz", "double", "Hz", "estimated frequency; NaN where not estimated"),
        Field("rocof_hz_per_s", "double", "Hz/s", "rate of change of frequency; NaN where not estimated"),
    ),
)
LOOP_IMPEDANCES = Message(
    "LoopImpedances",
    "/relay/{relay}/loops",
    "every sample",
    "Apparent impedance of the six fault loops.",
    _loop_fields(),
)
ELEMENTS = Message(
    "Elements",
    "/relay/{relay}/elements",
    "every sample",
    "Bit sets of the protection elements; the channel's metadata names the bits, lowest bit first.",
    (
        Field("pickup", "fixed64", "", "elements that have started (.Str)"),
        Field("operate", "fixed64", "", "elements that operate (.Op, .Tr)"),
    ),
)
TRIP = Message(
    "Trip",
    "/relay/{relay}/trips",
    "on change",
    "A trip decision of the relay.",
    (
        Field("function", "string", "", "logical node that trips, such as PDIS1"),
        Field("zone", "uint32", "", "distance zone, 0 for a function without zones"),
        Field("loop", "string", "", "faulted loop: AG BG CG AB BC CA, or ABC"),
        Field("poles", "uint32", "", "poles to open: A = 1, B = 2, C = 4"),
        Field("sample_count", "fixed64", "", "number of the sample at which the relay decided"),
    ),
)
EVENT = Message(
    "foxglove.Log",
    "/relay/{relay}/events",
    "on change",
    "What a person reads.",
    (
        Field("level", "level", "", "DEBUG, INFO, WARNING, ERROR or FATAL"),
        Field("message", "string", "", "the text"),
        Field("name", "string", "", "who says it: a relay, the plant, the bus"),
        Field("file", "string", "", "not used"),
        Field("line", "fixed32", "", "not used"),
    ),
)
BREAKER_STATUS = Message(
    "BreakerStatus",
    "/breaker/{breaker}",
    "on change",
    "State of a breaker's poles, at the start, at every change and at every command received.",
    (
        Field("pole_a", "bool", "", "pole A is closed"),
        Field("pole_b", "bool", "", "pole B is closed"),
        Field("pole_c", "bool", "", "pole C is closed"),
        Field("command", "string", "", "command received now: open or close, empty if none"),
        Field("relay", "string", "", "whose command it was; empty if there was none"),
    ),
)
FAULT_STATE = Message(
    "FaultState",
    "/plant/faults",
    "on change",
    "The faults of the scenario as the plant applies them: the truth, for review.",
    (
        Field("fault", "uint32", "", "number of the fault in the scenario, from 0"),
        Field("on", "bool", "", "the fault is applied"),
        Field("type", "string", "", "AG BG CG AB BC CA ABG BCG CAG ABC ABCG"),
    ),
)
RECORD_DIGITAL = Message(
    "RecordDigital",
    "/record/digital",
    "on change",
    "A digital channel of a replayed record: every channel at the start, then every change.",
    (
        Field("number", "uint32", "", "place in the record's list of digital channels, from 0"),
        Field("name", "string", "", "name in the record"),
        Field("on", "bool", "", "its state from now on"),
        Field("normal", "bool", "", "its state while nothing happens, as the record states it"),
    ),
)
CAN_FRAME = Message(
    "CanFrame",
    "/can",
    "on change",
    "A frame on the CAN bus, at the time it has been received whole.",
    (
        Field("id", "uint32", "", "identifier, 11 or 29 bits"),
        Field("data", "bytes", "", "payload, up to 8 bytes, CAN FD up to 64"),
        Field("extended", "bool", "", "29-bit identifier"),
        Field("fd", "bool", "", "CAN FD frame"),
        Field("direction", "string", "", "tx or rx, seen from this program"),
        Field("sender", "string", "", "node that sent it, if known"),
    ),
)

MESSAGES = (
    SAMPLED_VALUES,
    PHASORS,
    LOOP_IMPEDANCES,
    ELEMENTS,
    TRIP,
    EVENT,
    BREAKER_STATUS,
    FAULT_STATE,
    CAN_FRAME,
    RECORD_DIGITAL,
)
SAMPLED = tuple(message for message in MESSAGES if message.every_sample)


def _block_shapes(message: Message) -> tuple[tuple[int, ...], ...]:
    doubles = sum(field.type == "double" for field in message.fields)
    return ((doubles,),) if doubles else tuple(() for _ in message.fields)


BLOCK_SHAPES = {message: _block_shapes(message) for message in SAMPLED}
"""What a block of n of a relay's samples has of each message, after n: a matrix of its numbers, or its words.
Before them stand t_ns and the samples' numbers, (n,) each."""
BY_NAME = {message.name: message for message in MESSAGES} | {
    message.full_name: message for message in MESSAGES
}


@cache
def array_dtype(message: Message) -> np.dtype:
    """Row of the reader's array: ``t_ns`` [ns since the run's start], then the fields; texts are objects."""
    return np.dtype(
        [("t_ns", "<i8"), *((field.name, SCALAR_DTYPES.get(field.type, "O")) for field in message.fields)]
    )


def values(rows: np.ndarray) -> np.ndarray:
    """The float fields of an every-sample array as one matrix (n, k), without a copy."""
    names = rows.dtype.names or ()
    first = next(place for place, name in enumerate(names) if rows.dtype[name] == np.float64)
    return rows.view("<f8").reshape(len(rows), rows.dtype.itemsize // 8)[:, first:]


def source_of(topic: str) -> str:
    """Name of the relay or breaker in a topic, empty for the topics that have none."""
    parts = topic.split("/")
    return parts[2] if len(parts) > 2 and parts[1] in ("relay", "breaker") else ""


def message_of(topic: str) -> Message | None:
    """The message that the table puts under this topic, None for a topic that is not ours."""
    if topic.endswith("/events"):  # the plant and the breakers have theirs, too
        return EVENT
    source = source_of(topic)
    return next((message for message in MESSAGES if message.topic_for(source) == topic), None)


def bit_names(bits: tuple[str, ...]) -> dict[str, tuple[str, ...]]:
    """IEC 61850 data names of the bits of ``pickup`` and ``operate``, lowest bit first.

    ``PDIS1`` gives ``PDIS1.Str`` and ``PDIS1.Op``, ``PTRC1`` gives ``PTRC1.Tr`` for operate.  A name that has
    its data object already (``RDIR1.DirFwd``) names the bit of pickup; its bit of operate is without a name.
    """

    def operate(name: str) -> str:
        if "." in name:
            return ""
        return f"{name}.Tr" if name.startswith("PTRC") else f"{name}.Op"

    return {
        "pickup": tuple(name if "." in name else f"{name}.Str" for name in bits),
        "operate": tuple(operate(name) for name in bits),
    }
