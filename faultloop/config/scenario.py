"""What a scenario file may say."""

from __future__ import annotations

import copy
import tomllib
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, PrivateAttr, model_validator

from faultloop.config.bus_fault import BusFault
from faultloop.config.bus_fault import check_references as check_bus_faults
from faultloop.config.tables import (
    ComplexOhm,
    Milliseconds,
    Name,
    NonNegative,
    Number,
    Positive,
    Seconds,
    Table,
    read_toml,
    validate,
)
from faultloop.errors import InputError, nearest

FAULT_TYPES = ("AG", "BG", "CG", "AB", "BC", "CA", "ABG", "BCG", "CAG", "ABC", "ABCG")
LOOPS = ("AG", "BG", "CG", "AB", "BC", "CA", "ABC")

FaultType = Literal["AG", "BG", "CG", "AB", "BC", "CA", "ABG", "BCG", "CAG", "ABC", "ABCG"]
End = Literal["from", "to"]
PerKm = Annotated[float, Field(ge=0, le=1e4)]


def _iso_time(value: Any) -> Any:
    """A date and time, not the number that pydantic would take for one; within what a log can hold."""
    if not isinstance(value, (datetime, str)):
        raise ValueError(f"must be a date and time, as in 2020-01-01T00:00:00Z, not {value!r}")
    time = datetime.fromisoformat(value) if isinstance(value, str) else value
    if not 1970 <= time.year < 2200:
        raise ValueError(f"must be from 1970 to 2199, not in the year {time.year}")
    return time


class Header(Table):
    """``[scenario]``"""

    name: str = Field(min_length=1)
    duration_s: Annotated[float, Field(gt=0, le=1e6)]
    seed: int = Field(default=1, ge=0, lt=2**63)
    start: Annotated[datetime, BeforeValidator(_iso_time)] = Field(
        default=datetime(2020, 1, 1, tzinfo=UTC), strict=False
    )
    """The simulated time's epoch, in the log and on the bus; without an offset it is UTC."""

    @property
    def start_ns(self) -> int:
        """Nanoseconds since 1970."""
        start = self.start if self.start.tzinfo else self.start.replace(tzinfo=UTC)
        delta = start - datetime(1970, 1, 1, tzinfo=UTC)
        return (delta.days * 86400 + delta.seconds) * 1_000_000_000 + delta.microseconds * 1000


class System(Table):
    """``[system]``"""

    frequency_hz: Literal[50, 60]
    base_kv: Annotated[float, Field(gt=0, le=2000)]
    """Line-to-line RMS."""
    sampling_hz: int = Field(default=4800, ge=400, le=100_000)
    steps_per_sample: int = Field(default=4, ge=1, le=256)
    """Plant steps in one sampling interval."""


class Source(Table):
    """``[[source]]``: a Thevenin source with coupled impedance, or one given by its SIR."""

    name: Name
    bus: Name
    voltage_pu: Positive = 1.0
    angle_deg: Number = 0.0
    z1_ohm: ComplexOhm | None = None
    z0_ohm: ComplexOhm | None = None
    sir: Positive | None = None
    """|Zs1| / |Zl1|, at the line's angle, of the first line listed at the bus."""
    z0_over_z1: Positive = 1.0
    frequency_hz: Annotated[float, Field(ge=10, le=10_000)] | None = None
    """The source's own frequency; the system's where not given."""

    @model_validator(mode="after")
    def _one_impedance(self) -> Source:
        if (self.sir is None) == (self.z1_ohm is None):
            raise ValueError("give either z1_ohm = [r, x] (with z0_ohm) or sir = N (with z0_over_z1)")
        if (self.z1_ohm is None) != (self.z0_ohm is None):
            raise ValueError("z1_ohm and z0_ohm belong together")
        for key, z in (("z1_ohm", self.z1_ohm), ("z0_ohm", self.z0_ohm)):
            if z is not None and (z[0] < 0 or z[1] < 0 or z[0] + z[1] == 0):
                raise ValueError(f"{key} must be [r, x] with r >= 0, x >= 0 and not both zero, not {list(z)}")
        return self


