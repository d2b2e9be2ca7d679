"""``[[transformer]]``: YNd, as far as what is behind its delta needs it."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from faultloop.config.tables import Name, NonNegative, Positive
from faultloop.errors import InputError
from faultloop.plant.circuit import Circuit
from faultloop.plant.component import Component, PlantTables
from faultloop.plant.elements import GROUND
from faultloop.plant.elements.series_rl import SeriesRL


class Transformer(Component):
    """Between ``bus``, its star side with an earthed neutral, and ``delta_bus``, which it makes.

    The leakage impedance carries positive and negative sequence from side to side, and the star side's zero
    sequence to earth; none passes the delta.  Voltages and currents of the delta side are those referred to
    the star side, and not turned by the vector group: what it turns positive and negative sequence by, in
    opposite directions, nobody on the star side can see as long as all behind the delta treats both alike
    or makes its negative sequence from its own voltages.  No magnetizing current, no saturation."""

    table: ClassVar[str] = "transformer"

    bus: Name
    """Of its star side, earthed."""
    delta_bus: Name
    """The bus that it makes, referred to the star side."""
    rated_mva: Positive
    """Base of the impedances."""
    x_pu: Annotated[float, Field(gt=0, le=1)]
    """Leakage reactance."""
    r_pu: NonNegative = 0.0
    """Resistance of the windings."""

    def buses(self) -> tuple[str, ...]:
        return (self.delta_bus,)

    def check(self, tables: PlantTables) -> None:
        tables.known_bus(self.bus, self.key("bus"))
        if self.bus == self.delta_bus:
            what = "is the star side's bus, too; give the delta side one of its own"
            raise InputError(what, key=self.key("delta_bus"))

    def add(self, circuit: Circuit, tables: PlantTables) -> None:
        ohm = circuit.base_v**2 / (self.rated_mva * 1e6)
        r, l = self.r_pu * ohm, self.x_pu * ohm / (2 * math.pi * circuit.frequency_hz)
        both = np.array([l, l])
        circuit.passive.append(SeriesRL(self.bus, self.delta_bus, np.array([np.inf, r]), both))
        circuit.passive.append(SeriesRL(self.bus, GROUND, np.array([r, np.inf]), both))
