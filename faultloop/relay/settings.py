"""What a relay settings file may say, and the same in primary values.

One rule for units: with ``ohms = "secondary"`` every ohm, ampere and volt in the file is secondary, with
``"primary"`` every one is primary.  The relay itself works in primary values only.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, Field, PrivateAttr, create_model, model_validator

from faultloop.config.cvt_circuit import Circuit, Fraction, chosen_circuit, what_mistunes
from faultloop.config.override import set_key, split_override
from faultloop.config.tables import ComplexOhm, NonNegative, Positive, Table, parse_toml, read_text, validate
from faultloop.errors import InputError
from faultloop.relay import coordination
from faultloop.relay.coordination import Doubt, Zone
from faultloop.relay.cvt import inverse
from faultloop.relay.estimators.protection import refusal
from faultloop.relay.functions import FUNCTIONS
from faultloop.relay.functions.function import Function


class Header(Table):
    """``[relay]``: how the relay samples, and in which values its settings are."""

    frequency_hz: Literal[50, 60]
    """Nominal."""
    sampling_hz: int = Field(default=4800, ge=400, le=100_000)
    """Samples per second; at least 8 a cycle."""
    ohms: Literal["primary", "secondary"] = "primary"
    """What every ohm, ampere and volt in the file is."""
    ct_ratio: Positive | None = None
    """Primary over secondary, as a plain number: 1200 A / 5 A is 240."""
    vt_ratio: Positive | None = None
    """The same of the voltage transformer; secondary values need both."""
    nominal_kv: Positive | None = None
    """Line-to-line RMS, primary.  With it a dead line is one below 10 % of it, without it one below 1 V."""

    @model_validator(mode="after")
    def _ratios(self) -> Header:
        if self.ohms == "secondary" and (self.ct_ratio is None or self.vt_ratio is None):
            raise ValueError('ohms = "secondary" needs ct_ratio and vt_ratio, plain numbers such as 240')
        if self.sampling_hz < 8 * self.frequency_hz:
            raise ValueError(f"sampling_hz must be at least 8 samples a cycle, {8 * self.frequency_hz}")
        return self


LONGEST_LINE = 1.0
"""|z1| b1 of a line, (beta l)^2: 930 km at 50 Hz, 780 at 60."""


class EstimatorSettings(Table):
    """``[estimator]``: the method, and whatever parameters that method has."""

    model_config = ConfigDict(extra="allow", frozen=True, strict=True, allow_inf_nan=False)

    method: str = "kalman-bank"
    """A name of docs/estimators.md, `file.py:make` of your own, or an entry point's name."""
    unsafe: bool = False
    """Takes a method by which distance protection does not decide (docs/relay.md)."""

    @property
    def parameters(self) -> dict[str, Any]:
        """The method's own keys."""
        return dict(self.model_extra or {})


class VtSettings(Table):
    """``[vt]``: what is known of the voltage transformer."""

    kind: Literal["ideal", "cvt"] | None = None
    """"ideal": an inductive one, or a sensor, without a transient of its own.  "cvt": a capacitive one of a
    known circuit, whose voltage is restored by its inverse.  Left out it may be any capacitive one: behind a
    weak source zones without delay then wait for a window of a cycle and more."""
    circuit: Circuit | None = None
    """Of a "cvt": "P1", "P2", "A1", "A2", or a table { ce_nf, rf_ohm, ... } as in a scenario's [[vt]]."""
    burden_va: NonNegative | None = None
    """In place of the circuit's."""

    @model_validator(mode="after")
    def _circuit_of_a_cvt(self) -> VtSettings:
        if self.kind == "cvt" and self.circuit is None:
            raise ValueError('kind = "cvt" needs circuit = "P1" | "P2" | "A1" | "A2" or a table of its own')
        if self.kind != "cvt" and not (self.circuit is None and self.burden_va is None):
            raise ValueError('circuit and burden_va belong to kind = "cvt"')
        return self


class LineSettings(Table):
    """``[line]``: the whole protected line."""

    z1_ohm: ComplexOhm
    """Positive-sequence impedance, [r, x]."""
    z0_ohm: ComplexOhm
    """Zero-sequence impedance, [r, x]."""
    z0m_ohm: ComplexOhm | None = None
    """Zero-sequence mutual impedance with the parallel line over the whole length, [r, x].  With it, and with
    the parallel line's residual current (``parallel`` of the relay's place), ground loops are compensated."""
    b1_us: Positive | None = None
    """Positive-sequence susceptance of the whole line, primary whatever ``ohms`` says.  With it forward zones
    that end on the line start only where the line's equations with its charging say so, too, and the fit in
    time finds the fault though the line rings: for lines of 100 km and more."""
    b0_us: Positive | None = None
    """The same of the zero sequence; both or neither."""
    length_km: Positive | None = None
    """With it a fault's location is told in km, too."""

    @model_validator(mode="after")
    def _inductive(self) -> LineSettings:
        for key, (r, x) in (("z1_ohm", self.z1_ohm), ("z0_ohm", self.z0_ohm)):
            if r < 0 or x <= 0:
                raise ValueError(f"{key} must be [r, x] with r >= 0 and x > 0, not [{r:g}, {x:g}]")
        if self.z0m_ohm is not None:
            r, x = self.z0m_ohm
            if r < 0 or not 0 < x < self.z0_ohm[1]:
                must = "must be [r, x] with r >= 0 and x > 0 below that of z0_ohm"
                raise ValueError(f"z0m_ohm {must}, not [{r:g}, {x:g}]")
            if self.z0_ohm[1] <= self.z1_ohm[1]:
                raise ValueError("z0m_ohm needs a z0_ohm above z1_ohm")
        return self

    @model_validator(mode="after")
    def _charging(self) -> LineSettings:
        if self.b1_us is None and self.b0_us is None:
            return self
        if self.b1_us is None or self.b0_us is None:
            raise ValueError("give b1_us and b0_us, or neither")
        if self.b0_us > self.b1_us:
            raise ValueError(f"b0_us must be at most b1_us, {self.b1_us:g}, not {self.b0_us:g}")
        return self


