"""``[[inverter]]``: a grid-following inverter, as a wind or solar plant's."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator

from faultloop.config.tables import Name, NonNegative, Positive
from faultloop.errors import InputError
from faultloop.plant.circuit import Circuit
from faultloop.plant.component import Component, PlantTables
from faultloop.plant.elements.converter import Converter
from faultloop.plant.elements.emf import Emf
from faultloop.plant.elements.series_rl import SeriesRL
from faultloop.plant.source import Source


class Inverter(Component):
    """It follows the positive-sequence voltage of its bus, delivers ``power_mw`` at unity power factor, and
    in a fault ``current_limit_pu`` at most, of which the reactive current comes first.  It makes no zero
    sequence; the transformer in front of it does (``[[transformer]]``)."""

    table: ClassVar[str] = "inverter"

    bus: Name
    """Where it feeds in."""
    rated_mva: Positive
    """Base of the per-unit values."""
    power_mw: NonNegative
    """Before the fault, at unity power factor."""
    current_limit_pu: Annotated[float, Field(ge=1, le=3)] = 1.2
    """Of each phase's current."""
    negative_sequence: Literal["none", "controlled"] = "none"
    """"none": an accident of its current loop; "controlled": a current that leads V2 by 90 degrees."""
    k1: Annotated[float, Field(ge=0, le=10)] = 2.0
    """Reactive current per voltage below 0.9 ..."""
    k2: Annotated[float, Field(gt=0, le=10)] = 2.0
    """... and negative-sequence current per negative-sequence voltage."""
    filter_pu: Annotated[float, Field(ge=0.05, le=0.5)] = 0.15
    """Reactance of its filter."""
    filter_r_pu: Annotated[float, Field(gt=0, le=0.05)] = 0.003
    """Resistance of its filter."""

    @model_validator(mode="after")
    def _able(self) -> Inverter:
        if self.power_mw > self.rated_mva * self.current_limit_pu:
            most = self.rated_mva * self.current_limit_pu
            raise ValueError(f"power_mw is more than its current limit allows, {most:g} MW")
        return self

    def check(self, tables: PlantTables) -> None:
        tables.known_bus(self.bus, self.key("bus"))
        for source in tables.all(Source):
            if source.frequency_hz not in (None, float(tables.system.frequency_hz)):
                what = f"source '{source.name}' has a frequency of its own: no steady state for an inverter"
                raise InputError(what, key=source.key("frequency_hz"))

    def add(self, circuit: Circuit, tables: PlantTables) -> None:
        ohm = circuit.base_v**2 / (self.rated_mva * 1e6)
        r, x = self.filter_r_pu * ohm, self.filter_pu * ohm
        l = x / (2 * math.pi * circuit.frequency_hz)
        behind = SeriesRL(f"inverter {self.name}", self.bus, np.array([np.inf, r]), np.array([l, l]))
        peak = math.sqrt(2 / 3) * circuit.base_v
        circuit.converters.append(
            Converter(
                len(circuit.emfs),
                self.bus,
                self.rated_mva * 1e6,
                peak,
                self.filter_r_pu,
                self.filter_pu,
                self.power_mw / self.rated_mva,
                self.current_limit_pu,
                self.k1,
                self.k2 if self.negative_sequence == "controlled" else 0.0,
            )
        )
        circuit.add_emf(self.table, self.name, Emf(behind, peak, circuit.frequency_hz, 0.0))
