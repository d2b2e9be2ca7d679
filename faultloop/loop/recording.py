"""Where a run's samples, estimates and messages go: an MCAP log, a rerun stream, memory, or all of them."""

from __future__ import annotations

import importlib.metadata
import platform
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np

from faultloop.config.user_code import load
from faultloop.errors import InputError
from faultloop.io.can.dbc import DBC_PATH
from faultloop.io.messages import (
    ELEMENTS,
    LOOP_IMPEDANCES,
    PHASORS,
    SAMPLED_VALUES,
    Message,
    array_dtype,
    values,
)
from faultloop.io.output_file import check_target
from faultloop.loop.scenario import Scenario
from faultloop.nodes.block import RelayBlock
from faultloop.nodes.clock import SampleClock

if TYPE_CHECKING:
    from faultloop.io.can.frames import Frame
    from faultloop.io.log_thread import LogThread
    from faultloop.io.mcap_writer import LogWriter
    from faultloop.io.rerun_sink import RerunSink
    from faultloop.relay import RelaySettings, Trip

PLANT_EVENTS = "/plant/events"
SINKS = "faultloop.sinks"
"""Group of entry points."""
Characteristics = Mapping[str, tuple[np.ndarray, np.ndarray]]


class Sink(Protocol):
    """What a run writes to (`faultloop.io.mcap_writer.LogWriter`, `faultloop.io.rerun_sink.RerunSink`)."""

    def add_relay(
        self, name: str, bits: Sequence[str], characteristics: Characteristics | None = None
    ) -> None: ...

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
        /,
        *more: np.ndarray,
    ) -> None: ...

    def message(self, topic: str, t_ns: int, message_name: str, **fields: Any) -> None: ...

    def close(self) -> object: ...

    def abort(self) -> object: ...


_KINDS: Mapping[str, Message] = {
    "samples": SAMPLED_VALUES,
    "phasors": PHASORS,
    "loops": LOOP_IMPEDANCES,
    "elements": ELEMENTS,
}


class MemorySink:
    """Keeps the blocks, for `Result.samples()` and its like where there is no log to read them from."""

    wants_texts = False

    def __init__(self) -> None:
        self._blocks: dict[str, list[tuple[np.ndarray, ...]]] = {}
        self.bits: dict[str, tuple[str, ...]] = {}

    def add_relay(
        self, name: str, bits: Sequence[str], characteristics: Characteristics | None = None
    ) -> None:
        """Before its first block."""
        self._blocks[name] = []
        self.bits[name] = tuple(bits)

    def relay_block(self, name: str, *arrays: np.ndarray) -> None:
        """Keeps a copy."""
        self._blocks[name].append(tuple(np.array(a) for a in arrays))

    def message(self, topic: str, t_ns: int, message_name: str, **fields: Any) -> None:
        """Keeps nothing: the outcome has the rare messages."""

    def close(self) -> None:
        """Nothing to close."""

    def abort(self) -> None:
        """Nothing to undo."""

    def array(self, name: str, what: str) -> np.ndarray:
        """As `faultloop.open_log` gives it: ``what`` is samples, phasors, loops or elements."""
        message = _KINDS[what]
        blocks = self._blocks[name]
        columns = [np.concatenate(column) for column in zip(*blocks, strict=True)]
        rows = np.empty(len(columns[0]), array_dtype(message))
        rows["t_ns"] = columns[0]
        if what == "samples":
            rows["sample_count"] = columns[1]
        if what == "elements":
            rows["pickup"], rows["operate"] = columns[5:7]
        else:
            values(rows)[:] = columns[{"samples": 2, "phasors": 3, "loops": 4}[what]]
        return rows


def open_sinks(given: Sequence[Sink | str], start_ns: int, name: str) -> list[Sink]:
    """Sinks, and those that installed packages bring: a name is that of ``make(start_ns, name) -> Sink``.

    Raises
    ------
    InputError : no installed package brings it, or it cannot be made.
    """
    return [_made(sink, start_ns, name) if isinstance(sink, str) else sink for sink in given]