class Line(Table):
    """``[[line]]``: a transposed line by sequence parameters; ``from`` and ``to`` are buses."""

    name: Name
    from_bus: Name = Field(alias="from")
    to_bus: Name = Field(alias="to")
    length_km: Annotated[float, Field(gt=0, le=5000)]
    model: Literal["bergeron", "pi", "rl"] = "bergeron"
    r1_ohm_per_km: PerKm
    x1_ohm_per_km: Annotated[float, Field(gt=0, le=1e4)]
    b1_us_per_km: PerKm = 0.0
    r0_ohm_per_km: PerKm
    x0_ohm_per_km: Annotated[float, Field(gt=0, le=1e4)]
    b0_us_per_km: PerKm = 0.0
    sections: int | None = Field(default=None, ge=1, le=500)
    """``pi`` only: cascaded sections over the whole line; chosen by length where not given."""

    @model_validator(mode="after")
    def _possible(self) -> Line:
        if self.from_bus == self.to_bus:
            raise ValueError(f"'from' and 'to' are the same bus '{self.from_bus}'")
        if self.model == "bergeron" and not (self.b1_us_per_km > 0 and self.b0_us_per_km > 0):
            raise ValueError('model = "bergeron" needs b1_us_per_km > 0 and b0_us_per_km > 0')
        if self.model == "rl" and (self.b1_us_per_km or self.b0_us_per_km):
            raise ValueError('model = "rl" has no capacitance: leave b1_us_per_km and b0_us_per_km out')
        if self.sections is not None and self.model != "pi":
            raise ValueError('sections belongs to model = "pi"')
        return self

    @property
    def z1_ohm(self) -> complex:
        """Positive-sequence series impedance of the whole line at system frequency [ohm]."""
        return complex(self.r1_ohm_per_km, self.x1_ohm_per_km) * self.length_km

    @property
    def z0_ohm(self) -> complex:
        """Zero-sequence series impedance of the whole line at system frequency [ohm]."""
        return complex(self.r0_ohm_per_km, self.x0_ohm_per_km) * self.length_km


class Fault(Table):
    """``[[fault]]``: on a line, ``at_km`` or ``at_pu`` from its ``from`` end, or at a bus."""

    name: Name = ""
    line: Name | None = None
    at_km: NonNegative | None = None
    at_pu: Annotated[float, Field(ge=0, le=1)] | None = None
    bus: Name | None = None
    type: FaultType
    start_s: Seconds | None = None
    angle_deg: Number | None = None
    """Point on wave: the angle of the first faulted phase's voltage (of A to B for AB, and so on, where no
    ground is involved), 0 at its rising zero."""
    after_s: Seconds = 0.0
    """With ``angle_deg``: not before this time."""
    resistance_ohm: Annotated[float, Field(ge=0, le=1e9)] = 0.0
    """From each faulted phase to their common point."""
    ground_ohm: Annotated[float, Field(ge=0, le=1e9)] = 0.0
    """From the common point to ground."""
    duration_s: Annotated[float, Field(gt=0, le=1e6)] | None = None
    """Removed after this time, each phase at its current zero; permanent where not given."""

    @model_validator(mode="after")
    def _placed_and_timed(self) -> Fault:
        if (self.line is None) == (self.bus is None):
            raise ValueError("give either line (with at_km or at_pu) or bus")
        if self.line is not None and (self.at_km is None) == (self.at_pu is None):
            raise ValueError("a fault on a line needs either at_km or at_pu")
        if self.bus is not None and not (self.at_km is None and self.at_pu is None):
            raise ValueError("at_km and at_pu belong to a fault on a line")
        if (self.start_s is None) == (self.angle_deg is None):
            raise ValueError("give either start_s or angle_deg (with after_s)")
        if self.ground_ohm and not self.type.endswith("G"):
            raise ValueError(f"ground_ohm belongs to a fault to ground, not to {self.type}")
        return self


