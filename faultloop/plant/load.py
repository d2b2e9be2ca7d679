"""``[[load]]``: a constant impedance at a bus, given by its power at nominal voltage."""

from __future__ import annotations

from typing import ClassVar, Literal

import numpy as np
from pydantic import model_validator

from faultloop.config.tables import Name, NonNegative, Number
from faultloop.plant.circuit import Circuit
from faultloop.plant.component import Component, PlantTables
from faultloop.plant.elements import GROUND
from faultloop.plant.elements.capacitor import Capacitor
from faultloop.plant.elements.series_rl import SeriesRL


class Load(Component):
    """A lagging load is a series R-L, ``Z = base_kv^2 / (mw - j mvar)``, whose current dies away when its bus
    is shorted; a leading one is a resistance beside a capacitance.

    ``wye`` has its star point earthed; ``delta`` carries no zero sequence."""

    table: ClassVar[str] = "load"

    bus: Name
    """Where it is."""
    mw: NonNegative
    """Three-phase, at `base_kv`."""
    mvar: Number = 0.0
    """Three-phase; positive: it takes reactive power."""
    connection: Literal["wye", "delta"] = "wye"
    """With its star point earthed, or without zero sequence."""

    @model_validator(mode="after")
    def _some_power(self) -> Load:
        if self.mw == 0 and self.mvar == 0:
            raise ValueError("mw and mvar are both zero; leave the load out")
        return self

    def check(self, tables: PlantTables) -> None:
        tables.known_bus(self.bus, self.key("bus"))

    def add(self, circuit: Circuit, tables: PlantTables) -> None:
        omega = 2 * np.pi * circuit.frequency_hz
        z = circuit.base_v**2 / complex(self.mw, -self.mvar) / 1e6
        if self.mvar >= 0:
            circuit.passive.append(self._impedance(z.real, z.imag / omega))
            return
        zero = 0.0 if self.connection == "delta" else 1.0
        susceptance = -self.mvar * 1e6 / circuit.base_v**2
        circuit.passive.append(Capacitor(self.bus, GROUND, np.array([zero, 1.0]) * susceptance / omega))
        if self.mw:
            circuit.passive.append(self._impedance(circuit.base_v**2 / self.mw / 1e6, 0.0))

    def _impedance(self, r: float, l: float) -> SeriesRL:
        zero = np.inf if self.connection == "delta" else r
        return SeriesRL(self.bus, GROUND, np.array([zero, r]), np.array([l, l]))
