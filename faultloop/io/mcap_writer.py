"""The log writer: blocks of samples and estimates, and rare messages, into chunks of 0.2 s.

A row (one sample of one relay) is 495 bytes of four complete records.  Rows are packed when their chunk is
closed, so a call costs a few array copies whatever its length.
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache, lru_cache
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Attachment

from faultloop.errors import InputError
from faultloop.io.mcap_file import LOG_RECORD, MESSAGE_HEAD, Buffer, McapFile
from faultloop.io.messages import (
    BLOCK_SHAPES,
    BY_NAME,
    ELEMENTS,
    EVENT,
    LOOP_IMPEDANCES,
    SAMPLED,
    SAMPLED_VALUES,
    TRIP,
    Message,
    bit_names,
)
from faultloop.io.output_file import open_part
from faultloop.io.schema import (
    message_class,
    put_heads,
    put_places,
    put_values,
    record_offset,
    row_dtype,
    row_template,
    schema_bytes,
)
from faultloop.jit import compiled

CHUNK_NS = 200_000_000  # log time of a chunk: with LATE_NS, what a kill can cost at most
RECORD_OFFSETS = np.array([record_offset(message) for message in SAMPLED])  # in a row
LATE_NS = 50_000_000  # how long a chunk waits for the relays that are behind
MEDIA_TYPES = {".toml": "application/toml", ".dbc": "text/plain", ".json": "application/json"}

Characteristics = Mapping[str, tuple[np.ndarray, np.ndarray]]


class RelayRows:
    """The rows of one relay that no chunk has taken yet, packed as they come: by kernels that go through a
    block once, a third of the time of NumPy's copies, one a field's kind.

    Parameters
    ----------
    channels : numbers of the channels of ``SAMPLED``.
    start_ns : start of the run [ns since 1970].
    """

    def __init__(self, channels: Sequence[int], start_ns: int) -> None:
        self.channels = tuple(channels)
        self.start_ns = start_ns
        self._template = row_template(channels)
        self._begin = self._end = self._sequence = 0
        self._tails = [tail for message in SAMPLED for tail in BLOCK_SHAPES[message]]
        self._rows, self._shapes = -1, [()]  # of the last block: mostly the next is as long
        self._t_ns, self._packed = np.empty(0, np.int64), np.empty(0, row_dtype())
        self._make_room(1024)

    @property
    def t_ns(self) -> np.ndarray:
        """Times of the rows that are held [ns since the start]."""
        return self._t_ns[self._begin : self._end]

    def append(self, *block: np.ndarray) -> None:
        """Packs a block of n rows: t_ns, counts, samples, phasors, loops, pickup, operate."""
        rows = len(block[0])
        if rows != self._rows:
            self._rows, self._shapes = rows, [(rows,), (rows,), *((rows, *tail) for tail in self._tails)]
        if [array.shape for array in block] != self._shapes:
            wanted = " ".join(str(("n", *shape[1:])).replace("'", "") for shape in self._shapes)
            raise ValueError(f"a block needs {wanted}; these are {[array.shape for array in block]}")
        if not rows:
            return
        self._make_room(rows)
        at = self._end
        self._t_ns[at : at + rows] = block[0]
        heads, values = _packers()
        for head in self._heads:
            heads(head, at, self._sequence, self._t_ns[at : at + rows], self.start_ns)
        for array, body, kind in zip(block[1:], self._bodies, self._kinds, strict=True):
            values(body, at, np.ascontiguousarray(array, dtype=kind).view(np.uint64).reshape(rows, -1))
        self._end += rows
        self._sequence += rows

    def _make_room(self, rows: int) -> None:
        """For so many more.  What was taken goes when there is no room behind the rest: of the usual blocks
        that is every third time."""
        if self._end + rows <= len(self._t_ns):
            return
        held = self._end - self._begin
        opaque = (
            f"V{self._packed.itemsize}"  # as structured values, field by field, it takes ten times as long
        )
        packed, t_ns = self._packed.view(opaque), self._t_ns
        if held + rows > len(t_ns):
            self._t_ns = np.empty(4 * (held + rows), np.int64)
            self._packed = np.empty(len(self._t_ns), row_dtype())
            self._packed.view(opaque)[...] = self._template.view(opaque)  # what all rows have in common, once
            self._heads = [self._packed[message.name]["head"] for message in SAMPLED]
            self._bodies, self._kinds = _fields(self._packed)
        self._t_ns[:held] = t_ns[self._begin : self._end]
        self._packed.view(opaque)[:held] = packed[self._begin : self._end]
        self._begin, self._end = 0, held

    def take(self, rows: int) -> np.ndarray:
        """The first ``rows`` rows as packed records (``row_dtype``), which hold until the next block comes;
        they are this object's no longer."""
        taken = self._packed[self._begin : self._begin + rows]
        self._begin += rows
        return taken