class Breaker(Table):
    """``[[breaker]]`` between a bus and a line end; times from the command to the contacts."""

    name: Name
    line: Name
    end: End
    operate_ms: Milliseconds = 40.0
    close_ms: Milliseconds = 80.0


class FrontEnd(Table):
    """``[front_end]``: what stands between the primary values and the relay's samples; all off is ideal."""

    antialias_hz: NonNegative = 0.0
    """-3 dB frequency of the Butterworth low-pass before sampling; 0 leaves it out."""
    antialias_order: Literal[2, 4] = 2
    voltage_noise_v: NonNegative = 0.0
    """RMS of the white noise on each voltage sample, primary volts."""
    current_noise_a: NonNegative = 0.0
    adc_bits: int = Field(default=0, ge=0, le=32)
    """Of the converter, sign included; 0 leaves quantization and clipping out."""
    voltage_full_scale_v: Positive | None = None
    """Peak, primary; 2 times the rated phase voltage's peak where not given."""
    current_full_scale_a: Positive | None = None
    """Peak, primary; needed with adc_bits."""

    @model_validator(mode="after")
    def _full_scale(self) -> FrontEnd:
        if self.adc_bits == 1:
            raise ValueError("adc_bits must be 0 (off) or from 2 to 32, not 1")
        if self.adc_bits and self.current_full_scale_a is None:
            raise ValueError("adc_bits needs current_full_scale_a (peak primary amperes)")
        return self


class RelayPlace(Table):
    """``[[relay]]``: where a relay measures, which breaker it trips, and its settings file."""

    name: Name
    line: Name
    end: End
    breaker: Name | None = None
    settings: str = Field(min_length=1)
    """Path of the settings, relative to the scenario file."""
    voltage_at: Literal["bus", "line"] = "bus"
    """Which side of the breaker the voltage transformer is on."""
    front_end: FrontEnd | None = None
    """This relay's own, in place of the scenario's."""


class Can(Table):
    """``[can]``"""

    interface: str = "virtual"
    channel: str = "faultloop"
    bitrate: int = Field(default=500_000, ge=10_000, le=1_000_000)
    fd: bool = False
    """CAN FD, with its data phase at data_bitrate."""
    data_bitrate: int = Field(default=2_000_000, ge=10_000, le=8_000_000)
    measurements_hz: Annotated[float, Field(ge=0, le=1000)] = 10.0
    """How often each relay publishes its measurements; 0 leaves them out."""
    heartbeat_s: Annotated[float, Field(ge=0.01, le=3600)] = 1.0
    """Interval of the heartbeat and the longest of the repetition of trip, close and pilot frames."""
    keys: Annotated[str, Field(min_length=1)] | None = None
    """Key file, relative to the scenario: with it trip, close, pilot and status frames are authenticated."""
    confirmations: int = Field(default=1, ge=1, le=4)
    """Frames in a row that must agree before a new state is acted upon; 2 costs 2 ms."""

    @model_validator(mode="after")
    def _room_for_the_tag(self) -> Can:
        if self.keys is not None and not self.fd:
            raise ValueError("keys needs fd = true: an authenticated frame has 32 bytes")
        return self


class Expect(Table):
    """``[[expect]]``: what a relay shall do.  Times count from the first fault's start."""

    relay: Name
    trip: bool
    function: str | None = None
    zone: int | None = Field(default=None, ge=1)
    loop: Literal["AG", "BG", "CG", "AB", "BC", "CA", "ABC"] | None = None
    poles: Literal["A", "B", "C", "ABC"] | None = None
    within_ms: Positive | None = None
    """Received by the breaker at most this long after the fault's start."""
    after_ms: NonNegative | None = None
    """Not before this long after the fault's start."""

    @model_validator(mode="after")
    def _details_of_a_trip(self) -> Expect:
        details = ("function", "zone", "loop", "poles", "within_ms", "after_ms")
        given = [k for k in details if getattr(self, k) is not None]
        if not self.trip and given:
            raise ValueError(f"{given[0]} describes a trip and cannot stand with trip = false")
        return self


