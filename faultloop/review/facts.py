"""What a review says of a log, as data; ``as_json`` makes of it what ``review --json`` prints.

Times ``*_ns`` count from the start of the run and are the log's own; ``*_ms`` count from the fault's
inception (from the start of the run where there is none).  A value that the log does not give is None.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields, is_dataclass
from typing import Any

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


@dataclass(frozen=True)
class LogFacts:
    """The file: ``start`` as ISO time, ``duration_s`` of what is in it, ``nominal_hz`` given or measured."""

    path: str
    size_bytes: int
    scenario: str | None
    start: str
    start_ns: int
    duration_s: float
    relays: list[str]
    breakers: list[str]
    topics: int
    attachments: list[str]
    versions: dict[str, str]
    recovered: bool
    nominal_hz: float


@dataclass(frozen=True)
class Inception:
    """Time zero; ``source``: plant, samples, pickup, or None where there is no fault."""

    t_ns: int | None
    source: str | None
    text: str

    @property
    def zero_ns(self) -> int:
        """What ``*_ms`` count from."""
        return self.t_ns or 0


@dataclass(frozen=True)
class FaultFacts:
    """One application of a fault; where it is and its resistances [ohm] as the scenario has them."""

    fault: int
    type: str
    on_ns: int
    on_ms: float
    off_ns: int | None
    off_ms: float | None
    name: str | None = _if_known()
    line: str | None = _if_known()
    bus: str | None = _if_known()
    at_pu: float | None = _if_known()
    at_km: float | None = _if_known()
    resistance_ohm: float | None = _if_known()
    ground_ohm: float | None = _if_known()

    @property
    def called(self) -> str:
        return self.name or str(self.fault)


@dataclass(frozen=True)
class TripFacts:
    """A trip on its way: decided, received by the breaker, poles open; and the fault that it answers."""

    fault: str | None
    fault_on_ms: float | None
    after_fault_ms: float | None
    function: str
    zone: int
    loop: str
    poles: str
    sample_count: int
    decided_ns: int
    decided_ms: float
    breaker: str | None
    received_ns: int | None
    received_ms: float | None
    received_by: str | None
    opened_ns: int | None
    opened_ms: float | None
    poles_opened_ns: dict[str, int]


@dataclass(frozen=True)
class ElementFacts:
    """A bit that ever was on; ``earlier_ms``: when it was on and over before the fault."""

    name: str
    first_ns: int
    first_ms: float
    last_off_ns: int | None
    last_off_ms: float | None
    times: int
    earlier_ms: list[float]


@dataclass(frozen=True)
class Phasor:
    """RMS [V, A], and the angle against VA before the fault."""

    magnitude: float
    angle_deg: float


@dataclass(frozen=True)
class PhasorFacts:
    """All phasors of one instant."""

    t_ns: int
    ms: float
    va: Phasor
    vb: Phasor
    vc: Phasor
    ia: Phasor
    ib: Phasor
    ic: Phasor

    def __getitem__(self, channel: str) -> Phasor:
        if channel not in CHANNELS:
            raise KeyError(channel)
        found: Phasor = getattr(self, channel)
        return found


@dataclass(frozen=True)
class Impedance:
    """[ohm, primary]"""

    r_ohm: float
    x_ohm: float
    magnitude_ohm: float
    angle_deg: float


@dataclass(frozen=True)
class FaultedLoop:
    """The faulted loop's impedance; ``percent_of_line`` by its reactance, as relays without more do it."""

    loop: str
    known_from: str
    r_ohm: float
    x_ohm: float
    magnitude_ohm: float
    angle_deg: float
    percent_of_line: float | None


@dataclass(frozen=True)
class Peak:
    """Greatest instantaneous value and when, and greatest RMS phasor [A]."""

    instantaneous: float
    t_ns: int
    ms: float
    rms: float | None


@dataclass(frozen=True)
class Frequency:
    """[Hz]"""

    prefault: float | None
    fault: float | None


@dataclass(frozen=True)
class RelayFacts:
    """What a relay saw and did; ``cleared_ns``: when its fault state ended."""

    line: str | None
    breaker: str | None
    samples: int
    sampling_hz: float | None
    first_ns: int | None
    last_ns: int | None
    trips: list[TripFacts]
    cleared_ns: int | None
    elements: list[ElementFacts]
    prefault: PhasorFacts | None
    fault: PhasorFacts | None
    loop: FaultedLoop | None
    load_ohm: Impedance | None
    peak_current: dict[str, Peak | None]
    frequency_hz: Frequency
    location: str | None


@dataclass(frozen=True)
class Operation:
    """A command to a breaker, or a change of its poles."""

    t_ns: int
    ms: float
    command: str | None
    opened: str
    closed: str
    poles_closed: str


@dataclass(frozen=True)
class BreakerFacts:
    initially_closed: str | None
    finally_closed: str | None
    operations: list[Operation]


@dataclass(frozen=True)
class BusFacts:
    """Frames on the bus, and how many of each kind."""

    frames: int
    kinds: dict[str, int]


@dataclass(frozen=True)
class Event:
    """What a node or a relay said, or what a replayed record's own digital channel did."""

    t_ns: int
    ms: float
    source: str
    level: str
    text: str


@dataclass(frozen=True)
class DigitalFacts:
    """A replayed record's digital channel that changed: when it was on; an end of None is the log's."""

    name: str
    on_ms: list[tuple[float, float | None]]


@dataclass(frozen=True)
class Network:
    """What is known of a run before its relays are looked at."""

    inception: Inception
    faults: list[FaultFacts]
    breakers: dict[str, BreakerFacts]
    events: list[Event]
    nominal_hz: float

    @property
    def cycle_ns(self) -> float:
        return 1e9 / self.nominal_hz


@dataclass(frozen=True)
class Summary:
    """Everything that ``faultloop review`` says."""

    log: LogFacts
    inception: Inception
    faults: list[FaultFacts]
    relays: dict[str, RelayFacts]
    breakers: dict[str, BreakerFacts]
    can: BusFacts
    events: list[Event]
    digital: list[DigitalFacts]
    warnings: list[str]