def _fields(packed: np.ndarray) -> tuple[list[np.ndarray], list[np.dtype[Any]]]:
    """Where in packed rows each array of a block but its times goes, (n, k), and the array's type."""
    words: np.dtype[Any] = np.dtype(np.uint64)
    numbers: np.dtype[Any] = np.dtype(np.float64)
    bodies, kinds = [packed[SAMPLED_VALUES.name]["body"]["value"][:, :1]], [words]
    for message in SAMPLED:
        body = packed[message.name]["body"]["value"]
        for number, shape in enumerate(BLOCK_SHAPES[message]):
            bodies.append(body[:, -shape[0] :] if shape else body[:, number : number + 1])
            kinds.append(numbers if shape else words)
    return bodies, kinds


@lru_cache(maxsize=64)
def _polygons_text(zones: tuple[tuple[str, bytes, bytes], ...]) -> str:
    """JSON of each zone's ground and phase polygon: 2 ms for a relay, whose zones are often another's."""

    def points(polygon: bytes) -> list[list[float]]:
        return np.frombuffer(polygon).reshape(-1, 2).tolist()

    return json.dumps({zone: {"ground": points(a), "phase": points(b)} for zone, a, b in zones})


@cache
def _packers() -> tuple[Any, Any]:
    """`put_heads` and `put_values` by their machine code: of a structured array a call itself takes 14 us to
    find out the type."""
    rows = np.empty(2, row_dtype())  # one alone would be contiguous
    t_ns, words = np.zeros(1, np.int64), np.zeros((1, 1), np.uint64)
    body = _fields(rows)[0][0]
    return compiled(put_heads, rows[SAMPLED[0].name]["head"], 0, 0, t_ns, 0), compiled(
        put_values, body, 0, words
    )


def _oldest(relays: Iterable[RelayRows], rare: Sequence[tuple[int, int, bytes]]) -> int | None:
    """Time of the oldest that is held [ns since the start]."""
    held = [int(rows.t_ns[0]) for rows in relays if len(rows.t_ns)]
    return min([*held, *(t_ns for t_ns, _, _ in rare)], default=None)