class Scenario(Table):
    """A whole scenario.  Build it from a file (`load_scenario`) or from a dict (`Scenario.from_dict`)."""

    scenario: Header
    system: System
    source: tuple[Source, ...] = Field(min_length=1, strict=False)
    line: tuple[Line, ...] = Field(min_length=1, strict=False)
    fault: tuple[Fault, ...] = Field(default=(), strict=False)
    breaker: tuple[Breaker, ...] = Field(default=(), strict=False, max_length=16)
    relay: tuple[RelayPlace, ...] = Field(default=(), strict=False, max_length=16)
    can: Can = Can()
    front_end: FrontEnd = FrontEnd()
    bus_fault: tuple[BusFault, ...] = Field(default=(), strict=False)
    expect: tuple[Expect, ...] = Field(default=(), strict=False)

    _path: Path | None = PrivateAttr(default=None)
    _text: str = PrivateAttr(default="")

    @property
    def path(self) -> Path | None:
        """The file it came from."""
        return self._path

    @property
    def text(self) -> str:
        """The file's text, for the log."""
        return self._text

    @classmethod
    def from_dict(cls, data: Mapping[str, Any], *, path: Path | None = None, text: str = "") -> Scenario:
        """Validated; raises InputError.  ``path`` is what settings files are relative to."""
        data = _named_faults(data)
        result = validate(cls, data, path)
        result._path, result._text = path, text
        try:
            _check_references(result)
        except InputError as error:
            raise error.within(path) from None
        return result

    def settings_path(self, relay: RelayPlace) -> Path:
        """The relay's settings file."""
        base = self._path.parent if self._path else Path()
        return base / relay.settings

    @property
    def keys_path(self) -> Path | None:
        """The key file, where there is one."""
        if self.can.keys is None:
            return None
        return (self._path.parent if self._path else Path()) / self.can.keys


def load_scenario(path: Path | str, overrides: Sequence[str] = ()) -> Scenario:
    """Read, override (``fault.F1.resistance_ohm=5``) and validate a scenario file; raises InputError."""
    path = Path(path)
    data, text = read_toml(path)
    data = _named_faults(data)
    for override in overrides:
        apply_override(data, override)
    return Scenario.from_dict(data, path=path, text=text)


def apply_override(data: dict[str, Any], override: str) -> None:
    """``table.key=value`` or ``array.name-or-number.key=value`` into parsed TOML, in place."""
    key, equals, text = override.partition("=")
    parts = [p.strip() for p in key.split(".")]
    if not equals or len(parts) < 2 or not all(parts):
        raise InputError(
            f"'{override}' is not KEY=VALUE; KEY is table.key or array.name.key, as in fault.0.at_pu=0.5",
            key="--set",
        )
    value = _value(text.strip())
    here: Any = data
    for depth, part in enumerate(parts[:-1]):
        if isinstance(here, list):
            here = _member(here, part, ".".join(parts[:depth]), override)
        elif isinstance(here, dict):
            here = here.setdefault(part, {})
        else:
            raise InputError(f"'{override}': {'.'.join(parts[:depth])} is not a table", key="--set")
    if isinstance(here, list):
        raise InputError(f"'{override}': name one of {key.rpartition('.')[0]}, then its key", key="--set")
    if not isinstance(here, dict):
        raise InputError(f"'{override}': {key.rpartition('.')[0]} is not a table", key="--set")
    here[parts[-1]] = value


def _value(text: str) -> Any:
    """A TOML value; a bare word is a string (``fault.0.type=BC``), and .5 is a number."""
    try:
        return tomllib.loads(f"x = {text}")["x"]
    except tomllib.TOMLDecodeError:
        pass
    try:
        return float(text)
    except ValueError:
        return text


