"""What a viewer shows without scripts: magnitudes, degrees and booleans of each relay, as a log of its own.

Foxglove's message paths and PlotJuggler's curves take one field as it is; a magnitude needs two, an angle an
arc tangent, a bit of a word a shift.  All of it follows from the log, so it is not logged: ``write_view``
makes the topics ``/relay/NAME/view`` beside a log, which both tools open together with it.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import CompressionType, Writer
from numpy.typing import NDArray

from faultloop.errors import InputError
from faultloop.io.mcap_file import LOG_RECORD
from faultloop.io.mcap_reader import Log
from faultloop.io.messages import CHANNELS, ELEMENTS, PHASORS, Field, Message, values
from faultloop.io.output_file import write_aside
from faultloop.io.schema import message_class, schema_bytes

EVERY = 12
"""Samples between two messages; there is one at each change of a bit, too."""
WORDS = ("pickup", "operate")
SEQUENCES = ("v0", "v1", "v2", "i0", "i1", "i2")
_TURN = np.exp(2j * np.pi / 3 * np.arange(3))
_FORTESCUE = np.stack([np.ones(3), _TURN, _TURN.conj()]) / 3


def view_topic(relay: str) -> str:
    """``/relay/RA/view``"""
    return f"/relay/{relay}/view"


def booleans(bits: Mapping[str, Sequence[str]]) -> dict[str, tuple[int, int]]:
    """Field name (``PDIS1_Str``) of each bit that has a name: its word (0 pickup, 1 operate) and place."""
    return {
        re.sub(r"\W", "_", name): (number, place)
        for number, word in enumerate(WORDS)
        for place, name in enumerate(bits[word])
        if name
    }


def view_message(relay: str, bits: Mapping[str, Sequence[str]]) -> Message:
    """The type of a relay's view: its booleans are the relay's own."""
    unit = {"v": "V", "i": "A"}
    sizes = [
        Field(f"{name}_mag", "double", unit[name[0]], f"size of the {name} phasor, RMS") for name in CHANNELS
    ]
    angles = [Field(f"{name}_deg", "double", "deg", f"angle of {name} against va") for name in CHANNELS]
    sequences = [Field(f"{name}_mag", "double", unit[name[0]], f"size of {name}, RMS") for name in SEQUENCES]
    states = [Field(name, "bool", "", "on") for name in booleans(bits)]
    fields = (*sizes, *angles, *sequences, Field("frequency_hz", "double", "Hz", "as estimated"), *states)
    name = "View" + re.sub(r"\W", "_", relay)
    return Message(name, view_topic(relay), "each 12th sample, and on change", "For viewers.", fields)


def write_view(log: Log, path: Path | str, every: int = EVERY) -> Path:
    """Write ``/relay/NAME/view`` of each relay of a log, on its clock.

    Raises InputError where no relay has phasors and elements, or ``path`` cannot be written.
    """
    relays = [
        name for name in log.relays if {m.topic_for(name) for m in (PHASORS, ELEMENTS)} <= set(log.topics)
    ]
    if not relays:
        raise InputError("no relay has phasors and elements: there is nothing to view", file=log.path)
    with write_aside(path, ".mcap") as aside, aside.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.ZSTD)
        writer.start(profile="", library="faultloop")
        writer.add_metadata(LOG_RECORD, {"start_ns": str(log.start_ns)})
        for name in relays:
            _write_relay(writer, log, name, every)
        writer.finish()
    return Path(path)


def _write_relay(writer: Writer, log: Log, name: str, every: int) -> None:
    bits = log.bits(name)
    message, places = view_message(name, bits), booleans(bits)
    schema = writer.register_schema(message.full_name, "protobuf", schema_bytes(message))
    channel = writer.register_channel(view_topic(name), "protobuf", schema)
    make, last, count = message_class(message), (0, 0), 0
    for span in log.stretches():
        phasors, elements = log.phasors(name, *span), log.elements(name, *span)
        n = min(len(phasors), len(elements))
        words = np.stack([elements["pickup"][:n], elements["operate"][:n]], axis=1)
        before = np.concatenate([np.array([last], np.uint64), words[:-1]]) if n else words
        chosen = np.flatnonzero(((np.arange(n) + count) % every == 0) | (words != before).any(axis=1))
        count, last = count + n, tuple(words[-1].tolist()) if n else last
        floats = _floats(values(phasors[:n][chosen]))
        for row, place in enumerate(chosen.tolist()):
            t_ns = log.start_ns + int(phasors["t_ns"][place])
            word = words[place].tolist()
            fields: dict[str, Any] = dict(zip(_FLOAT_NAMES, floats[row].tolist(), strict=True))
            fields |= {field: bool(word[of] >> bit & 1) for field, (of, bit) in places.items()}
            content = make(**fields)
            content.timestamp.FromNanoseconds(t_ns)
            writer.add_message(channel, t_ns, content.SerializeToString(), t_ns)


_FLOAT_NAMES = (
    *(f"{name}_mag" for name in CHANNELS),
    *(f"{name}_deg" for name in CHANNELS),
    *(f"{name}_mag" for name in SEQUENCES),
    "frequency_hz",
)


def _floats(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 19) of phasor rows (n, 14)."""
    x = np.ascontiguousarray(rows[:, :12]).view(np.complex128)
    with np.errstate(invalid="ignore"):
        degrees = np.degrees(np.angle(x * np.exp(-1j * np.angle(x[:, :1]))))
    sequences = [np.abs(x[:, part] @ _FORTESCUE.T) for part in (slice(0, 3), slice(3, 6))]
    return np.column_stack([np.abs(x), degrees, *sequences, rows[:, 12]])
