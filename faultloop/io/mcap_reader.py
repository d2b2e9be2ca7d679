"""The log reader: a whole MCAP log as NumPy arrays, one per topic."""

from __future__ import annotations

import json
import mmap
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from faultloop.config.input_file import check_input
from faultloop.errors import InputError, nearest
from faultloop.io import messages as table
from faultloop.io.mcap_contents import Contents, Segment
from faultloop.io.mcap_file import DAMAGE, LOG_RECORD, MAGIC
from faultloop.io.mcap_messages import MessageReader
from faultloop.io.messages import Message, array_dtype, message_of, source_of
from faultloop.io.notebook import drawn, figure, log_frame, log_html
from faultloop.io.output_file import parts_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WINDOW_BYTES = 1 << 24
MOST_NS = 1 << 62  # beyond every time of a log, both ways, and still an int64 with a start added


@dataclass(frozen=True)
class Entry:
    """A rare message: when, on which topic, and its fields, which are attributes too (``entry.zone``)."""

    t_ns: int
    """When, from the start."""
    topic: str
    fields: dict[str, Any]

    @property
    def source(self) -> str:
        """The relay or breaker it is about; empty for the plant and the bus."""
        return source_of(self.topic)

    def __getattr__(self, name: str) -> Any:
        try:
            return self.__dict__["fields"][name]
        except KeyError:
            raise AttributeError(name) from None


