"""``[[line]]``: a transposed line by sequence parameters, as waves, as pi sections or as a series R-L."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator

from faultloop.config.place import End
from faultloop.config.tables import Name
from faultloop.plant.circuit import SAME_POINT, Circuit, Laid, Term
from faultloop.plant.component import Component, PlantTables
from faultloop.plant.elements import GROUND
from faultloop.plant.elements.bergeron import Wave, WaveSection, bergeron_sections
from faultloop.plant.elements.capacitor import Capacitor
from faultloop.plant.elements.line_constants import LineConstants
from faultloop.plant.elements.series_rl import SeriesRL

PI_SECTION_KM = 20.0
"""Longest nominal-pi section where the scenario does not say: within 2e-4 of the exact line at 60 Hz."""

ENDS: tuple[End, ...] = ("from", "to")
PerKm = Annotated[float, Field(ge=0, le=1e4)]


class Line(Component):
    """``from`` and ``to`` are its buses; a bus exists once a line names it."""

    table: ClassVar[str] = "line"
    least: ClassVar[int] = 1

    from_bus: Name = Field(alias="from")
    """The bus at its beginning ..."""
    to_bus: Name = Field(alias="to")
    """... and at its end."""
    length_km: Annotated[float, Field(gt=0, le=5000)]
    """Its length."""
    model: Literal["bergeron", "pi", "rl"] = "bergeron"
    """Travelling waves; cascaded coupled pi sections; series impedance alone."""
    r1_ohm_per_km: PerKm
    """Positive-sequence resistance."""
    x1_ohm_per_km: Annotated[float, Field(gt=0, le=1e4)]
    """Positive-sequence reactance at system frequency."""
    b1_us_per_km: PerKm = 0.0
    """Positive-sequence susceptance; 0 for "rl"."""
    r0_ohm_per_km: PerKm
    """Zero-sequence resistance."""
    x0_ohm_per_km: Annotated[float, Field(gt=0, le=1e4)]
    """Zero-sequence reactance."""
    b0_us_per_km: PerKm = 0.0
    """Zero-sequence susceptance."""
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

    def bus(self, end: End) -> str:
        """At an end."""
        return self.from_bus if end == "from" else self.to_bus

    def buses(self) -> tuple[str, ...]:
        return self.from_bus, self.to_bus

    def cuts(self, tables: PlantTables) -> list[tuple[str, float]]:
        return [(self.name, 0.0), (self.name, 1.0)]

    def constants(self, frequency_hz: float) -> LineConstants:
        """Per kilometre, with reactances and susceptances at the given frequency."""
        omega = 2 * np.pi * frequency_hz
        return LineConstants(
            r=np.array([self.r0_ohm_per_km, self.r1_ohm_per_km]),
            l=np.array([self.x0_ohm_per_km, self.x1_ohm_per_km]) / omega,
            c=np.array([self.b0_us_per_km, self.b1_us_per_km]) * 1e-6 / omega,
            frequency_hz=frequency_hz,
        )

    def add(self, circuit: Circuit, tables: PlantTables) -> None:
        for end in ENDS:
            circuit.terminals.setdefault((self.name, end), self.bus(end))
        points = circuit.cuts[self.name]
        sides = [circuit.sides(self.name, p) for p in points]
        first = (len(circuit.passive), len(circuit.sections))
        for i in range(len(points) - 1):
            self._add_stretch(circuit, sides[i][1], sides[i + 1][0], points[i : i + 2])
        for end, node in (("from", sides[0][1]), ("to", sides[-1][0])):
            # where there is a breaker, its current is already the line end's
            circuit.terms.setdefault((self.name, end), _currents_from(circuit, node, *first))

    def _add_stretch(self, circuit: Circuit, start: str, end: str, span: list[float]) -> None:
        """One stretch between two points of the line, in its model."""
        constants = self.constants(circuit.frequency_hz)
        length = (span[1] - span[0]) * self.length_km
        waves = self._wave_count(circuit, constants, length, span[0])
        laid = circuit.laid.setdefault(self.name, [])
        if waves:
            wave = Wave.of(constants, length / waves, circuit.dt)
            names = self._cascade(start, end, span[0], waves)
            laid.append(Laid(span[0], span[1], True, len(circuit.sections), waves, names, length / waves))
            circuit.sections += [WaveSection(a, b, wave) for a, b in pairwise(names)]
            return
        if self.model == "bergeron":
            self._note_short(circuit, constants, length, span)
        count = self._section_count(length, span)
        names = self._cascade(start, end, span[0], count)
        laid.append(Laid(span[0], span[1], False, len(circuit.passive), count, names, length / count))
        r, l, c = (per_km * length / count for per_km in (constants.r, constants.l, constants.c))
        circuit.passive += [SeriesRL(a, b, r, l) for a, b in pairwise(names)]
        if c.any():
            shares = [0.5, *[1.0] * (count - 1), 0.5]
            circuit.passive += [
                Capacitor(name, GROUND, c * share) for name, share in zip(names, shares, strict=True)
            ]

    def _wave_count(self, circuit: Circuit, constants: LineConstants, length: float, start: float) -> int:
        """Bergeron sections of a stretch; 0 where it is none."""
        if self.model != "bergeron":
            return 0
        asked = circuit.waves.get((self.name, start))
        return bergeron_sections(constants, length, circuit.dt) if asked is None else asked

    def _section_count(self, length: float, span: list[float]) -> int:
        """Series sections of a stretch that is no wave."""
        if self.sections is not None:
            return max(1, math.ceil(self.sections * (span[1] - span[0]) - SAME_POINT))
        return 1 if self.model == "rl" else math.ceil(length / PI_SECTION_KM)

    def _note_short(
        self, circuit: Circuit, constants: LineConstants, length: float, span: list[float]
    ) -> None:
        tau = constants.travel_time(length).min()
        circuit.notes.append(
            f"line {self.name} from {span[0]:.6g} to {span[1]:.6g} pu ({length:.4g} km): travel time "
            f"{tau * 1e6:.3g} us is under one step of {circuit.dt * 1e6:.3g} us, so nominal-pi there"
        )

    def _cascade(self, start: str, end: str, at: float, count: int) -> list[str]:
        """Names of the nodes of ``count`` equal sections from position ``at`` on."""
        return [start, *(f"{self.name}@{at!r}#{i}" for i in range(1, count)), end]


def _currents_from(circuit: Circuit, node: str, first_branch: int, first_wave: int) -> list[Term]:
    """Currents out of ``node`` into the line's own parts, which begin at the given indices."""
    terms: list[Term] = []
    for i, branch in enumerate(circuit.passive[first_branch:], first_branch):
        if node in (branch.start, branch.end):
            terms.append(("branch", i, 1.0 if branch.start == node else -1.0))
    for i, section in enumerate(circuit.sections[first_wave:], first_wave):
        if section.start == node:
            terms.append(("wave_start", i, 1.0))
        if section.end == node:
            terms.append(("wave_end", i, 1.0))
    return terms