def _table(function: Function) -> Any:
    """A function's place in the settings: type and default of its field."""
    if function.most > 1:
        return (tuple[function.settings, ...], Field(default=(), strict=False, max_length=function.most))
    if function.always:
        return (function.settings, function.settings())
    return (function.settings | None, None)


Tables: Any = create_model("Tables", __base__=Table, **{f.key: _table(f) for f in FUNCTIONS})
"""The tables of the functions."""


class RelaySettings(Tables):
    """A relay's settings: ``[relay]``, ``[estimator]``, ``[line]``, ``[vt]``, a table for each function.

    Build them from a file (`load_settings`) or a dict (`RelaySettings.from_dict`).
    """

    first_place: ClassVar[int] = 1  # of a function's tables: [[pdis]] by [[pdis]] they are PDIS1, PDIS2 ...

    relay: Header
    estimator: EstimatorSettings = EstimatorSettings()
    line: LineSettings
    vt: VtSettings = VtSettings()

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
        result: RelaySettings = validate(cls, data, path)
        result._path, result._text = path, text
        _check(result, path)
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
    def z0m_ohm(self) -> complex:
        """Zero-sequence mutual impedance with the parallel line, primary [ohm]; 0 where it does not count."""
        return 0j if self.line.z0m_ohm is None else complex(*self.line.z0m_ohm) * self.ohm_ratio

    @property
    def residual_compensation_factor(self) -> complex:
        """k0 = (z0 - z1) / (3 z1) of the line."""
        return (self.z0_ohm - self.z1_ohm) / (3 * self.z1_ohm)

    @cached_property
    def inverse_vt(self) -> NDArray[np.float64] | None:
        """Constants of the inverse of the voltage transformer's circuit; None where it needs none."""
        if self.vt.circuit is None:
            return None
        return inverse(self._transfer(self.vt.circuit), self.relay.sampling_hz, self.relay.frequency_hz)

    def _transfer(self, circuit: Circuit) -> Fraction:
        chosen = chosen_circuit(circuit, self.vt.burden_va, self.relay.frequency_hz)
        return chosen.transfer(2 * math.pi * self.relay.frequency_hz)

    @cached_property
    def tripping_zones(self) -> list[Zone]:
        """The distance zones that trip."""
        return coordination.tripping_zones(self)

    @cached_property
    def doubts(self) -> list[Doubt]:
        """What the zones are set to do that may not be meant: out of their order, beyond the line at once."""
        return coordination.doubts(self)

    def amperes(self, value: float | None, default: float) -> float:
        """A current setting in primary amperes; ``default`` (primary) where it was not given."""
        return default if value is None else value * self.ct_ratio

    def volts(self, value: float | None, default: float) -> float:
        """The same of a voltage setting, in primary volts."""
        ratio = 1.0 if self.relay.ohms == "primary" else float(self.relay.vt_ratio or 1.0)
        return default if value is None else value * ratio

    def samples(self, ms: float) -> int:
        """A time in samples."""
        return round(ms * self.relay.sampling_hz / 1000)

    def tables(self, function: Function) -> tuple[Any, ...]:
        """The tables of a function, one for each instance."""
        given = getattr(self, function.key)
        return given if function.most > 1 else () if given is None else (given,)


def load_settings(path: Path | str, overrides: Sequence[str] = ()) -> RelaySettings:
    """Read, override (``pdis.1.reach_pu=0.9``: of PDIS1) and validate a settings file; raises InputError."""
    path = Path(path)
    return _loaded(path, read_text(path), tuple(overrides))


@lru_cache(64)
def _loaded(path: Path, text: str, overrides: tuple[str, ...]) -> RelaySettings:
    data = parse_toml(text, path)
    for override in overrides:
        set_key(data, *split_override(override), first=1, said=override)
    return RelaySettings.from_dict(data, path=path, text=text)


def _check(settings: RelaySettings, path: Path | None) -> None:
    """What only the whole file can judge."""
    method = settings.estimator.method
    reason = refusal(method)
    if reason is not None and settings.pdis and not settings.estimator.unsafe:
        what = f"'{method}' is none for distance zones: {reason}; take 'kalman-bank', or say unsafe = true"
        raise InputError(what, file=path, key="estimator.method")
    if settings.line.b1_us is not None and abs(settings.z1_ohm) * settings.line.b1_us > LONGEST_LINE * 1e6:
        longest = LONGEST_LINE * 1e6 / abs(settings.z1_ohm)
        what = f"must be below {longest:.3g} beside this z1_ohm: the whole line's, primary microsiemens"
        raise InputError(what, file=path, key="line.b1_us")
    if settings.vt.circuit is not None:
        what = what_mistunes(settings.vt.circuit, settings.vt.burden_va, settings.relay.frequency_hz)
        if what is not None:
            raise InputError(what, file=path, key="vt.circuit")
    for function in FUNCTIONS:
        if function.check is not None and settings.tables(function):
            try:
                function.check(settings)
            except InputError as error:
                raise InputError(error.what, file=path, key=error.key) from None