class LogWriter:
    """Writes a run's log to ``<path>.part`` and renames it to ``path`` when it is closed whole.

    Raises InputError where another run is writing the same log, where the path is no place for a file, and,
    from whatever writes, where the disk is full or the device fails: ``failed`` is then true, nothing more is
    written, and the part is left for ``recover_log``.

    Every chunk covers one window of 0.2 s of log time and is flushed when all relays have passed its end, or
    when one is 50 ms past it: a killed run loses at most the last 0.25 s (``recover_log``).  The bytes depend
    on what is written only, not on how it was cut into blocks, as long as no relay falls 50 ms behind.

    Parameters
    ----------
    path : where the log goes.
    start_ns : start of the run [ns since 1970-01-01 UTC]; every ``t_ns`` counts from it.
    metadata : records by name, each a mapping of texts: scenario, settings, seed, versions.
    attachments : files by name: the TOML files, the DBC.
    compression : ``""`` (fastest), ``"lz4"`` or ``"zstd"``.
    """

    def __init__(
        self,
        path: str | Path,
        start_ns: int,
        metadata: Mapping[str, Mapping[str, str]] | None = None,
        attachments: Mapping[str, str | bytes] | None = None,
        compression: str = "",
    ) -> None:
        if start_ns < 0:
            raise ValueError(f"start_ns is {start_ns}; an MCAP log cannot begin before 1970")
        self.path, self.start_ns = Path(path), int(start_ns)
        self.failed = False
        self.part, self._stream = open_part(self.path)
        self._relays: dict[str, RelayRows] = {}
        self._seen: dict[str, int] = {}  # per relay, its newest time
        self._newest = self._slowest = 0
        self._rare: list[tuple[int, int, bytes]] = []  # time, channel, record
        self._channels: dict[str, tuple[int, Any]] = {}  # number, and the protobuf class
        self._sequences: dict[int, int] = {}
        self._window = 0  # the windows before this one are written
        try:
            with self._writing():
                self._file = McapFile(self._stream, compression)
            self.add_metadata(LOG_RECORD, {"start_ns": str(self.start_ns)})
            for name, values in (metadata or {}).items():
                self.add_metadata(name, values)
            for name, data in (attachments or {}).items():
                self.add_attachment(name, data)
        except BaseException:
            self._stream.raw.close()
            self.part.unlink(missing_ok=True)  # no sample is in it
            raise

    @contextmanager
    def _writing(self) -> Iterator[None]:
        """Where the file is written to: what goes wrong there ends the log."""
        if self.failed:
            raise self._failure("an earlier write failed")
        try:
            yield
        except OSError as error:
            self.failed = True
            with contextlib.suppress(OSError):
                self._stream.raw.close()  # not through the buffer: that would write again
            raise self._failure(error.strerror or str(error)) from error

    def _failure(self, why: str) -> InputError:
        left = f"what is whole is in {self.part.name}: faultloop recover {self.part} OUT.mcap"
        return InputError(f"cannot be written: {why}; {left}", file=self.path)

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Writes a metadata record at once; a log may gain them while it is written."""
        with self._writing():
            self._file.metadata(name, values)

    def add_attachment(self, name: str, data: str | bytes) -> None:
        """Writes an attachment at once."""
        attachment = Attachment(
            create_time=0,
            log_time=self.start_ns,
            name=name,
            media_type=MEDIA_TYPES.get(Path(name).suffix, "application/octet-stream"),
            data=data.encode() if isinstance(data, str) else data,
        )
        with self._writing():
            self._file.attachment(attachment)

    def _channel(self, topic: str, message: Message, metadata: Mapping[str, str] | None = None) -> int:
        units = {field.name: field.unit for field in message.fields if field.unit}
        described = {"units": json.dumps(units)} if units else {}
        schema = self._file.schema(message.full_name, schema_bytes(message))
        channel = self._file.channel(topic, schema, described | dict(metadata or {}))
        self._channels[topic] = channel, message_class(message)
        return channel

    def add_relay(
        self, name: str, bits: Sequence[str], characteristics: Characteristics | None = None
    ) -> None:
        """Makes the channels of relay ``name``.

        Parameters
        ----------
        bits : name of each bit of ``pickup`` and ``operate``, lowest first, at most 64.
        characteristics : per zone the ground and the phase polygon, each (k, 2) of R, X [ohm, primary].
        """
        if name in self._relays:
            raise ValueError(f"relay {name!r} is in the log already")
        names = bit_names(tuple(bits))
        zones = tuple(
            (zone, *(np.asarray(polygon, dtype=np.float64).tobytes() for polygon in polygons))
            for zone, polygons in (characteristics or {}).items()
        )
        more = {
            ELEMENTS.name: {f"{word}_bits": json.dumps(names[word]) for word in names},
            LOOP_IMPEDANCES.name: {"characteristics": _polygons_text(zones)},
        }
        channels = [self._channel(own.topic_for(name), own, more.get(own.name)) for own in SAMPLED]
        self._relays[name] = RelayRows(channels, self.start_ns)
        self._seen[name] = self._slowest = 0
        for message in (TRIP, EVENT):
            self._channel(message.topic_for(name), message)

    def relay_block(
        self,
        name: str,
        t_ns: np.ndarray,
        sample_count: np.ndarray,
        samples: np.ndarray,
        phasors: np.ndarray,
        loops: np.ndarray,
        pickup: np.ndarray,
        operate: np.ndarray,
        *more: np.ndarray,
    ) -> None:
        """Logs n samples of a relay with all that it made of them (``BLOCK_SHAPES``); the arrays are copied.

        Shapes: t_ns (n,) int64 [ns since the start, increasing], sample_count (n,), samples (n, 6) [V, A],
        phasors (n, 14), loops (n, 12) [ohm], pickup and operate (n,) uint64.
        """
        self._relays[name].append(t_ns, sample_count, samples, phasors, loops, pickup, operate, *more)
        if len(t_ns):
            self._advance(name, int(t_ns[-1]))

    def message(self, topic: str, t_ns: int, message_name: str, **fields: Any) -> None:
        """Logs one rare message of the table of messages; a field left out is zero or empty."""
        if topic not in self._channels:
            self._channel(topic, BY_NAME[message_name])
        channel, kind = self._channels[topic]
        log_ns = self.start_ns + int(t_ns)
        proto = kind(**fields)
        proto.timestamp.seconds, proto.timestamp.nanos = divmod(log_ns, 1_000_000_000)
        data = proto.SerializeToString(deterministic=True)
        sequence = self._sequences.get(channel, 0)
        self._sequences[channel] = sequence + 1
        head = MESSAGE_HEAD.pack(Opcode.MESSAGE, 22 + len(data), channel, sequence, log_ns, log_ns)
        self._rare.append((int(t_ns), channel, head + data))
        self._advance(None, int(t_ns))

    def _advance(self, relay: str | None, t_ns: int) -> None:
        """Writes the windows that all relays have passed, or that one of them left 50 ms ago."""
        if t_ns > self._newest:
            self._newest = t_ns
        if relay is not None:
            self._seen[relay] = t_ns
            self._slowest = min(self._seen.values())
        passed = self._slowest if self._seen else self._newest
        if passed < self._newest - LATE_NS:
            passed = self._newest - LATE_NS
        if passed >= (self._window + 1) * CHUNK_NS:
            self._write_until(passed // CHUNK_NS)

    def _write_until(self, window: int | None) -> None:
        """Writes what is held of the windows before ``window`` (of all, if None), one chunk each."""
        while (oldest := _oldest(self._relays.values(), self._rare)) is not None and (
            window is None or oldest // CHUNK_NS < window
        ):
            self._write_window(oldest // CHUNK_NS)
        if window is not None:
            self._window = window

    def _write_window(self, window: int) -> None:
        """Writes one chunk: the relays' rows, relay by relay, then the rare messages by time."""
        stop_ns = (window + 1) * CHUNK_NS
        index: dict[int, np.ndarray] = {}
        parts: list[Buffer] = []
        offset = 0
        for rows in self._relays.values():
            t_ns = rows.t_ns[: np.searchsorted(rows.t_ns, stop_ns)]
            if not len(t_ns):
                continue
            packed = rows.take(len(t_ns))
            places = np.empty((len(SAMPLED), len(t_ns), 2), np.uint64)
            put_places(places, t_ns, self.start_ns, offset, packed.itemsize, RECORD_OFFSETS)
            index |= zip(rows.channels, places, strict=True)
            parts.append(packed.view(np.uint8).data)
            offset += packed.nbytes
        self._take_rare(stop_ns, offset, parts, index)
        with self._writing():
            self._file.chunk(parts, index)

    def _take_rare(
        self, stop_ns: int, offset: int, parts: list[Buffer], index: dict[int, np.ndarray]
    ) -> None:
        """Moves the rare messages before ``stop_ns``, by time, into a chunk's parts and index."""
        now = sorted((entry for entry in self._rare if entry[0] < stop_ns), key=lambda entry: entry[:2])
        self._rare = [entry for entry in self._rare if entry[0] >= stop_ns]
        places: dict[int, list[tuple[int, int]]] = {}
        for t_ns, channel, record in now:
            places.setdefault(channel, []).append((self.start_ns + t_ns, offset))
            offset += len(record)
        parts.append(b"".join(record for _, _, record in now))
        index |= {channel: np.array(pairs, dtype=np.uint64) for channel, pairs in places.items()}

    def close(self) -> Path:
        """Writes the rest and the summary, and gives the file its name."""
        self._write_until(None)
        with self._writing():
            self._file.finish()
            self._stream.close()
            return self.part.replace(self.path)

    def abort(self) -> Path:
        """Writes what is held and leaves ``<path>.part`` without a summary, for ``recover_log``.

        After a failed write, and where one fails now, it writes nothing more and raises nothing.
        """
        if not self.failed:
            with contextlib.suppress(InputError):
                self._write_until(None)
                with self._writing():
                    self._stream.close()
        return self.part

    def discard(self) -> None:
        """Ends without a log; only what a failed write has left stays, for ``recover_log``."""
        self.abort()
        if not self.failed:
            self.part.unlink(missing_ok=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:
            self.close()
        else:
            self.abort()
