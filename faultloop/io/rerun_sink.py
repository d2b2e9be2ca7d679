"""The rerun stream: the same calls as the log writer, shown as waveforms, phasors, R-X plane and timelines.

rerun is imported when the first sink is made (0.3 s).  Samples are sent in blocks of 50 ms as columns: a call
per sample costs 20 us, a row of a block under 1 us.
"""

from __future__ import annotations

import contextlib
import importlib
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from faultloop.errors import InputError
from faultloop.io import messages
from faultloop.io.mcap_reader import Log
from faultloop.io.messages import (
    BREAKER_STATUS,
    CAN_FRAME,
    EVENT,
    FAULT_STATE,
    LEVELS,
    LOOPS,
    POLES,
    RECORD_DIGITAL,
    SAMPLED,
    TRIP,
    bit_names,
    message_of,
    source_of,
)
from faultloop.io.rerun_rare import RareRows
from faultloop.io.rerun_target import open_target
from faultloop.io.rerun_view import (
    CLOCK,
    FROM_FAULT,
    LOCUS_HZ,
    TIMELINE,
    Characteristics,
    blueprint,
    draw_line,
    draw_plane,
    move_zone,
    style_relay,
)

TRIP_EVENT = "PTRC1 Tr poles"
BLOCK_NS = 50_000_000  # what is sent at once
ROWS = 960  # of a block when a whole log is sent


class RelayStream:
    """What one relay has that is not sent yet, and how far what is sent goes."""

    def __init__(self, name: str, bits: Sequence[str], reach: float, zones: tuple[str, ...]) -> None:
        self.name = name
        self.zones = zones
        self.names = bit_names(tuple(bits))
        self.elements = tuple(bits)
        self.reach = reach  # [ohm] loci are drawn up to some times this
        self.blocks: list[tuple[np.ndarray, ...]] = []
        self.pickup = self.operate = 0
        self.last_ns: int | None = None  # of what is sent
        self.newest = {loop: np.full(2, np.nan) for loop in LOOPS}  # point of each locus


