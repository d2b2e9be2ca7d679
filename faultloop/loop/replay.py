"""Play a recorded fault into a relay, as a test set does."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from faultloop.errors import InputError, nearest
from faultloop.io.comtrade.read import read_comtrade
from faultloop.io.comtrade.record import Record
from faultloop.io.comtrade.resample import resample
from faultloop.io.comtrade.select import SLOTS, select_channels
from faultloop.io.mcap_reader import open_log
from faultloop.loop.outcome import EventText, pole_names
from faultloop.loop.recording import Attachments, MemorySink, Metadata, Recorder, open_streams, versions
from faultloop.relay import Relay, RelaySettings, load_settings

if TYPE_CHECKING:
    from faultloop.io.rerun_sink import RerunSink

SECOND_NS = 1_000_000_000
BLOCK = 240
NAME = "replay"
"""What the relay is called in the log."""


@dataclass(frozen=True)
class Played:
    """What the relay is fed with: ``samples`` (n, 6) primary at its own rate, from ``start_ns`` on."""

    samples: NDArray[np.float64]
    start_ns: int
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class ReplayTrip:
    """A trip, at the relay: there is no breaker in a replay."""

    function: str
    zone: int
    loop: str
    poles: int
    sample_count: int
    t_ns: int


@dataclass
class ReplayResult:
    """What the relay made of a record.

    Attributes
    ----------
    trips, events : in order of time; times from the record's first sample.
    first_pickup_ns, first_operate_ns : by bit name, of those that ever were on.
    fault_location : per unit of the line; NaN where none was found.
    """

    record: Path
    settings: RelaySettings
    trips: list[ReplayTrip]
    events: list[EventText]
    first_pickup_ns: dict[str, int]
    first_operate_ns: dict[str, int]
    fault_location: float
    duration_ns: int
    notes: tuple[str, ...]
    log: Path | None
    memory: MemorySink | None = None
    rerun: RerunSink | None = None

    def samples(self) -> np.ndarray:
        """Sampled values (n,), as the relay saw them."""
        return self._array("samples")

    def phasors(self) -> np.ndarray:
        """Phasors (n,)."""
        return self._array("phasors")

    def loops(self) -> np.ndarray:
        """Loop impedances (n,), ohm primary."""
        return self._array("loops")

    def _array(self, what: str) -> np.ndarray:
        if self.memory is not None:
            return self.memory.array(NAME, what)
        return getattr(open_log(self.log or ""), what)(NAME)

    def as_dict(self) -> dict[str, Any]:
        """For ``--json``."""
        return {
            "record": str(self.record),
            "duration_s": self.duration_ns / 1e9,
            "log": None if self.log is None else str(self.log),
            "tripped": bool(self.trips),
            "trips": [
                {
                    "function": t.function,
                    "zone": t.zone,
                    "loop": t.loop,
                    "poles": pole_names(t.poles),
                    "sample_count": t.sample_count,
                    "t_s": t.t_ns / 1e9,
                }
                for t in self.trips
            ],
            "fault_location_pu": self.fault_location,
            "pickup_s": {name: t / 1e9 for name, t in self.first_pickup_ns.items()},
            "operate_s": {name: t / 1e9 for name, t in self.first_operate_ns.items()},
            "notes": list(self.notes),
            "events": [{"t_s": e.t_ns / 1e9, "level": e.level, "text": e.text} for e in self.events],
        }


def replay(
    record: Path | str,
    settings: Path | str | RelaySettings,
    *,
    mapping: str | None = None,
    log: Path | str | None = None,
    rerun: str | None = None,
) -> ReplayResult:
    """Play ``record`` into a relay with ``settings``.

    Parameters
    ----------
    record : COMTRADE ``.cfg`` or ``.cff``, or a faultloop ``.mcap``.
    mapping : which channels are va, vb, vc, ia, ib, ic: ``"va=0,vb=1*1.414214,ic=IL3"``; of a log
        ``"relay=NAME"``.  Found by the channels' phases and units where not given.
    log : the MCAP log to write; none if not given, and then the arrays are kept in memory.
    rerun : as for `faultloop.run`.

    Raises InputError for anything wrong with them.
    """
    record = Path(record)
    own = settings if isinstance(settings, RelaySettings) else load_settings(settings)
    relay = Relay(own, name=NAME)
    if record.suffix.lower() == ".mcap":
        played = _from_log(record, own, mapping)
    else:
        played = _from_comtrade(record, own, mapping)
    memory = MemorySink() if log is None else None
    metadata, attachments = _describe(record, own, mapping)
    streams = open_streams(played.start_ns, log, rerun, record.stem, metadata, attachments)
    recorder = Recorder(streams.sinks)
    if memory is not None:
        recorder.sinks.append(memory)
    result = ReplayResult(
        record,
        own,
        [],
        [],
        {},
        {},
        float("nan"),
        len(played.samples) * SECOND_NS // own.relay.sampling_hz,
        played.notes,
        None if log is None else Path(log),
        memory,
        streams.rerun,
    )
    try:
        _play(relay, played, recorder, result)
    except KeyboardInterrupt:
        recorder.close()  # whole, as far as it came
        raise
    except BaseException:
        recorder.abort()
        raise
    recorder.close()
    return result


def _play(relay: Relay, played: Played, recorder: Recorder, result: ReplayResult) -> None:
    """The whole record, block by block."""
    rate = relay.settings.relay.sampling_hz
    topic = f"/relay/{NAME}/events"
    recorder.add_relay(NAME, relay.bits, relay.characteristics())
    for note in played.notes:
        _tell(recorder, result, topic, 0, "info", note)
    k, total = 0, len(played.samples)
    while k < total:
        block = played.samples[k : k + BLOCK]
        m = relay.advance(block)
        counts = np.arange(k, k + m)
        t_ns = counts * SECOND_NS // rate
        recorder.relay_block(
            NAME, t_ns, counts, block[:m], relay.phasors, relay.loops, relay.pickup, relay.operate
        )
        _first_times(relay.bits, relay.pickup, t_ns, result.first_pickup_ns)
        _first_times(relay.bits, relay.operate, t_ns, result.first_operate_ns)
        for event in relay.events:
            at_ns = event.sample_count * SECOND_NS // rate
            _tell(recorder, result, topic, at_ns, event.level, event.text)
            if event.trip is not None:
                t = event.trip
                result.trips.append(
                    ReplayTrip(t.function, t.zone, t.loop, t.poles, event.sample_count, at_ns)
                )
                recorder.message(
                    f"/relay/{NAME}/trips",
                    at_ns,
                    "Trip",
                    function=t.function,
                    zone=t.zone,
                    loop=t.loop,
                    poles=t.poles,
                    sample_count=event.sample_count,
                )
        k += m
    result.fault_location = relay.fault_location


def _tell(recorder: Recorder, result: ReplayResult, topic: str, t_ns: int, level: str, text: str) -> None:
    result.events.append(EventText(t_ns, NAME, level, text))
    recorder.event(topic, t_ns, level, text, NAME)


def _first_times(
    bits: tuple[str, ...], words: NDArray[np.uint64], t_ns: NDArray[np.int64], first: dict[str, int]
) -> None:
    """When each bit was first on."""
    ever = int(np.bitwise_or.reduce(words))
    for place, name in enumerate(bits):
        if ever >> place & 1 and name not in first:
            first[name] = int(t_ns[np.argmax(words >> np.uint64(place) & np.uint64(1))])


def _from_log(record: Path, settings: RelaySettings, mapping: str | None) -> Played:
    """A relay's samples out of a log; its rate must be the relay's own."""
    opened = open_log(record)
    name = opened.relays[0] if len(opened.relays) == 1 else None
    if mapping is not None:
        key, _, name = mapping.partition("=")
        if key.strip() != "relay" or not name:
            raise InputError(f"of a log say relay=NAME, not '{mapping}'", key="--map")
        name = name.strip()
    if name is None:
        raise InputError(
            f"which relay's samples? say --map relay=NAME with one of {', '.join(opened.relays) or 'none'}",
            file=record,
        )
    if name not in opened.relays:
        raise InputError(f"no relay '{name}'; {nearest(name, opened.relays)}", file=record, key="--map")
    rows = opened.samples(name)
    if len(rows) < 2:
        raise InputError(f"relay '{name}' has {len(rows)} samples; at least 2 are needed", file=record)
    span = int(rows["t_ns"][-1] - rows["t_ns"][0])
    rate = round((len(rows) - 1) * SECOND_NS / span) if span > 0 else 0
    if rate != settings.relay.sampling_hz:
        raise InputError(
            f"is {settings.relay.sampling_hz}, but relay '{name}' of {record.name} was sampled at {rate}",
            file=settings.path,
            key="relay.sampling_hz",
        )
    samples = np.column_stack([rows[channel] for channel in ("va", "vb", "vc", "ia", "ib", "ic")])
    return Played(samples, opened.start_ns + int(rows["t_ns"][0]))


def _describe(record: Path, settings: RelaySettings, mapping: str | None) -> tuple[Metadata, Attachments]:
    """What lets somebody repeat the replay from its log."""
    metadata = {
        "replay": {"record": record.name, "map": mapping or ""},
        "settings": {NAME: settings.model_dump_json()},
        "versions": versions(),
    }
    return metadata, {f"{NAME}.settings.toml": settings.text} if settings.text else {}


def _from_comtrade(record: Path, settings: RelaySettings, mapping: str | None) -> Played:
    """Six channels of a COMTRADE record on the relay's own clock, in primary volts and amperes.

    Where the record is secondary and does not state its ratios, the settings' ratios are taken.
    """
    read = read_comtrade(record)
    ct_ratio = vt_ratio = None
    if settings.relay.ohms == "secondary" and not _states_ratios(read):
        ct_ratio, vt_ratio = settings.relay.ct_ratio, settings.relay.vt_ratio
    try:
        six = select_channels(read, mapping, ct_ratio=ct_ratio, vt_ratio=vt_ratio)
        six = resample(six, settings.relay.sampling_hz)
    except InputError as error:
        raise error.within(record) from None
    names = ", ".join(f"{slot} = {name}" for slot, name in zip(SLOTS, six.names, strict=True) if name)
    stretches = ", then ".join(f"{stretch.hz:g}" for stretch in read.stretches)
    notes = [f"channels: {names}", f"sampled at {stretches} Hz, played at {settings.relay.sampling_hz} Hz"]
    return Played(six.values, read.start_ns, (*notes, *six.notes))


def _states_ratios(record: Record) -> bool:
    return all(channel.scale != "S" or channel.to_primary == channel.to_primary for channel in record.analog)