def _made(sink: str, start_ns: int, name: str) -> Sink:
    try:
        return load(sink, Path(), SINKS)(start_ns, name)
    except InputError as error:
        raise InputError(error.what, key="--sink") from error
    except Exception as error:  # whatever somebody's package raises
        raise InputError(f"'{sink}' failed: {type(error).__name__}: {error}", key="--sink") from error


_POLES = [{f"pole_{pole}": bool(closed >> bit & 1) for bit, pole in enumerate("abc")} for closed in range(8)]


class Recorder:
    """The sinks as one; a level is "info", "warning" or "error".

    Parameters
    ----------
    sinks : get everything.
    counts : called at the end with the number of frames by identifier, (2049,), the last one of extended
        frames, where nobody wants to know each: then none is told.
    """

    _LEVELS: Mapping[str, int] = {"debug": 1, "info": 2, "warning": 3, "error": 4}

    def __init__(self, sinks: Sequence[Sink], counts: Callable[[np.ndarray], None] | None = None) -> None:
        self.sinks = list(sinks)
        self.counts = counts
        self.wants_texts = any(getattr(sink, "wants_texts", True) for sink in self.sinks)
        """Whether anybody takes the lines that a person reads."""
        self.told = 0
        """Messages so far."""

    @property
    def wants_blocks(self) -> bool:
        """Whether anybody takes samples and estimates."""
        return any(getattr(sink, "wants_blocks", True) for sink in self.sinks)

    def add_relay(self, name: str, bits: Sequence[str], characteristics: Characteristics) -> None:
        for sink in self.sinks:
            sink.add_relay(name, bits, characteristics)

    def relay_block(self, name: str, *arrays: np.ndarray) -> None:
        for sink in self.sinks:
            sink.relay_block(name, *arrays)

    def block(self, name: str, clock: SampleClock, first: int, block: RelayBlock) -> None:
        """A relay's samples from number `first` on, and what it made of them."""
        counts = np.arange(first, first + len(block.samples))
        self.relay_block(name, clock.ns(counts), counts, *block)

    def message(self, topic: str, t_ns: int, message_name: str, **fields: Any) -> None:
        self.told += 1
        for sink in self.sinks:
            sink.message(topic, t_ns, message_name, **fields)

    def event(self, topic: str, t_ns: int, level: str, text: str, name: str) -> None:
        """A line that a person reads."""
        if self.wants_texts:
            self.message(topic, t_ns, "foxglove.Log", level=self._LEVELS[level], message=text, name=name)

    def trip(self, relay: str, t_ns: int, sample_count: int, trip: Trip) -> None:
        """A relay's decision."""
        self.message(
            f"/relay/{relay}/trips",
            t_ns,
            "Trip",
            function=trip.function,
            zone=trip.zone,
            loop=trip.loop,
            poles=trip.poles,
            sample_count=sample_count,
        )

    def fault(self, t_ns: int, number: int, name: str, kind: str, on: bool) -> None:
        """A fault that the plant has applied or removed, for a program and for a person."""
        self.message("/plant/faults", t_ns, "FaultState", fault=number, on=on, type=kind)
        text = f"fault {name} {kind} {'applied' if on else 'gone'}"
        self.event(PLANT_EVENTS, t_ns, "info", text, "plant")

    def breaker(self, name: str, t_ns: int, closed: int, command: str = "", relay: str = "") -> None:
        """A breaker's closed poles, and the command it has taken, and whose, if that is what is told."""
        self.message(
            f"/breaker/{name}", t_ns, "BreakerStatus", command=command, relay=relay, **_POLES[closed & 7]
        )

    def can_frame(self, t_ns: int, frame: Frame, direction: str, sender: str) -> None:
        """A frame that was on the bus."""
        self.message(
            "/can",
            t_ns,
            "CanFrame",
            id=frame.id,
            data=frame.data,
            extended=frame.extended,
            fd=frame.fd,
            direction=direction,
            sender=sender,
        )

    def close(self) -> None:
        for sink in self.sinks:
            sink.close()

    def abort(self) -> None:
        for sink in self.sinks:
            sink.abort()


