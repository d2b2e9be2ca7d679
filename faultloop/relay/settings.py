"""What a relay settings file may say, and the same in primary values.

One rule for units: with ``ohms = "secondary"`` every ohm, ampere and volt in the file is secondary, with
``"primary"`` every one is primary.  The relay itself works in primary values only.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, ConfigDict, Field, PrivateAttr, model_validator

from faultloop.config.tables import (
    ComplexOhm,
    Milliseconds,
    Number,
    Positive,
    Table,
    read_toml,
    validate,
)
from faultloop.errors import InputError, nearest

MAX_ZONES = 16
MAX_ELEMENTS = 8


def _polar(value: Any) -> Any:
    """``{ magnitude = 0.73, angle_deg = -4 }`` as ``[re, im]``."""
    if isinstance(value, dict):
        keys = ("magnitude", "angle_deg")
        for key in value:
            if key not in keys:
                raise ValueError(f"unknown key '{key}'; {nearest(key, keys)}")
        if any(isinstance(value.get(k), bool) or not isinstance(value.get(k), (int, float)) for k in keys):
            raise ValueError("give [re, im] or { magnitude = ..., angle_deg = ... }")
        factor = cmath.rect(value["magnitude"], math.radians(value["angle_deg"]))
        return (factor.real, factor.imag)
    return value


ComplexFactor = Annotated[ComplexOhm, BeforeValidator(_polar)]
"""A complex number as TOML ``[re, im]`` or ``{ magnitude = ..., angle_deg = ... }``."""


class Header(Table):
    """``[relay]``"""

    frequency_hz: Literal[50, 60]
    sampling_hz: int = Field(default=4800, ge=400, le=100_000)
    ohms: Literal["primary", "secondary"] = "primary"
    ct_ratio: Positive | None = None
    """Primary over secondary, as a plain number: 1200 A / 5 A is 240."""
    vt_ratio: Positive | None = None
    nominal_kv: Positive | None = None
    """Line-to-line RMS, primary.  With it a dead line is one below 10 % of it, without it one below 1 V."""

    @model_validator(mode="after")
    def _ratios(self) -> Header:
        if self.ohms == "secondary" and (self.ct_ratio is None or self.vt_ratio is None):
            raise ValueError('ohms = "secondary" needs ct_ratio and vt_ratio, plain numbers such as 240')
        if self.sampling_hz < 8 * self.frequency_hz:
            raise ValueError(f"sampling_hz must be at least 8 samples a cycle, {8 * self.frequency_hz}")
        return self


class EstimatorSettings(Table):
    """``[estimator]``: the method, and whatever parameters that method has."""

    model_config = ConfigDict(extra="allow", frozen=True, strict=True, allow_inf_nan=False)

    method: str = "kalman-bank"

    @property
    def parameters(self) -> dict[str, Any]:
        """The method's own keys."""
        return dict(self.model_extra or {})


class LineSettings(Table):
    """``[line]``: the whole protected line."""

    z1_ohm: ComplexOhm
    z0_ohm: ComplexOhm
    length_km: Positive | None = None

    @model_validator(mode="after")
    def _inductive(self) -> LineSettings:
        for key, (r, x) in (("z1_ohm", self.z1_ohm), ("z0_ohm", self.z0_ohm)):
            if r < 0 or x <= 0:
                raise ValueError(f"{key} must be [r, x] with r >= 0 and x > 0, not [{r:g}, {x:g}]")
        return self


