"""Play a recorded fault into a relay, as a test set does."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from faultloop.io.comtrade.resample import sample_numbers, sample_times
from faultloop.io.mcap_reader import open_log
from faultloop.loop.doubts import settings_doubts
from faultloop.loop.outcome import Cast, EventText, Fold, Outcome, pole_names
from faultloop.loop.played import Choices, Played, from_comtrade, from_log
from faultloop.loop.recording import Attachments, MemorySink, Metadata, Recorder, open_streams, versions
from faultloop.loop.runner import interruptible
from faultloop.nodes.block import RelayBlock
from faultloop.nodes.clock import SampleClock
from faultloop.relay import Relay, RelayInputs, RelaySettings, load_settings
from faultloop.relay.named_code import refuse_user_code

if TYPE_CHECKING:
    from faultloop.io.rerun_sink import RerunSink

BLOCK = 240
NAME = "replay"
"""What the relay is called in the log."""
BREAKER = "record"
"""What the breaker of the record's own auxiliary contacts is called in the log."""


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
    notes : how the record was read and played; warnings : what makes the result doubtful.
    interrupted : ended by Ctrl-C before the record's end; the log is whole.
    """

    record: Path
    settings: RelaySettings
    """What the relay was set to."""
    trips: list[ReplayTrip]
    events: list[EventText]
    first_pickup_ns: dict[str, int]
    first_operate_ns: dict[str, int]
    fault_location: float
    duration_ns: int
    """How much of the record was played."""
    notes: tuple[str, ...]
    warnings: tuple[str, ...]
    log: Path | None
    memory: MemorySink | None = None
    """What `samples` and its like are read from where there is no log."""
    rerun: RerunSink | None = None
    """The stream, where one was asked for."""
    interrupted: bool = False

    def take(self, outcome: Outcome) -> None:
        """What the messages came to."""
        self.events = outcome.events
        self.trips = [
            ReplayTrip(t.function, t.zone, t.loop, t.poles, t.sample_count, t.t_ns) for t in outcome.trips
        ]

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
            "interrupted": self.interrupted,
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
            "warnings": list(self.warnings),
            "events": [{"t_s": e.t_ns / 1e9, "level": e.level, "text": e.text} for e in self.events],
        }


def replay(
    record: Path | str,
    settings: Path | str | RelaySettings,
    *,
    mapping: str | None = None,
    unit: Mapping[str, str] | None = None,
    scale: Mapping[str, float] | None = None,
    ct_ratio: float | None = None,
    vt_ratio: float | None = None,
    from_s: float = 0.0,
    to_s: float = math.inf,
    log: Path | str | None = None,
    rerun: str | Callable[[str, RelaySettings, int, str], RerunSink] | None = None,
    user_code: bool = True,
    compress: bool = False,
) -> ReplayResult:
    """Play ``record`` into a relay with ``settings``.

    Parameters
    ----------
    record : COMTRADE ``.cfg`` or ``.cff``, or a faultloop ``.mcap``.
    mapping : which channels are va, vb, vc, ia, ib, ic: ``"va=0,vb=1*1.414214,ic=IL3"``; of a log
        ``"relay=NAME"``.  Found by the channels' phases and units where not given.  ``52a=NAME`` and
        ``52b=NAME`` (``52a_a``, ``52a_b``, ``52a_c`` of single poles) are digital channels, and make the
        breaker's position that the relay sees.
    unit : by slot, in place of the record's own: ``{"va": "kV"}``.
    scale : by slot, the factor from that unit to primary, in place of what the record says: ``{"va": 2200}``.
    ct_ratio, vt_ratio : the same for all currents and all voltages.
    from_s, to_s : the part to play, in seconds from the record's first sample.
    log : the MCAP log to write; none if not given, and then the arrays are kept in memory.
    rerun, user_code, compress : as for `faultloop.run`; what makes the stream is given the relay's name, its
        settings, the start [ns since the epoch] and what the recording is called.

    Where the record has nothing for a relay (a decimated stretch, samples or values left out for long), the
    relay gets and the log has no samples; the relay starts anew after that, and `warnings` say so.

    Raises InputError for anything wrong with them.
    """
    record = Path(record)
    own = settings if isinstance(settings, RelaySettings) else load_settings(settings)
    if not user_code:
        refuse_user_code(own)
    choices = Choices(mapping, unit or {}, scale or {}, ct_ratio, vt_ratio, from_s, to_s)
    choices.check()
    played = (from_log if record.suffix.lower() == ".mcap" else from_comtrade)(record, own, choices)
    relay = Relay(own, name=NAME)
    memory = MemorySink() if log is None else None
    metadata, attachments = _describe(record, own, choices)
    compression = "zstd" if compress else ""
    shown = partial(rerun, NAME, own, played.start_ns, record.stem) if callable(rerun) else rerun
    streams = open_streams(played.start_ns, log, shown, record.stem, metadata, attachments, compression)
    fold = Fold(Cast({NAME: None}, ()))
    recorder = Recorder([fold, *streams.sinks])
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
        SampleClock(own.relay.sampling_hz).ns(int(played.numbers[-1] + 1 - played.numbers[0])),
        played.notes,
        (*played.warnings, *settings_doubts(own)),
        None if log is None else Path(log),
        memory,
        streams.rerun,
    )
    try:
        with interruptible(result):
            _Playing(relay, played, recorder, result).run()
        recorder.close()  # interrupted: whole, as far as it came
        result.take(fold.outcome())
    except BaseException:
        recorder.abort()
        if streams.log is not None:
            streams.log.discard()
        raise
    return result


@dataclass
class _Playing:
    """A record on its way through a relay."""

    relay: Relay
    played: Played
    recorder: Recorder
    result: ReplayResult
    told: int = 0  # of the record's digital changes
    moved: int = 0  # of its breaker's
    closed: int = 7
    _cold: Any = field(init=False)

    def __post_init__(self) -> None:
        self._cold = self.relay.save()
        hz = self.rate = self.relay.settings.relay.sampling_hz
        moves = np.array([t_ns for t_ns, _ in self.played.closed], np.int64)
        self._moves = sample_numbers(moves, hz)  # the first sample that is not before the change

    def run(self) -> None:
        """Piece by piece; the relay remembers nothing of what was before a gap."""
        self.recorder.add_relay(NAME, self.relay.bits, self.relay.characteristics())
        begin_ns = self._t_ns(int(self.played.numbers[0]))
        for note in self.played.notes:
            self._tell(begin_ns, "info", note)
        for warning in self.played.warnings:
            self._tell(begin_ns, "warning", warning)
        for first, stop in self.played.pieces:
            if self.result.interrupted:
                break
            number = int(self.played.numbers[first])
            self.relay.restore(self._cold)
            self.relay.sample_count = number
            if first:
                self._tell(self._t_ns(number), "info", "samples again: the relay starts anew")
            self._play(first, stop)
            self.result.fault_location = _either(self.relay.fault_location, self.result.fault_location)
        self._digital_until(2**63 - 1)

    def _play(self, first: int, stop: int) -> None:
        """One piece, block by block."""
        numbers, samples = self.played.numbers, self.played.samples
        turn = turn_of(self.relay.settings, int(numbers[first]))
        k = first
        while k < stop and not self.result.interrupted:
            self._move_breaker(int(numbers[k]))
            last = min(k + BLOCK, stop)
            if self.moved < len(self._moves):
                last = min(last, k + int(self._moves[self.moved] - numbers[k]))
            block = samples[k:last]
            m = self.relay.advance(block)
            t_ns = sample_times(numbers[k : k + m], self.rate)
            self._digital_until(int(t_ns[-1]))
            self._record(t_ns, numbers[k : k + m], block[:m], turn)
            k += m

    def _record(
        self, t_ns: NDArray[np.int64], numbers: NDArray[np.int64], samples: NDArray[np.float64], turn: complex
    ) -> None:
        relay, result = self.relay, self.result
        block = RelayBlock.of(relay, samples)
        if turn != 1:
            phasors = relay.phasors.copy()
            phasors[:, :12].view(np.complex128)[...] *= turn
            block = block._replace(phasors=phasors)
        self.recorder.relay_block(NAME, t_ns, numbers, *block)
        _first_times(relay.bits, relay.pickup, t_ns, result.first_pickup_ns)
        _first_times(relay.bits, relay.operate, t_ns, result.first_operate_ns)
        for event in relay.events:
            at_ns = self._t_ns(event.sample_count)
            self._tell(at_ns, event.level, event.text)
            if event.trip is not None:
                self.recorder.trip(NAME, at_ns, event.sample_count, event.trip)

    def _move_breaker(self, number: int) -> None:
        """The breaker's position at a sample, by the record's own contacts."""
        while self.moved < len(self._moves) and self._moves[self.moved] <= number:
            t_ns, self.closed = self.played.closed[self.moved]
            self.recorder.breaker(BREAKER, t_ns, self.closed, "")
            self.moved += 1
        self.relay.inputs = RelayInputs(breaker_closed=self.closed)

    def _digital_until(self, t_ns: int) -> None:
        changes = self.played.digital
        while self.told < len(changes) and changes[self.told].t_ns <= t_ns:
            change = changes[self.told]
            self.recorder.message(
                "/record/digital",
                change.t_ns,
                "RecordDigital",
                number=change.number,
                name=change.name,
                on=change.on,
                normal=change.normal,
            )
            self.told += 1

    def _t_ns(self, number: int) -> int:
        return int(sample_times(np.array([number]), self.rate)[0])

    def _tell(self, t_ns: int, level: str, text: str) -> None:
        self.recorder.event(f"/relay/{NAME}/events", t_ns, level, text, NAME)


def turn_of(settings: RelaySettings, number: int) -> complex:
    """What turns the phasors of a relay that starts at this sample to the record's first as reference.

    An estimator counts from the first sample that it sees.
    """
    header = settings.relay
    beats = number * int(header.frequency_hz) % header.sampling_hz
    return complex(np.exp(-2j * np.pi * beats / header.sampling_hz)) if beats else 1.0


def _either(found: float, before: float) -> float:
    """The later location of a fault; of a piece that had none, the one before."""
    return before if math.isnan(found) else found


def _first_times(
    bits: tuple[str, ...], words: NDArray[np.uint64], t_ns: NDArray[np.int64], first: dict[str, int]
) -> None:
    """When each bit was first on."""
    ever = int(np.bitwise_or.reduce(words))
    for place, name in enumerate(bits):
        if ever >> place & 1 and name not in first:
            first[name] = int(t_ns[np.argmax(words >> np.uint64(place) & np.uint64(1))])


def _describe(record: Path, settings: RelaySettings, choices: Choices) -> tuple[Metadata, Attachments]:
    """What lets somebody repeat the replay from its log."""
    metadata = {
        "replay": {"record": record.name, **choices.as_metadata()},
        "settings": {NAME: settings.model_dump_json()},
        "versions": versions(),
    }
    return metadata, {f"{NAME}.settings.toml": settings.text} if settings.text else {}
