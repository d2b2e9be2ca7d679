"""What a review says of a log, as data; ``as_json`` makes of it what ``review --json`` prints.

Times ``*_ns`` count from the start of the run and are the log's own; ``*_ms`` count from the fault's
inception (from the start of the run where there is none).  A value that the log does not give is None.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields, is_dataclass
from typing import Any, ClassVar

from faultloop.io.messages import CHANNELS


def _if_known() -> Any:
    """A field that ``as_json`` leaves out where it is None."""
    return field(default=None, metadata={"omit_none": True})


def as_json(value: Any) -> Any:
    """Dicts, lists, numbers, texts and None of a value that is made of dataclasses."""
    if is_dataclass(value):
        pairs = [(own, getattr(value, own.name)) for own in fields(value)]
        return {
            own.name: as_json(content)
            for own, content in pairs
            if not (content is None and own.metadata.get("omit_none"))
        }
    if isinstance(value, dict):
        return {key: as_json(content) for key, content in value.items()}
    return [as_json(content) for content in value] if isinstance(value, list | tuple) else value


class Told:
    """What is printed as JSON: its schema has what the fields say of themselves."""

    __pydantic_config__: ClassVar[dict[str, bool]] = {"use_attribute_docstrings": True}


@dataclass(frozen=True)
class LogFacts(Told):
    """The file: ``start`` as ISO time, ``duration_s`` of what is in it, ``nominal_hz`` given or measured."""

    path: str
    """The file."""
    size_bytes: int
    """Its size."""
    scenario: str | None
    """The scenario's name; None where the log has none."""
    record: str | None
    """The file of the record that was replayed; None where there is none."""
    start: str
    """When the run began, as ISO time."""
    start_ns: int
    """The same [ns since 1970]."""
    duration_s: float
    """From the start to the last that is in it."""
    relays: list[str]
    """Their names."""
    breakers: list[str]
    """Their names."""
    topics: int
    """How many it has."""
    attachments: list[str]
    """Names of the files in it."""
    versions: dict[str, str]
    """Of what wrote it, by package."""
    recovered: bool
    """Whether `faultloop recover` made it of a damaged one."""
    nominal_hz: float
    """Nominal frequency, as given or by what was measured."""


@dataclass(frozen=True)
class Inception(Told):
    """Time zero; ``source``: plant, samples, pickup, or None where there is no fault."""

    t_ns: int | None
    """Time zero [ns from the start]; None where there is no fault."""
    source: str | None
    """How it is known: plant, samples, pickup, or None."""
    text: str
    """The same in words."""

    @property
    def zero_ns(self) -> int:
        """What ``*_ms`` count from."""
        return self.t_ns or 0


@dataclass(frozen=True)
class FaultFacts(Told):
    """One application of a fault; where it is and its resistances [ohm] as the scenario has them."""

    fault: int
    """Its number in the log."""
    type: str
    """`AG`, `BCG`, `ABC` ..."""
    on_ns: int
    """When it was applied."""
    on_ms: float
    """The same from inception."""
    off_ns: int | None
    """When it went; None: it stays."""
    off_ms: float | None
    """The same from inception."""
    name: str | None = _if_known()
    """The scenario's name of it."""
    line: str | None = _if_known()
    """On which line."""
    bus: str | None = _if_known()
    """At which bus."""
    at_pu: float | None = _if_known()
    """Place, as a part of the line from its `from` end."""
    at_km: float | None = _if_known()
    """Place from the same end."""
    resistance_ohm: float | None = _if_known()
    """Of each phase."""
    ground_ohm: float | None = _if_known()
    """To ground."""

    @property
    def called(self) -> str:
        return self.name or str(self.fault)


@dataclass(frozen=True)
class TripFacts(Told):
    """A trip on its way: decided, received by the breaker, poles open; and the fault that it answers."""

    fault: str | None
    """The fault that it answers."""
    fault_on_ms: float | None
    """When that was applied."""
    after_fault_ms: float | None
    """From there to the breaker's reception."""
    function: str
    """What decided it, `PDIS1`."""
    zone: int
    """The zone, 0 where it has none."""
    loop: str
    """The loop, `AG`, `BC`; empty where it has none."""
    poles: str
    """The poles to open, `A`, `ABC`."""
    sample_count: int
    """The deciding sample's number."""
    decided_ns: int
    """The relay's decision."""
    decided_ms: float
    """The same from inception."""
    breaker: str | None
    """The breaker that it is for."""
    received_ns: int | None
    """When that had the frame; None: never."""
    received_ms: float | None
    """The same from inception."""
    received_by: str | None
    """Who heard it."""
    opened_ns: int | None
    """When the last commanded pole was open; None: never."""
    opened_ms: float | None
    """The same from inception."""
    poles_opened_ns: dict[str, int]
    """When each pole was open."""


@dataclass(frozen=True)
class ElementFacts(Told):
    """A bit that ever was on; ``earlier_ms``: when it was on and over before the fault."""

    name: str
    """As IEC 61850 names data: `PDIS1.Str`."""
    first_ns: int
    """When it first came on in the fault."""
    first_ms: float
    """The same from inception."""
    last_off_ns: int | None
    """When it last went; None: it stays."""
    last_off_ms: float | None
    """The same from inception."""
    times: int
    """How often it came on."""
    earlier_ms: list[float]
    """When it was on and over before the fault."""


@dataclass(frozen=True)
class Phasor(Told):
    """RMS [V, A], and the angle against VA before the fault."""

    magnitude: float
    """RMS [V, A]."""
    angle_deg: float
    """Against VA before the fault."""