class RerunSink:
    """Streams a run to rerun.

    Parameters
    ----------
    target : ``spawn`` (a viewer window), ``serve`` (a server on this machine that viewers connect to), a file
        ``F.rrd`` (written aside and renamed on ``close``), or the URL of a viewer
        (``rerun+http://127.0.0.1:9876/proxy``).
    start_ns : start of the run [ns since 1970-01-01 UTC].
    name : shown as the recording's name.

    Attributes
    ----------
    url : where a viewer finds the stream (``serve``), else None.
    zero_ns : when the fault began, if set before anything is sent: another timeline then counts from it.

    Raises InputError for a target that is none of these or is not there, and without the package rerun-sdk.
    """

    def __init__(self, target: str, start_ns: int, name: str = "run") -> None:
        try:
            self._rr = importlib.import_module("rerun")
        except ImportError as error:
            raise InputError("rerun is not installed: pip install rerun-sdk", key="--rerun") from error
        self.start_ns = start_ns
        self._stream = self._rr.RecordingStream("faultloop", send_properties=True)
        self.url, self._file, self._part = open_target(self._rr, self._stream, target)
        self._stream.send_recording_name(name)
        self._relays: dict[str, RelayStream] = {}
        self._rare = RareRows(self._rr, self._stream, self._times)
        self._documents: list[str] = []
        self._layout_due = True
        self.zero_ns: int | None = None

    # -- the calls of the log writer -----------------------------------------------------------------

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Makes a metadata record a property of the recording."""
        self._stream.send_property(name, self._rr.AnyValues(**values))

    def add_attachment(self, name: str, data: str | bytes) -> None:
        """Shows a TOML file beside the events; leaves out anything else."""
        if name.endswith(".toml"):
            text = data if isinstance(data, str) else data.decode("utf-8", "replace")
            path = self._path("document", name)
            document = self._rr.TextDocument(f"```toml\n{text}\n```", media_type="text/markdown")
            self._stream.log(path, document, static=True)
            self._documents.append(path)
            self._layout_due = True

    def add_relay(
        self, name: str, bits: Sequence[str], characteristics: Characteristics | None = None
    ) -> None:
        """Makes the views of a relay; arguments as in ``LogWriter.add_relay``."""
        reach = draw_plane(self._rr, self._stream, self._path("relay", name), characteristics or {})
        style_relay(self._rr, self._stream, self._path("relay", name))
        self._relays[name] = RelayStream(name, bits, reach, tuple(characteristics or {}))
        self._layout_due = True

    def draw_line(self, name: str, z1: complex) -> None:
        """Draws a relay's line on its R-X plane: its positive-sequence impedance [ohm, primary]."""
        draw_line(self._rr, self._stream, self._path("relay", name), z1)

    def move_zone(self, name: str, zone: str, t_ns: np.ndarray, polygons: Sequence[np.ndarray]) -> None:
        """A zone as it was at these times, (k, 2) [ohm, primary] each, beside it as set; none where empty."""
        path, place = self._path("relay", name), self._relays[name].zones.index(zone)
        move_zone(self._rr, self._stream, f"{path}/plane/zone_now/{zone}", place, self._times(t_ns), polygons)

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
        *_: np.ndarray,
    ) -> None:
        """Takes a block as ``LogWriter.relay_block`` does; sends it when 50 ms are together."""
        if not len(t_ns):
            return
        relay = self._relays[name]
        relay.blocks.append(tuple(np.array(a) for a in (t_ns, samples, phasors, loops, pickup, operate)))
        if relay.blocks[-1][0][-1] - relay.blocks[0][0][0] >= BLOCK_NS:
            self._send(relay)

    def message(self, topic: str, t_ns: int, message_name: str, **fields: Any) -> None:
        """Shows a rare message: breakers and faults as lanes, trips, events and frames as text."""
        if message_name == BREAKER_STATUS.name:
            self._breaker(source_of(topic), t_ns, fields)
        elif message_name == FAULT_STATE.name:
            lane = self._path("state", "fault", str(fields.get("fault", 0)))
            self._rare.state(lane, t_ns, fields.get("type", "on") if fields.get("on") else None)
        elif message_name == RECORD_DIGITAL.name:
            lane = self._path("state", "record", fields.get("name") or str(fields.get("number", 0)))
            self._rare.state(lane, t_ns, "on" if fields.get("on") else None)
        elif message_name in (EVENT.name, EVENT.full_name):
            level = fields.get("level", "INFO")
            level = level if isinstance(level, str) else LEVELS[level]
            if (message := fields.get("message", "")).startswith(TRIP_EVENT):
                return  # the trip itself says more
            text = f"{fields.get('name', '')}: {message}".removeprefix(": ")
            self._rare.text("events", t_ns, text, level)
        elif message_name == TRIP.name:
            zone = f" zone {fields['zone']}" if fields.get("zone") else ""
            text = f"{source_of(topic)}: trip {fields.get('function', '')}{zone} {fields.get('loop', '')}"
            self._rare.text("events", t_ns, text.rstrip(), "WARNING")
        elif message_name == CAN_FRAME.name:
            data = bytes(fields.get("data", b""))
            text = f"{fields.get('id', 0):03X}  [{len(data)}]  {data.hex(' ')}  {fields.get('sender', '')}"
            self._rare.text("can", t_ns, text.rstrip(), fields.get("direction", "").upper() or "TRACE")

    def flush(self) -> None:
        """Sends everything held."""
        for relay in self._relays.values():
            self._send(relay)
        self._rare.send()
        self._stream.flush()

    def close(self) -> None:
        """Sends the rest.  A file gets its name; a server goes on serving until the program ends."""
        self.flush()
        if self._file is not None and self._part is not None:
            self._stream.disconnect()
            try:
                self._part.replace(self._file)
            except OSError as error:
                raise InputError(f"cannot be written: {error.strerror}", file=self._file) from error

    def wait(self) -> None:
        """Serves until the user interrupts; returns at once if this sink is no server."""
        with contextlib.suppress(KeyboardInterrupt):
            while self.url is not None:
                time.sleep(0.5)

    def abort(self) -> None:
        """Sends the rest and leaves a file as ``F.rrd.part``."""
        self.flush()
        if self._file is not None:
            self._stream.disconnect()

    # -- sending -------------------------------------------------------------------------------------

    def _path(self, *parts: str) -> str:
        return self._rr.new_entity_path(list(parts))

    def _times(self, t_ns: np.ndarray) -> list[Any]:
        return _time_columns(self._rr, t_ns, self.start_ns, self.zero_ns)

    def _send(self, relay: RelayStream) -> None:
        if not relay.blocks:
            return
        self._lay_out()
        self._rare.send()
        t_ns, samples, phasors, loops, pickup, operate = (
            np.concatenate(parts) for parts in zip(*relay.blocks, strict=True)
        )
        relay.blocks = []
        path = self._path("relay", relay.name)
        with np.errstate(over="ignore"):
            magnitude = np.hypot(phasors[:, 0:12:2], phasors[:, 1:12:2])
        series = {
            "voltage": samples[:, :3] / 1e3,
            "current": samples[:, 3:] / 1e3,
            "voltage_rms": magnitude[:, :3] / 1e3,
            "current_rms": magnitude[:, 3:] / 1e3,
            "frequency": phasors[:, 12:13],
        }
        broken, gaps = _gaps(t_ns, relay.last_ns)
        relay.last_ns, times = int(t_ns[-1]), self._times(broken)
        for name, values in series.items():
            values = np.insert(values, gaps, np.nan, axis=0)  # or a line would be drawn across the gap
            columns = self._rr.Scalars.columns(scalars=values.ravel())
            lengths = np.full(len(values), values.shape[1])
            self._stream.send_columns(f"{path}/{name}", times, columns.partition(lengths))
        self._send_loci(relay, path, t_ns, loops)
        self._send_bits(relay, t_ns, pickup, operate)

    def _send_loci(self, relay: RelayStream, path: str, t_ns: np.ndarray, loops: np.ndarray) -> None:
        """The six impedances: a step from each drawn point to the next, and the newest point.

        A point that is not defined, or far out of the picture (load), clears the newest and leaves a gap.
        """
        every = max(1, round(len(t_ns) * 1e9 / LOCUS_HZ / (t_ns[-1] - t_ns[0] + 1)))
        rows = np.arange(0, len(t_ns), every)
        times = self._times(t_ns[rows])
        for place, loop in enumerate(LOOPS):
            points = loops[rows, 2 * place : 2 * place + 2]
            before = np.vstack((relay.newest[loop], points[:-1]))
            relay.newest[loop] = points[-1]
            near = (np.abs(points) < 4 * relay.reach).all(axis=1)  # NaN is not
            whole = near & (np.abs(before) < 4 * relay.reach).all(axis=1)
            now = self._rr.Points2D.columns(positions=points[near]).partition(near.astype(int))
            self._stream.send_columns(f"{path}/plane/now/{loop}", times, now)
            if whole.any():
                steps = self._rr.LineStrips2D.columns(strips=np.stack((before, points), axis=1)[whole])
                self._stream.send_columns(f"{path}/plane/locus/{loop}", self._times(t_ns[rows][whole]), steps)

    def _send_bits(
        self, relay: RelayStream, t_ns: np.ndarray, pickup: np.ndarray, operate: np.ndarray
    ) -> None:
        """One lane per element that has ever started: what it does, at its changes."""
        started = np.append(np.uint64(relay.pickup), pickup[:-1])
        acted = np.append(np.uint64(relay.operate), operate[:-1])
        changed = (started ^ pickup) | (acted ^ operate)
        for bit, element in enumerate(relay.elements):
            mask = np.uint64(1 << bit)
            rows = np.flatnonzero(changed & mask)
            if not len(rows):
                continue
            names = relay.names["pickup"][bit], relay.names["operate"][bit]
            states = _states(names, pickup[rows] & mask, operate[rows] & mask)
            self._rare.send_states(self._path("state", relay.name, element), t_ns[rows], states)
        relay.pickup, relay.operate = int(pickup[-1]), int(operate[-1])

    def _breaker(self, name: str, t_ns: int, fields: Mapping[str, Any]) -> None:
        """One lane per breaker: closed, open, or the poles that are."""
        closed = "".join(pole for pole in POLES if fields.get(f"pole_{pole.lower()}"))
        state = {"ABC": "closed", "": "open"}.get(closed, f"{closed} closed")
        self._rare.state(self._path("state", "breaker", name), t_ns, state)

    def _lay_out(self) -> None:
        """Sends the layout when there is something new to lay out."""
        if self._layout_due:
            reaches = {name: relay.reach for name, relay in self._relays.items()}
            timeline = TIMELINE if self.zero_ns is None else FROM_FAULT
            self._stream.send_blueprint(blueprint(self._rr, reaches, self._documents, timeline))
            self._layout_due = False