class Log:
    """An opened log.  Whole arrays are made when first asked for and kept; all arrays are read-only.

    A log of any length can be read piece by piece: ``windows`` gives stretches of time that hold some 16 MB,
    and ``array`` and its like take ``from_ns`` and ``to_ns``; what is read so is not kept.

    Attributes
    ----------
    path, start_ns : the file; the run's start [ns since 1970-01-01 UTC], from which every ``t_ns`` counts.
    topics : names of all topics, ours or not, sorted.
    relays, breakers : names, in the order of the file.
    metadata, attachments : metadata records and contents, by name.
    warnings : what is damaged and was left out or found in another way, one line each; reading may add some.
    progress : called by whatever reads the whole log in stretches, with the part that is read, 0 to 1.
    """

    def __init__(self, path: Path, data: mmap.mmap | bytes) -> None:
        self.path = path
        self._contents = Contents(data)
        self.metadata, self.attachments = self._contents.metadata, self._contents.attachments
        self.warnings = self._contents.warnings
        self._channels = self._contents.channels
        self._arrays: dict[str, np.ndarray] = {}
        self.progress: Callable[[float], None] | None = None
        self._spans: np.ndarray | None = None  # of the segments [ns since the start], (n, 2)
        self.start_ns = _start_ns(self._contents)
        self._reader = MessageReader(self._contents, self.start_ns)
        self.topics = tuple(sorted(self._channels))
        self.relays = self._sources("relay")
        self.breakers = self._sources("breaker")

    def __repr__(self) -> str:
        scenario = self.metadata.get("scenario", {}).get("name")
        what = f"{scenario}, " if scenario else ""
        relays = f"relays {', '.join(self.relays)}" if self.relays else "no relay"
        return f"<Log {self.path.name}: {what}{relays}, {len(self.topics)} topics>"

    def _repr_html_(self) -> str:
        """Trips and events, for a notebook."""
        return log_html(repr(self).strip("<>"), self.trips, self.events)

    def plot(self, relay: str | None = None) -> Figure:
        """Voltages and currents of a relay, or of all side by side, with faults and trips: a Figure.  Of more
        samples than a picture has points the least and the greatest of each few are drawn."""
        names = self.relays if relay is None else (relay,)
        marks = [(fault.t_ns, "fault") for fault in self.faults if fault.on]
        marks += [(t.t_ns, f"{t.source} {t.function}") for t in self.trips if t.source in names]
        return figure({name: drawn(self, name) for name in names}, marks)

    def count(self, topic: str) -> int:
        """How many messages a topic has."""
        counts = self._contents.counts()
        return sum(counts.get(channel.id, 0) for channel in self._channels.get(topic, ()))

    def to_pandas(
        self, relay: str | None = None, from_ns: int | None = None, to_ns: int | None = None
    ) -> Any:
        """A DataFrame of a relay, the first by default, a row a sample (`faultloop.io.notebook.frame`);
        ``from_ns`` (included) and ``to_ns`` (not included) give a part of it.

        Raises InputError without pandas, for a relay that the log does not have, and for a whole log that
        would take more than 4 GB of memory.
        """
        return log_frame(self, relay, from_ns, to_ns)

    def warn(self, text: str) -> None:
        """Notes what could not be read, once."""
        self._contents.warn(text)

    def _sources(self, kind: str) -> tuple[str, ...]:
        return tuple(dict.fromkeys(source_of(t) for t in self._channels if t.startswith(f"/{kind}/")))

    # -- topics ----------------------------------------------------------------------------------------------

    def windows(self, size: int = WINDOW_BYTES) -> list[tuple[int, int]]:
        """Stretches of time [ns since the start], one after the other and all together everything, each with
        about ``size`` bytes of messages in it."""
        segments = sorted(self._contents.segments, key=lambda segment: segment.first_ns)
        edges, held = [-MOST_NS], 0
        for segment in segments:
            edge = segment.first_ns - self.start_ns
            if held > size and edge > edges[-1]:
                edges.append(edge)
                held = 0
            held += segment.head.size if segment.head else segment.stop - segment.start
        return list(pairwise([*edges, MOST_NS]))

    def stretches(self, size: int = WINDOW_BYTES) -> Iterator[tuple[int, int]]:
        """The same one by one; ``progress`` is told how far that is."""
        windows = self.windows(size)
        for place, span in enumerate(windows):
            if self.progress is not None:
                self.progress(place / len(windows))
            yield span

    def array(self, topic: str, from_ns: int | None = None, to_ns: int | None = None) -> np.ndarray:
        """All messages of a topic: a structured array (n,), ``t_ns`` [ns since the start], then the fields.

        Numbers are numbers, texts and bytes are objects; ordered by time.  ``from_ns`` (included) and
        ``to_ns`` (not included) give a part of it.  Raises InputError for a topic that the log or the table
        of messages does not have, and for damaged content.
        """
        message = message_of(topic)
        if topic not in self._channels or message is None:
            ours = [name for name in self.topics if message_of(name)]
            raise InputError(f"no topic of ours; {nearest(topic, ours)}", file=self.path, key=topic)
        if from_ns is not None or to_ns is not None:
            span = (-MOST_NS if from_ns is None else from_ns, MOST_NS if to_ns is None else to_ns)
            rows = self._rows(topic, message, self._segments_in(*span))
            rows = rows[slice(*np.searchsorted(rows["t_ns"], span))]
            rows.flags.writeable = False
            return rows
        if topic not in self._arrays:
            self._arrays[topic] = self._rows(topic, message, self._contents.segments)
            self._arrays[topic].flags.writeable = False
        return self._arrays[topic]

    def _segments_in(self, from_ns: int, to_ns: int) -> list[Segment]:
        segments = self._contents.segments
        if self._spans is None:
            ends = [(s.first_ns - self.start_ns, s.last_ns - self.start_ns) for s in segments]
            self._spans = np.array(ends, np.float64).reshape(-1, 2)  # rounded: one too many at most
        first, last = self._spans[:, 0], self._spans[:, 1]
        near = (first <= np.nextafter(to_ns, np.inf)) & (last >= np.nextafter(from_ns, -np.inf))
        return [segments[place] for place in np.flatnonzero(near).tolist()]

    def _rows(self, topic: str, message: Message, segments: list[Segment]) -> np.ndarray:
        channels = self._channels[topic]
        try:
            found = [
                self._reader.rows(segment, channel, message)
                for channel in channels
                for segment in segments
                if segment.may_hold(channel.id)
            ]
        except DAMAGE as error:
            raise InputError(f"is damaged: {error}", file=self.path, key=topic) from error
        rows = _joined([part for part in found if len(part)], array_dtype(message))
        if (np.diff(rows["t_ns"]) < 0).any():
            rows = rows[np.argsort(rows["t_ns"], kind="stable")]
        return rows

    def samples(self, relay: str, from_ns: int | None = None, to_ns: int | None = None) -> np.ndarray:
        """Sampled values: t_ns, sample_count, va vb vc [V], ia ib ic [A], primary."""
        return self.array(table.SAMPLED_VALUES.topic_for(relay), from_ns, to_ns)

    def phasors(self, relay: str, from_ns: int | None = None, to_ns: int | None = None) -> np.ndarray:
        """Phasors: t_ns, va_re ... ic_im [V, A RMS, primary], frequency_hz, rocof_hz_per_s."""
        return self.array(table.PHASORS.topic_for(relay), from_ns, to_ns)

    def loops(self, relay: str, from_ns: int | None = None, to_ns: int | None = None) -> np.ndarray:
        """Loop impedances: t_ns, ag_r ag_x ... ca_x [ohm, primary]."""
        return self.array(table.LOOP_IMPEDANCES.topic_for(relay), from_ns, to_ns)

    def elements(self, relay: str, from_ns: int | None = None, to_ns: int | None = None) -> np.ndarray:
        """Element bit sets: t_ns, pickup, operate; ``bits`` names them."""
        return self.array(table.ELEMENTS.topic_for(relay), from_ns, to_ns)

    def bits(self, relay: str) -> dict[str, tuple[str, ...]]:
        """Names of the bits of ``pickup`` and ``operate``, lowest first; none where they cannot be read."""
        topic = table.ELEMENTS.topic_for(relay)
        found = {}
        for word in ("pickup", "operate"):
            names = self.channel_json(topic, f"{word}_bits", list)
            if not all(isinstance(name, str) for name in names) or len(names) > 64:
                self.warn(f"{topic}: its {word}_bits are no names: the elements of {relay} have none")
                names = []
            found[word] = tuple(names)
        return found

    def characteristics(self, relay: str) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Per zone the ground and the phase polygon, each (k, 2) of R, X [ohm, primary]; without those that
        cannot be read."""
        return _polygons(self, table.LOOP_IMPEDANCES.topic_for(relay))

    def channel_json(self, topic: str, key: str, kind: type) -> Any:
        """A channel's metadata that is JSON; empty, with a warning, where it is not of its kind."""
        text = self.channel_metadata(topic).get(key)
        if text is None:
            return kind()
        try:
            found = json.loads(text)
        except (ValueError, RecursionError):
            found = None
        if not isinstance(found, kind):
            self.warn(f"{topic}: its metadata '{key}' cannot be read and counts as absent")
            return kind()
        return found

    def channel_metadata(self, topic: str) -> dict[str, str]:
        """What the writer noted with a topic: units, bit names, characteristics."""
        return dict(self._channels[topic][0].metadata) if topic in self._channels else {}

    def entries(self, *kinds: Message, from_ns: int | None = None, to_ns: int | None = None) -> list[Entry]:
        """The messages of these kinds from all their topics, by time."""
        found = []
        for topic in self.topics:
            message = message_of(topic)
            if message in kinds and message is not None:
                names = [f.name for f in message.fields]
                for row in self.array(topic, from_ns, to_ns).tolist():
                    found.append(Entry(row[0], topic, dict(zip(names, row[1:], strict=True))))
        return sorted(found, key=lambda entry: entry.t_ns)

    def walk(self, *kinds: Message) -> Iterator[Entry]:
        """The same one by one, with no more of the log in memory than a stretch."""
        for from_ns, to_ns in self.stretches():
            yield from self.entries(*kinds, from_ns=from_ns, to_ns=to_ns)

    def last_ns(self, *kinds: Message) -> list[int]:
        """Time of the last message of each topic of these kinds that has any."""
        found, windows = [], self.windows()[::-1]
        for topic in self.topics:
            if message_of(topic) in kinds:
                parts = (self.array(topic, *span)["t_ns"] for span in windows)
                found += [int(t_ns[-1]) for t_ns in parts if len(t_ns)][:1]
        return found

    @property
    def trips(self) -> list[Entry]:
        """Trips of all relays, as they decided."""
        return self.entries(table.TRIP)

    @property
    def events(self) -> list[Entry]:
        """What nodes and relays said."""
        return self.entries(table.EVENT)

    @property
    def breaker_states(self) -> list[Entry]:
        """Commands to breakers and changes of their poles."""
        return self.entries(table.BREAKER_STATUS)

    @property
    def faults(self) -> list[Entry]:
        """Faults, as the plant applied and removed them."""
        return self.entries(table.FAULT_STATE)

    @property
    def digital(self) -> list[Entry]:
        """A replayed record's own digital channels: the states at the start, then the changes."""
        return self.entries(table.RECORD_DIGITAL)

    @property
    def can(self) -> list[Entry]:
        """Frames on the bus."""
        return self.entries(table.CAN_FRAME)