@dataclass(frozen=True)
class PhasorFacts(Told):
    """All phasors of one instant."""

    t_ns: int
    """The instant."""
    ms: float
    """The same from inception."""
    va: Phasor
    """Voltage of phase A to ground."""
    vb: Phasor
    """Voltage of phase B to ground."""
    vc: Phasor
    """Voltage of phase C to ground."""
    ia: Phasor
    """Current of phase A, into the line."""
    ib: Phasor
    """Current of phase B."""
    ic: Phasor
    """Current of phase C."""

    def __getitem__(self, channel: str) -> Phasor:
        if channel not in CHANNELS:
            raise KeyError(channel)
        found: Phasor = getattr(self, channel)
        return found


@dataclass(frozen=True)
class Impedance(Told):
    """An impedance [ohm, primary]."""

    r_ohm: float
    """Resistance."""
    x_ohm: float
    """Reactance."""
    magnitude_ohm: float
    """Size."""
    angle_deg: float
    """Angle."""


@dataclass(frozen=True)
class FaultedLoop(Told):
    """The faulted loop's impedance; ``percent_of_line`` by its reactance, as relays without more do it."""

    loop: str
    """`AG`, `BC` ..."""
    known_from: str
    """What tells which loop that is."""
    r_ohm: float
    """Resistance."""
    x_ohm: float
    """Reactance."""
    magnitude_ohm: float
    """Size."""
    angle_deg: float
    """Angle."""
    percent_of_line: float | None
    """Its reactance as a part of the line's; None without a line."""


@dataclass(frozen=True)
class Peak(Told):
    """Greatest instantaneous value and when, and greatest RMS phasor [A]."""

    instantaneous: float
    """Greatest value of a sample."""
    t_ns: int
    """When."""
    ms: float
    """The same from inception."""
    rms: float | None
    """Greatest size of the phasor; None without estimates."""


@dataclass(frozen=True)
class Frequency(Told):
    """Frequency [Hz]."""

    prefault: float | None
    """Before the fault."""
    fault: float | None
    """In it."""


@dataclass(frozen=True)
class RelayFacts(Told):
    """What a relay saw and did; ``cleared_ns``: when its fault state ended."""

    line: str | None
    """The line that it protects."""
    breaker: str | None
    """The breaker that it trips."""
    samples: int
    """How many are in the log."""
    sampling_hz: float | None
    """Their rate."""
    first_ns: int | None
    """The first."""
    last_ns: int | None
    """The last."""
    trips: list[TripFacts]
    """In order of time."""
    cleared_ns: int | None
    """When its fault state ended: its own breaker's first pole opened, or the fault went."""
    elements: list[ElementFacts]
    """Bits that ever were on."""
    prefault: PhasorFacts | None
    """All phasors just before the fault."""
    fault: PhasorFacts | None
    """All phasors where the fault was steadiest."""
    loop: FaultedLoop | None
    """The impedance of the faulted loop then."""
    load_ohm: Impedance | None
    """Positive-sequence impedance before the fault."""
    peak_current: dict[str, Peak | None]
    """Of `ia`, `ib`, `ic`."""
    frequency_hz: Frequency
    """As the relay estimates it."""
    location: str | None
    """What RFLO said of the place."""


@dataclass(frozen=True)
class Operation(Told):
    """A command to a breaker, or a change of its poles."""

    t_ns: int
    """When."""
    ms: float
    """The same from inception."""
    command: str | None
    """`open` or `close`; None: its poles changed."""
    opened: str
    """Poles that opened."""
    closed: str
    """Poles that closed."""
    poles_closed: str
    """Poles that are closed now."""


@dataclass(frozen=True)
class BreakerFacts(Told):
    """A breaker's poles, as letters, and what it did."""

    initially_closed: str | None
    """Poles that were closed at first."""
    finally_closed: str | None
    """Poles that are closed at the end."""
    operations: list[Operation]
    """Commands and changes, in order of time."""


@dataclass(frozen=True)
class BusFacts(Told):
    """Frames on the bus, and how many of each kind."""

    frames: int
    """How many."""
    kinds: dict[str, int]
    """How many of each message."""


@dataclass(frozen=True)
class Event(Told):
    """What a node or a relay said, or what a replayed record's own digital channel did."""

    t_ns: int
    """When."""
    ms: float
    """The same from inception."""
    source: str
    """Who says it: a relay, a breaker, the plant, the record."""
    level: str
    """DEBUG, INFO, WARNING, ERROR or FATAL."""
    text: str
    """What."""


@dataclass(frozen=True)
class DigitalFacts(Told):
    """A replayed record's digital channel that changed: when it was on; an end of None is the log's."""

    name: str
    """As the record has it."""
    on_ms: list[tuple[float, float | None]]
    """When it was on: from and to; an end of None is the log's."""


@dataclass(frozen=True)
class Network(Told):
    """What is known of a run before its relays are looked at."""

    inception: Inception
    """Time zero."""
    faults: list[FaultFacts]
    """In order of time."""
    breakers: dict[str, BreakerFacts]
    """By name."""
    events: list[Event]
    """In order of time."""
    nominal_hz: float
    """Nominal frequency."""

    @property
    def cycle_ns(self) -> float:
        return 1e9 / self.nominal_hz


@dataclass(frozen=True)
class Summary(Told):
    """Everything that ``faultloop review`` says."""

    log: LogFacts
    """The file."""
    inception: Inception
    """Time zero."""
    faults: list[FaultFacts]
    """In order of time."""
    relays: dict[str, RelayFacts]
    """By name."""
    breakers: dict[str, BreakerFacts]
    """By name."""
    can: BusFacts
    """What was on the bus."""
    events: list[Event]
    """In order of time."""
    digital: list[DigitalFacts]
    """A replayed record's own channels that changed."""
    warnings: list[str]
    """What a reader should doubt."""