def _states(names: tuple[str, str], started: np.ndarray, acting: np.ndarray) -> list[str | None]:
    """What a lane shows: how the element operates, else how it starts, by the bits' names; else nothing."""
    start, operate = (name.rpartition(".")[2] for name in names)
    return [
        (operate or "Op") if acts else start if on else None for on, acts in zip(started, acting, strict=True)
    ]


def _time_columns(rr: Any, t_ns: np.ndarray, start_ns: int, zero_ns: int | None) -> list[Any]:
    """Since the run's start, the time of day, and since the fault where that is known."""
    lines = [
        rr.TimeColumn(TIMELINE, duration=t_ns.astype("timedelta64[ns]")),
        rr.TimeColumn(CLOCK, timestamp=(t_ns + start_ns).astype("datetime64[ns]")),
    ]
    if zero_ns is not None:
        lines.append(rr.TimeColumn(FROM_FAULT, duration=(t_ns - zero_ns).astype("timedelta64[ns]")))
    return lines


def log_to_rerun(log: Log, target: str, more: Callable[[RerunSink], None] | None = None) -> RerunSink:
    """Shows a whole log, in stretches; ``target`` as for ``RerunSink``.  With ``serve``, ``wait`` on what is
    returned.  ``more``: what else is to be shown of its relays, once they are there."""
    sink = RerunSink(target, log.start_ns, name=log.metadata.get("scenario", {}).get("name") or log.path.stem)
    sink.zero_ns = next((entry.t_ns for entry in log.walk(FAULT_STATE) if entry.on), None)
    for name, values in log.metadata.items():
        sink.add_metadata(name, values)
    for name, data in log.attachments.items():
        sink.add_attachment(name, data)
    for relay in log.relays:
        bits = [name.removesuffix(".Str") for name in log.bits(relay)["pickup"]]
        sink.add_relay(relay, bits, log.characteristics(relay))
    if more is not None:
        more(sink)
    changing, whole = _changing(log), []
    for relay in log.relays:
        missing = [kind.topic_for(relay) for kind in SAMPLED if kind.topic_for(relay) not in log.topics]
        if missing:
            log.warn(f"no curves of {relay}: {', '.join(missing)} missing")
        else:
            whole.append(relay)
    for span in log.stretches():
        for entry in log.entries(*RARE, from_ns=span[0], to_ns=span[1]):
            if entry.topic == RECORD_DIGITAL.topic and entry.fields["number"] not in changing:
                continue
            message = message_of(entry.topic)
            assert message is not None  # entries() gives our own messages only
            sink.message(entry.topic, entry.t_ns, message.name, **entry.fields)
        for relay in whole:
            _send_stretch(sink, log, relay, span)
    sink.close()
    return sink