def _member(items: list[Any], part: str, where: str, override: str) -> Any:
    names = [item.get("name", "") if isinstance(item, dict) else "" for item in items]
    if part in names:
        return items[names.index(part)]
    if part.isdigit() and int(part) < len(items):
        return items[int(part)]
    raise InputError(
        f"'{override}': no {where} '{part}'; {nearest(part, [n or str(i) for i, n in enumerate(names)])}",
        key="--set",
    )


def _named_faults(data: Mapping[str, Any]) -> dict[str, Any]:
    """Faults without a name are F1, F2, ... by place, those of the bus B1, B2, ..."""
    data = copy.deepcopy(dict(data))
    for kind, letter in (("fault", "F"), ("bus_fault", "B")):
        faults = data.get(kind)
        if isinstance(faults, list):
            for number, fault in enumerate(faults, 1):
                if isinstance(fault, dict):
                    fault.setdefault("name", f"{letter}{number}")
    return data


def _check_references(s: Scenario) -> None:
    """Names that point somewhere, and values that only the whole can judge."""
    for kind in ("source", "line", "fault", "breaker", "relay", "bus_fault"):
        seen: set[str] = set()
        for item in getattr(s, kind):
            if item.name in seen:
                raise InputError(f"two of them are called '{item.name}'", key=f"{kind}[{item.name}].name")
            seen.add(item.name)

    lines = {line.name: line for line in s.line}
    breakers = {b.name: b for b in s.breaker}
    relays = {r.name: r for r in s.relay}
    buses = dict.fromkeys([b for line in s.line for b in (line.from_bus, line.to_bus)])

    def known(name: str, names: Mapping[str, Any], kind: str, key: str) -> None:
        if name not in names:
            raise InputError(f"there is no {kind} '{name}'; {nearest(name, names)}", key=key)

    for source in s.source:
        known(source.bus, buses, "line at bus", f"source[{source.name}].bus")
    for fault in s.fault:
        key = f"fault[{fault.name}]"
        if fault.line is not None:
            known(fault.line, lines, "line", f"{key}.line")
            length = lines[fault.line].length_km
            if fault.at_km is not None and fault.at_km > length:
                raise InputError(
                    f"{fault.at_km:g} is beyond line '{fault.line}' of {length:g} km", key=f"{key}.at_km"
                )
        if fault.bus is not None:
            known(fault.bus, buses, "bus", f"{key}.bus")
        at, start = ("after_s", fault.after_s) if fault.start_s is None else ("start_s", fault.start_s)
        if start >= s.scenario.duration_s:
            end = s.scenario.duration_s
            raise InputError(
                f"{start:g} is not before the end of the run (duration_s = {end:g})", key=f"{key}.{at}"
            )
    ends: dict[tuple[str, str], str] = {}
    for breaker in s.breaker:
        known(breaker.line, lines, "line", f"breaker[{breaker.name}].line")
        place = (breaker.line, breaker.end)
        if place in ends:
            raise InputError(
                f"breaker '{ends[place]}' is already at the '{breaker.end}' end of line '{breaker.line}'",
                key=f"breaker[{breaker.name}].end",
            )
        ends[place] = breaker.name
    for relay in s.relay:
        known(relay.line, lines, "line", f"relay[{relay.name}].line")
        if relay.breaker is not None:
            known(relay.breaker, breakers, "breaker", f"relay[{relay.name}].breaker")
    check_bus_faults(s.bus_fault, relays, breakers, s.scenario.duration_s)
    for number, expect in enumerate(s.expect):
        known(expect.relay, relays, "relay", f"expect[{number}].relay")
        if expect.trip and expect.within_ms is not None and not s.fault:
            raise InputError(
                "within_ms counts from a fault, and there is none", key=f"expect[{number}].within_ms"
            )