class Pdis(Table):
    """``[[pdis]]``: one distance zone."""

    zone: int = Field(ge=1, le=99)
    direction: Literal["forward", "reverse", "none"] = "forward"
    characteristic: Literal["mho", "quad"] = "mho"
    polarization: Literal["self", "cross", "memory"] | None = None
    """Of a mho; "memory" where not given."""
    loops: Literal["all", "ground", "phase"] = "all"
    reach_pu: Positive | None = None
    """Of the line's positive-sequence impedance."""
    reach_ohm: Positive | None = None
    angle_deg: Annotated[float, Field(gt=0, le=90)] | None = None
    """Of the reach; the line's angle where not given."""
    resistive_reach_ohm: Positive | None = None
    """Of a quad: fault resistance of each phase (half the arc between two phases)."""
    resistive_reach_ground_ohm: Positive | None = None
    """Of a quad: fault resistance to ground; ``resistive_reach_ohm`` where not given."""
    tilt_deg: Annotated[float, Field(ge=-20, le=20)] = 3.0
    """Of a quad: how far the reactance line falls towards the resistive side."""
    residual_compensation_factor: ComplexFactor | None = None
    """k0; (z0 - z1) / (3 z1) of the line where not given."""
    delay_ms: Milliseconds = 0.0
    delay_phase_ms: Milliseconds | None = None
    delay_ground_ms: Milliseconds | None = None
    minimum_current_a: Positive | None = None
    """Of the loop current (phase-phase, or compensated); 20 A primary where not given."""
    minimum_residual_current_a: Positive | None = None
    """Of 3I0, ground loops only; 20 A primary where not given."""
    security_cycles: Annotated[float, Field(ge=0, le=5)] = 1.0
    """How long a fault close to the reach must stay inside before the zone starts; deep inside, a tenth."""

    @model_validator(mode="after")
    def _whole(self) -> Pdis:
        if (self.reach_pu is None) == (self.reach_ohm is None):
            raise ValueError("give either reach_pu (of the line) or reach_ohm")
        if self.characteristic == "quad":
            if self.resistive_reach_ohm is None:
                raise ValueError('characteristic = "quad" needs resistive_reach_ohm')
            if self.polarization is not None:
                raise ValueError('polarization belongs to characteristic = "mho"')
        elif self.resistive_reach_ohm is not None or self.resistive_reach_ground_ohm is not None:
            raise ValueError('resistive_reach_ohm belongs to characteristic = "quad"')
        return self


class Rdir(Table):
    """``[rdir]``: the directional element and the memory that it, the zones and the phase selection share."""

    memory_ms: Milliseconds = 200.0
    """How long the pre-fault voltage polarizes; it then fades into the present one within 100 ms."""
    minimum_angle_deg: Annotated[float, Field(ge=0, le=45)] = 15.0
    """Forward reaches this far below the resistive axis ..."""
    maximum_angle_deg: Annotated[float, Field(ge=90, le=165)] = 115.0
    """... and up to here, in the positive-sequence element."""
    z2_forward_pu: Annotated[float, Field(ge=-1, le=1)] = 0.5
    """Forward where the negative-sequence impedance is below this part of the line's."""
    z2_reverse_pu: Annotated[float, Field(ge=-1, le=2)] = 0.6
    """Reverse where it is above this one."""
    minimum_unbalance: Annotated[float, Field(gt=0, lt=1)] = 0.1
    """Of I2 (or I0) over I1: below it the positive-sequence element decides."""

    @model_validator(mode="after")
    def _order(self) -> Rdir:
        if self.z2_reverse_pu <= self.z2_forward_pu:
            raise ValueError("z2_reverse_pu must be above z2_forward_pu")
        return self


class Phs(Table):
    """``[phs]``: fault detection and phase selection on superimposed quantities."""

    pickup_current_a: Positive | None = None
    """A change of a phase current that is a disturbance; 10 A primary where not given."""
    pickup_current_pu: Annotated[float, Field(gt=0, lt=1)] = 0.1
    """The same, of the positive-sequence load current; the greater one holds."""
    pickup_voltage_pu: Annotated[float, Field(gt=0, lt=1)] = 0.08
    """A change of a phase voltage that is a disturbance, of the voltage before."""
    single_phase_ratio: Annotated[float, Field(gt=0, lt=0.5)] = 0.3
    """One-phase where the healthy pair's change is below this part of the greatest."""
    three_phase_unbalance: Annotated[float, Field(gt=0, lt=0.5)] = 0.2
    """Three-phase where the changes of negative and zero sequence are below this part of the positive."""


class Ptrc(Table):
    """``[ptrc]``: trip logic."""

    mode: Literal["three-pole", "single-pole"] = "three-pole"
    zones: tuple[int, ...] | None = Field(default=None, strict=False)
    """The zones that trip; all where not given."""
    minimum_trip_ms: Milliseconds = 80.0
    """A trip lasts at least this long, and until the poles' current is gone or the breaker says open."""
    open_current_a: Positive | None = None
    """A pole below it is open; 20 A primary where not given."""
    pilot_zone: int | None = Field(default=None, ge=1)
    """The zone whose start is sent to the far end."""


class Rflo(Table):
    """``[rflo]``: fault location."""

    method: Literal["takagi", "reactance"] = "takagi"