RARE = (BREAKER_STATUS, FAULT_STATE, EVENT, TRIP, RECORD_DIGITAL, CAN_FRAME)


def _changing(log: Log) -> set[int]:
    """The digital channels of a replayed record that changed: of hundreds some have a lane."""
    counts = Counter(entry.fields["number"] for entry in log.walk(RECORD_DIGITAL))
    return {number for number, count in counts.items() if count > 1}


def _send_stretch(sink: RerunSink, log: Log, relay: str, span: tuple[int, int]) -> None:
    """A relay's part of a log between two times."""
    samples, elements = log.samples(relay, *span), log.elements(relay, *span)
    floats = [messages.values(rows) for rows in (samples, log.phasors(relay, *span), log.loops(relay, *span))]
    whole = (samples["t_ns"], samples["sample_count"], *floats, elements["pickup"], elements["operate"])
    count = min(len(array) for array in whole)  # a cut may leave one topic a row longer
    for start in range(0, count, ROWS):
        sink.relay_block(relay, *(array[start : min(start + ROWS, count)] for array in whole))


def _gaps(t_ns: np.ndarray, last_ns: int | None) -> tuple[np.ndarray, np.ndarray]:
    """Times with one more in each gap between samples, and where those are put in."""
    steps = np.diff(t_ns, prepend=t_ns[0] if last_ns is None else last_ns)
    usual = float(np.median(steps[1:])) if len(steps) > 1 else np.inf
    gaps = np.flatnonzero(steps > 1.5 * usual)
    return np.insert(t_ns, gaps, t_ns[gaps] - steps[gaps] // 2), gaps
