"""``[[series_capacitor]]``: a bank in a line, with the varistor that protects it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from faultloop.config.tables import Name, Positive
from faultloop.errors import InputError
from faultloop.plant.circuit import SAME_POINT, Circuit
from faultloop.plant.component import Component, PlantTables
from faultloop.plant.elements.capacitor import Capacitor
from faultloop.plant.elements.switch import Action
from faultloop.plant.elements.varistor import Varistor
from faultloop.plant.line import Line
from faultloop.plant.network import Model
from faultloop.plant.steady import Steady

QUIET = 0.8
"""Of the varistor's level: a healthy network stays below it."""


class SeriesCapacitor(Component):
    """At ``at_pu`` of the line from its ``from`` end, inside the breakers.  A fault at the same place lies on
    its side towards the middle of the line.

    The varistor carries ``mov_ka`` at a peak of ``mov_kv``, ``i ~ u^exponent``; it has no energy limit, and
    there is no gap and no bypass breaker."""

    table: ClassVar[str] = "series_capacitor"
    letter: ClassVar[str] = "SC"

    name: Name = ""
    """SC1, SC2, ... where not given."""
    line: Name
    """The line that it is in."""
    at_pu: Annotated[float, Field(ge=0, le=1)]
    """From the line's `from` end; at 0 and 1 inside the breaker."""
    x_ohm: Positive
    """Of each phase, at system frequency."""
    mov_kv: Positive | None = None
    """Peak voltage at which the varistor carries `mov_ka`, above what load puts across the bank; no varistor
    where not given."""
    mov_ka: Positive = 10.0
    """Peak current of the varistor at `mov_kv`."""
    exponent: Annotated[float, Field(ge=5, le=60)] = 30.0
    """Of the varistor's curve, i ~ u^exponent."""

    def check(self, tables: PlantTables) -> None:
        line = tables.find(Line, self.line, self.key("line"))
        banks = [bank for bank in tables.all(SeriesCapacitor) if bank.line == self.line]
        total, own = sum(bank.x_ohm for bank in banks), line.z1_ohm.imag
        if total >= own:
            raise InputError(
                f"{total:g} ohm in series overcompensate line '{self.line}' of {own:g} ohm; "
                "give less than that in all",
                key=self.key("x_ohm"),
            )
        for other in banks:
            if other.name == self.name:
                return
            if abs(other.at_pu - self.at_pu) <= SAME_POINT:
                raise InputError(
                    f"'{other.name}' is already at this place of '{self.line}'", key=self.key("at_pu")
                )

    def cuts(self, tables: PlantTables) -> list[tuple[str, float]]:
        return [(self.line, self.at_pu)]

    def add(self, circuit: Circuit, tables: PlantTables) -> None:
        circuit.take_apart(self.line, self.at_pu)

    def couple(self, circuit: Circuit, tables: PlantTables) -> None:
        before, after = circuit.sides(self.line, self.at_pu)
        c = 1 / (2 * np.pi * circuit.frequency_hz * self.x_ohm)
        circuit.passive.append(Capacitor(before, after, np.array([c, c])))
        if self.mov_kv is not None:
            level, amperes = self.mov_kv * 1e3, self.mov_ka * 1e3
            circuit.varistors.append(Varistor(before, after, level, amperes, self.exponent))

    def actions(self, model: Model, steady: Sequence[Steady]) -> tuple[list[Action], list[str]]:
        """None; raises InputError where the varistor would conduct before any fault."""
        before, after = (model.row[node] for node in model.circuit.sides(self.line, self.at_pu))
        peak = sum(abs(s.v[before] - s.v[after]) for s in steady)
        if self.mov_kv is not None and peak > QUIET * self.mov_kv * 1e3:
            raise InputError(
                f"{self.mov_kv:g} kV is less than a healthy network needs: load puts {peak / 1e3:.3g} kV "
                f"(peak) across the bank, so at least {peak / QUIET / 1e3:.3g}",
                key=self.key("mov_kv"),
            )
        return [], []