class ElementSettings(Table):
    """``[[element]]``: a user's own element."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]*$", max_length=32)]
    function: Annotated[str, Field(pattern=r"^.+:[A-Za-z_][A-Za-z0-9_]*$")]
    """``package.module:function``, or ``file.py:function`` relative to the settings file."""
    state: tuple[Number, ...] = Field(default=(), strict=False, max_length=4096)
    """What its state array starts with."""
    trip: bool = False
    """Whether its operate trips."""


class RelaySettings(Table):
    """A relay's settings.  Build them from a file (`load_settings`) or a dict (`RelaySettings.from_dict`)."""

    relay: Header
    estimator: EstimatorSettings = EstimatorSettings()
    line: LineSettings
    pdis: tuple[Pdis, ...] = Field(default=(), strict=False, max_length=MAX_ZONES)
    rdir: Rdir = Rdir()
    phs: Phs = Phs()
    ptrc: Ptrc = Ptrc()
    rflo: Rflo = Rflo()
    element: tuple[ElementSettings, ...] = Field(default=(), strict=False, max_length=MAX_ELEMENTS)

    _path: Path | None = PrivateAttr(default=None)
    _text: str = PrivateAttr(default="")

    @property
    def path(self) -> Path | None:
        """The file they came from."""
        return self._path

    @property
    def text(self) -> str:
        """The file's text, for the log."""
        return self._text

    @classmethod
    def from_dict(cls, data: Mapping[str, Any], *, path: Path | None = None, text: str = "") -> RelaySettings:
        """Validated; raises InputError."""
        result = validate(cls, data, path)
        result._path, result._text = path, text
        _check_zones(result, path)
        return result

    @property
    def ct_ratio(self) -> float:
        """From the file's amperes to primary ones."""
        return 1.0 if self.relay.ohms == "primary" else float(self.relay.ct_ratio or 1.0)

    @property
    def ohm_ratio(self) -> float:
        """From the file's ohms to primary ones."""
        return 1.0 if self.relay.ohms == "primary" else float(self.relay.vt_ratio or 1.0) / self.ct_ratio

    @property
    def z1_ohm(self) -> complex:
        """Positive-sequence impedance of the whole line, primary [ohm]."""
        return complex(*self.line.z1_ohm) * self.ohm_ratio

    @property
    def z0_ohm(self) -> complex:
        """Zero-sequence impedance of the whole line, primary [ohm]."""
        return complex(*self.line.z0_ohm) * self.ohm_ratio

    @property
    def residual_compensation_factor(self) -> complex:
        """k0 = (z0 - z1) / (3 z1) of the line."""
        return (self.z0_ohm - self.z1_ohm) / (3 * self.z1_ohm)

    def reach_ohm(self, zone: Pdis) -> complex:
        """A zone's reach, primary [ohm], with its angle; the direction is not in it."""
        if zone.reach_pu is not None:
            size = zone.reach_pu * abs(self.z1_ohm)
        else:
            size = float(zone.reach_ohm or 0.0) * self.ohm_ratio
        angle = cmath.phase(self.z1_ohm) if zone.angle_deg is None else math.radians(zone.angle_deg)
        return cmath.rect(size, angle)

    def amperes(self, value: float | None, default: float) -> float:
        """A current setting in primary amperes; ``default`` (primary) where it was not given."""
        return default if value is None else value * self.ct_ratio


def load_settings(path: Path | str) -> RelaySettings:
    """Read and validate a relay settings file (TOML).  Raises InputError."""
    path = Path(path)
    data, text = read_toml(path)
    return RelaySettings.from_dict(data, path=path, text=text)


def _check_zones(settings: RelaySettings, path: Path | None) -> None:
    """What only the whole file can judge."""
    zones = [zone.zone for zone in settings.pdis]
    for key, wanted in (("zones", settings.ptrc.zones or ()), ("pilot_zone", (settings.ptrc.pilot_zone,))):
        for zone in wanted:
            if zone is not None and zone not in zones:
                listed = ", ".join(map(str, dict.fromkeys(zones))) or "none"
                raise InputError(f"there is no zone {zone}; zones: {listed}", file=path, key=f"ptrc.{key}")
    names: set[str] = set()
    for element in settings.element:
        if element.name in names or element.name.startswith(("PDIS", "RDIR", "PHS", "PTRC")):
            raise InputError(
                f"the name '{element.name}' is taken; each element needs its own",
                file=path,
                key=f"element[{element.name}].name",
            )
        names.add(element.name)