def _polygons(log: Log, topic: str) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """`Log.characteristics` of a topic."""
    found = {}
    for zone, shapes in log.channel_json(topic, "characteristics", dict).items():
        try:
            polygons = tuple(
                np.asarray(shapes[kind] or np.empty((0, 2)), dtype=np.float64).reshape(-1, 2)
                for kind in ("ground", "phase")
            )
            if not all(np.isfinite(polygon).all() for polygon in polygons):
                raise ValueError("infinite")
        except (ValueError, TypeError, LookupError, OverflowError):
            log.warn(f"{topic}: the characteristic of '{zone}' is no polygon and left out")
        else:
            found[zone] = polygons
    return found


def _start_ns(contents: Contents) -> int:
    """As the run noted it; the first message's time where that is missing or cannot be."""
    firsts = [segment.first_ns for segment in contents.segments]
    first = min(firsts, default=0)
    text = contents.metadata.get(LOG_RECORD, {}).get("start_ns")
    if text is None:
        return first
    found = int(text) if text.isascii() and text.isdecimal() and len(text) < 20 else -1
    if not 0 <= found <= (first if firsts else MOST_NS):
        what = f"metadata {LOG_RECORD}.start_ns is no start of this log: times count from its first message"
        contents.warn(what)
        return first
    return found