Metadata = dict[str, dict[str, str]]
Attachments = dict[str, str | bytes]


def check_log_path(path: Path) -> None:
    """InputError where a log must not or cannot go: another suffix might be an input, a device no file."""
    if path.suffix.lower() != ".mcap":
        raise InputError(f"a log's name must end in .mcap, as in {path.stem or 'run'}.mcap", file=path)
    check_target(path)


class Streams(NamedTuple):
    """What a run was asked to write to."""

    log: LogWriter | LogThread | None
    rerun: RerunSink | None

    @property
    def sinks(self) -> list[Sink]:
        return [stream for stream in self if stream is not None]


def open_streams(
    start_ns: int,
    log: Path | str | None,
    rerun: str | Callable[[], RerunSink] | None,
    name: str,
    metadata: Metadata,
    attachments: Attachments,
    compression: str = "",
    log_thread: bool = False,
) -> Streams:
    """The log and the rerun stream that are asked for; InputError where one cannot be opened.

    ``rerun``: its target, or what makes the stream.
    """
    stream = None
    if log is not None:
        check_log_path(Path(log))
    if rerun is not None:
        from faultloop.io.rerun_sink import RerunSink

        stream = rerun() if callable(rerun) else RerunSink(rerun, start_ns, name)
        for file, content in attachments.items():
            stream.add_attachment(file, content)
    if log is None:
        return Streams(None, stream)
    from faultloop.io.log_thread import LogThread
    from faultloop.io.mcap_writer import LogWriter

    try:
        Path(log).parent.mkdir(parents=True, exist_ok=True)
        writer = LogWriter(log, start_ns, metadata, attachments, compression)
        return Streams(LogThread(writer) if log_thread else writer, stream)
    except (OSError, InputError) as error:
        if stream is not None:
            stream.abort()
        if isinstance(error, InputError):
            raise
        raise InputError(f"cannot be written ({error.strerror or error})", file=log) from None


def describe(
    scenario: Scenario,
    settings: Mapping[str, RelaySettings],
    overrides: Sequence[str],
    without: Iterable[str] = (),
) -> tuple[Metadata, Attachments]:
    """Metadata records and attachments that let somebody repeat the run from its log."""
    header = scenario.scenario
    metadata = {
        "scenario": {
            "name": header.name,
            "duration_s": f"{header.duration_s:g}",
            "frequency_hz": str(scenario.system.frequency_hz),
            "sampling_hz": str(scenario.system.sampling_hz),
            "overrides": "\n".join(overrides),
            "without": "\n".join(without),
            "json": scenario.model_dump_json(by_alias=True),
        },
        "settings": {name: own.model_dump_json() for name, own in settings.items()},
        "seed": {"seed": str(header.seed)},
        "versions": versions(),
    }
    attachments: Attachments = {"scenario.toml": scenario.text} if scenario.text else {}
    attachments |= {f"{name}.settings.toml": own.text for name, own in settings.items() if own.text}
    attachments[DBC_PATH.name] = DBC_PATH.read_bytes()
    return metadata, attachments


def versions() -> dict[str, str]:
    """Of everything that a result may depend on."""
    return dict(_versions())


@cache  # looked up in the file system: 1 ms a package
def _versions() -> dict[str, str]:
    packages = ("faultloop", "numpy", "numba", "llvmlite", "mcap")
    found = {name: importlib.metadata.version(name) for name in packages}
    return found | {"python": platform.python_version(), "machine": platform.machine()}
