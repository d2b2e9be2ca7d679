"""``[[source]]``: a Thevenin source with coupled impedance, or one given by its source impedance ratio."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, Self

import numpy as np
from pydantic import Field, model_validator

from faultloop.config.tables import ComplexOhm, Name, Number, Positive
from faultloop.errors import InputError
from faultloop.plant.circuit import Circuit
from faultloop.plant.component import Component, PlantTables
from faultloop.plant.elements.emf import Emf
from faultloop.plant.elements.series_rl import SeriesRL
from faultloop.plant.line import Line


class Source(Component):
    """``v_a = sqrt(2/3) voltage_pu base_kv cos(2 pi f t + angle)`` behind a coupled series R-L."""

    table: ClassVar[str] = "source"
    least: ClassVar[int] = 1

    bus: Name
    """A bus that a line names."""
    voltage_pu: Positive = 1.0
    """Of `base_kv`."""
    angle_deg: Number = 0.0
    """Of phase A's cosine at t = 0."""
    z1_ohm: ComplexOhm | None = None
    """Positive-sequence impedance, [r, x]; or `sir`."""
    z0_ohm: ComplexOhm | None = None
    """Zero-sequence impedance, [r, x]."""
    sir: Positive | None = None
    """|Zs1| / |Zl1|, at the line's angle, of the first line listed at the bus."""
    z0_over_z1: Positive = 1.0
    """With `sir`: the zero-sequence impedance."""
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

    def check(self, tables: PlantTables) -> None:
        tables.known_bus(self.bus, self.key("bus"), "line at bus")

    def add(self, circuit: Circuit, tables: PlantTables) -> None:
        z1, z0 = self._impedance(tables)
        r = np.array([z0.real, z1.real])
        l = np.array([z0.imag, z1.imag]) / (2 * np.pi * circuit.frequency_hz)
        frequency = self.frequency_hz or circuit.frequency_hz
        if frequency * circuit.dt > 0.1:
            raise InputError(
                f"{frequency:g} Hz is too high for {circuit.rate} steps per second; "
                f"at most {0.1 * circuit.rate:g}",
                key=self.key("frequency_hz"),
            )
        peak = math.sqrt(2 / 3) * self.voltage_pu * tables.system.base_kv * 1e3
        behind = SeriesRL(f"source {self.name}", self.bus, r, l)
        circuit.add_emf(self.table, self.name, Emf(behind, peak, frequency, math.radians(self.angle_deg)))

    def beginning_at(self, begins_s: float, tables: PlantTables) -> Self:
        turns = (self.frequency_hz or tables.system.frequency_hz) * begins_s % 1.0
        return self.model_copy(update={"angle_deg": self.angle_deg + 360.0 * turns})

    def _impedance(self, tables: PlantTables) -> tuple[complex, complex]:
        if self.z1_ohm is not None and self.z0_ohm is not None:
            return complex(*self.z1_ohm), complex(*self.z0_ohm)
        line = next(line for line in tables.all(Line) if self.bus in line.buses())
        assert self.sir is not None
        z1 = self.sir * line.z1_ohm
        return z1, self.z0_over_z1 * z1
