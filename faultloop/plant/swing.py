"""``[[swing]]``: a source whose angle moves: a power swing, stable or not."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Annotated, ClassVar, Self

import numpy as np
from pydantic import Field, model_validator

from faultloop.config.tables import Name, Number, Seconds
from faultloop.errors import InputError
from faultloop.plant.circuit import Circuit
from faultloop.plant.component import Component, PlantTables
from faultloop.plant.source import Source

FASTEST_HZ = 20.0
"""Slip beyond which it is no swing."""


class Swing(Component):
    """The source has these angles at these times, in place of its own `angle_deg`: on straight lines between
    them, the first before, the last after.  The run begins in the steady state of the angle at its start."""

    table: ClassVar[str] = "swing"
    letter: ClassVar[str] = "W"

    name: Name = ""
    """W1, W2, ... where not given."""
    source: Name
    """Whose angle it is."""
    at_s: Annotated[tuple[Seconds, ...], Field(strict=False, min_length=1)]
    """Times, rising ..."""
    angle_deg: Annotated[tuple[Number, ...], Field(strict=False, min_length=1)]
    """... and the source's angle at each of them."""

    @model_validator(mode="after")
    def _a_curve(self) -> Swing:
        if len(self.at_s) != len(self.angle_deg):
            raise ValueError(
                f"at_s and angle_deg belong together, one angle for each time: {len(self.at_s)} and "
                f"{len(self.angle_deg)} are given"
            )
        if any(after <= before for before, after in pairwise(self.at_s)):
            raise ValueError("at_s must ascend")
        turns = np.diff(self.angle_deg) / 360
        if len(turns) and (fastest := np.abs(turns / np.diff(self.at_s)).max()) > FASTEST_HZ:
            raise ValueError(f"a slip of {fastest:.3g} Hz is no swing; at most {FASTEST_HZ:g} Hz")
        return self

    def check(self, tables: PlantTables) -> None:
        tables.find(Source, self.source, self.key("source"))
        for other in tables.all(Swing):
            if other.name == self.name:
                return
            if other.source == self.source:
                raise InputError(
                    f"source '{self.source}' already has the swing '{other.name}'", key=self.key("source")
                )

    def add(self, circuit: Circuit, tables: PlantTables) -> None:
        number = circuit.number[Source.table, self.source]
        angles = np.radians(self.angle_deg)
        begins = float(np.interp(0.0, self.at_s, angles))
        points = zip(self.at_s, (angles - begins).tolist(), strict=True)
        circuit.emfs[number] = replace(circuit.emfs[number], phase=begins, swing=tuple(points))

    def beginning_at(self, begins_s: float, tables: PlantTables) -> Self:
        own = tables.find(Source, self.source, self.key("source")).frequency_hz
        turned = 360.0 * ((own or tables.system.frequency_hz) * begins_s % 1.0)
        return self.model_copy(
            update={
                "at_s": tuple(at - begins_s for at in self.at_s),
                "angle_deg": tuple(angle + turned for angle in self.angle_deg),
            }
        )