def _joined(parts: list[np.ndarray], dtype: np.dtype) -> np.ndarray:
    """One array of parts; as opaque bytes where it can be, since NumPy looks into structured rows."""
    if dtype.hasobject or len(parts) < 2:
        return np.concatenate(parts) if parts else np.empty(0, dtype)
    opaque = f"V{dtype.itemsize}"
    return np.concatenate([part.view(opaque) for part in parts]).view(dtype)


def map_file(path: str | Path) -> mmap.mmap | bytes:
    """The bytes of a file, mapped.  Raises InputError if it cannot be read or does not begin as MCAP does."""
    path = Path(path)
    check_input(path, "a log")
    try:
        with path.open("rb") as stream:
            size = stream.seek(0, 2)
            data = mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) if size else b""
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", file=path) from error
    if not size:
        raise InputError("is empty; it should be an MCAP log", file=path)
    if data[: len(MAGIC)] != MAGIC:
        raise InputError("is not an MCAP file: it does not begin with MCAP's magic bytes", file=path)
    return data


def open_log(path: str | Path) -> Log:
    """Opens a log that was closed whole.

    Raises InputError if the file is missing, empty, not MCAP, damaged, or half-written; it recovers nothing
    silently: that is ``recover_log``.
    """
    path = Path(path)
    if not path.exists():
        left = ", ".join(part.name for part in parts_of(path))
        hint = f"; a run that was cut off left {left}: faultloop recover {path} OUT.mcap" if left else ""
        raise InputError(f"no such file{hint}", file=path)
    data = map_file(path)
    if data[-len(MAGIC) :] != MAGIC or len(data) < 2 * len(MAGIC):
        raise InputError(
            f"is half-written: it has no footer; faultloop recover {path} OUT.mcap brings back what is whole",
            file=path,
        )
    try:
        return Log(path, data)
    except DAMAGE as error:
        raise InputError(
            f"is damaged: {error}; faultloop recover may bring back a part of it", file=path
        ) from error
