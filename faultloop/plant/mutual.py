"""``[[mutual]]``: two circuits on the same towers, coupled in the zero sequence."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator

from faultloop.config.tables import Name, NonNegative, Positive
from faultloop.errors import InputError
from faultloop.plant.circuit import SAME_POINT, Circuit, Laid
from faultloop.plant.component import Component, PlantTables
from faultloop.plant.elements import GROUND
from faultloop.plant.elements.bergeron import Wave, bergeron_sections
from faultloop.plant.elements.capacitor import Capacitor
from faultloop.plant.elements.line_constants import LineConstants
from faultloop.plant.elements.mutual import CoupledBranches, CoupledWaves
from faultloop.plant.line import Line

Direction = Literal["same", "opposite"]
Stretch = tuple[float, float]


class Mutual(Component):
    """Without `from_km` the circuits run side by side from a bus that they share, as far as the shorter goes.

    `direction` is that of the second line's ``from`` to ``to``, seen along the first; it follows from a bus
    that they share.  ``bergeron`` lines need equal zero-sequence constants, else the modes are no sum and
    difference; ``pi`` and ``rl`` lines may differ."""

    table: ClassVar[str] = "mutual"
    letter: ClassVar[str] = "M"

    name: Name = ""
    """M1, M2, ... where not given."""
    lines: Annotated[tuple[Name, ...], Field(strict=False, min_length=2, max_length=2)]
    """Names of the two lines."""
    r0m_ohm_per_km: NonNegative
    """Zero-sequence mutual resistance."""
    x0m_ohm_per_km: Positive
    """Zero-sequence mutual reactance, below the lines' own."""
    b0m_us_per_km: NonNegative = 0.0
    """Zero-sequence mutual susceptance."""
    from_km: Annotated[tuple[NonNegative, ...], Field(strict=False, min_length=2, max_length=2)] | None = None
    """[a, b]: where the common stretch begins on the first line, and the place beside it on the second, each
    from its ``from`` end; at a bus that both have where not given."""
    length_km: Positive | None = None
    """Of the common stretch; as far as the shorter line goes where not given."""
    direction: Direction | None = None
    """How the second line's `from` to `to` runs along the first; by the shared bus where there is one."""

    @model_validator(mode="after")
    def _two_lines(self) -> Mutual:
        if self.lines[0] == self.lines[1]:
            raise ValueError(f"a line is not coupled with itself: '{self.lines[0]}' is named twice")
        if (self.from_km is None) != (self.direction is None):
            raise ValueError("from_km and direction belong together")
        return self

    # ------------------------------------------------------------------ where

    def stretches(self, tables: PlantTables) -> tuple[Stretch, Stretch]:
        """The common stretch on each line [pu], from its beginning on the first; descending on the second
        where that runs in the opposite direction.  Raises InputError where there is none."""
        a, b = self._lines(tables)
        begin, sign = self._beginning(a, b)
        room = b.length_km - begin[1] if sign > 0 else begin[1]
        longest = min(a.length_km - begin[0], room)
        length = longest if self.length_km is None else self.length_km
        if longest <= 0:
            raise InputError(
                f"'{a.name}' ({a.length_km:g} km) and '{b.name}' ({b.length_km:g} km) share no length from "
                "there; give a place within both with length left in that direction",
                key=self.key("from_km"),
            )
        if not 0 < length <= longest * (1 + SAME_POINT):
            raise InputError(
                f"from there '{a.name}' and '{b.name}' run side by side for {longest:g} km at most",
                key=self.key("from_km" if self.length_km is None else "length_km"),
            )
        least = 2 * SAME_POINT * max(a.length_km, b.length_km)
        if length < least:
            raise InputError(
                f"{length:g} km are no length beside lines of {a.length_km:g} and {b.length_km:g} km; at "
                f"least {least:g}",
                key=self.key("lines" if self.length_km is None else "length_km"),
            )
        first, second = begin[0] / a.length_km, begin[1] / b.length_km
        return (first, first + length / a.length_km), (second, second + sign * length / b.length_km)

    def _lines(self, tables: PlantTables) -> tuple[Line, Line]:
        a, b = (tables.find(Line, name, self.key("lines")) for name in self.lines)
        return a, b

    def _beginning(self, a: Line, b: Line) -> tuple[tuple[float, float], int]:
        """Kilometres on both, and +1 where they run in the same direction, else -1."""
        if self.from_km is not None:
            return (self.from_km[0], self.from_km[1]), 1 if self.direction == "same" else -1
        if a.from_bus == b.from_bus:
            return (0.0, 0.0), 1
        if a.from_bus == b.to_bus:
            return (0.0, b.length_km), -1
        shorter = min(a.length_km, b.length_km)
        if a.to_bus == b.to_bus:
            return (a.length_km - shorter, b.length_km - shorter), 1
        if a.to_bus == b.from_bus:
            return (a.length_km - shorter, shorter), -1
        raise InputError(
            f"lines '{a.name}' and '{b.name}' share no bus: say where they run side by side "
            "(from_km, direction, length_km)",
            key=self.key("lines"),
        )

    # ------------------------------------------------------------------ checks

    def check(self, tables: PlantTables) -> None:
        a, b = self._lines(tables)
        own = self.stretches(tables)
        if (a.model, a.sections) != (b.model, b.sections):
            raise InputError(
                f"coupled lines need one model and one number of sections: '{a.name}' is {a.model}, "
                f"'{b.name}' {b.model}",
                key=self.key("lines"),
            )
        self._check_size(a, b)
        for other in tables.all(Mutual):
            if other.name == self.name:
                return
            for line, mine in zip(self.lines, own, strict=True):
                for theirs, where in zip(other.lines, other.stretches(tables), strict=True):
                    if line == theirs and _overlap(mine, where):
                        raise InputError(
                            f"line '{line}' is coupled there by '{other.name}' already; "
                            "three circuits on one tower are not modelled",
                            key=self.key("lines"),
                        )

    def _check_size(self, a: Line, b: Line) -> None:
        """A passive pair: both matrices positive definite."""
        for key, mutual, pair in (
            ("x0m_ohm_per_km", self.x0m_ohm_per_km, (a.x0_ohm_per_km, b.x0_ohm_per_km)),
            ("r0m_ohm_per_km", self.r0m_ohm_per_km, (a.r0_ohm_per_km, b.r0_ohm_per_km)),
            ("b0m_us_per_km", self.b0m_us_per_km, (a.b0_us_per_km, b.b0_us_per_km)),
        ):
            limit = math.sqrt(pair[0] * pair[1])
            if mutual >= limit and mutual > 0:
                raise InputError(
                    f"{mutual:g} is not below the geometric mean of the lines' own zero sequence, {limit:g}",
                    key=self.key(key),
                )
        own = [(line.r0_ohm_per_km, line.x0_ohm_per_km, line.b0_us_per_km) for line in (a, b)]
        if a.model == "bergeron" and own[0] != own[1]:
            raise InputError(
                f"as travelling waves '{a.name}' and '{b.name}' need the same r0, x0 and b0 per km; "
                'model = "pi" couples lines that differ',
                key=self.key("lines"),
            )

    # ------------------------------------------------------------------ building

    def cuts(self, tables: PlantTables) -> list[tuple[str, float]]:
        """The ends of the common stretch, and in it every place at which the other line has a node."""
        own = dict(zip(self.lines, self.stretches(tables), strict=True))
        found = [(line, place) for line, stretch in own.items() for place in stretch]
        for item in tables.items():
            if isinstance(item, Mutual):
                continue
            for line, place in item.cuts(tables):
                if line in own and _inside(place, own[line]):
                    other = self.lines[1 - self.lines.index(line)]
                    found.append((other, _beside(place, own[line], own[other])))
        return found

    def add(self, circuit: Circuit, tables: PlantTables) -> None:
        """Says into how many waves each stretch is cut: as many as the hardest of the modes needs."""
        a, b = self._lines(tables)
        if a.model != "bergeron":
            return
        modes = [line.constants(circuit.frequency_hz) for line in (a, b)]
        modes += self._modes(modes[0])
        for line, (begin, end) in zip((a, b), self.stretches(tables), strict=True):
            low, high = min(begin, end), max(begin, end)
            points = [p for p in circuit.cuts[line.name] if low - SAME_POINT < p < high + SAME_POINT]
            for start, stop in pairwise(points):
                counts = [bergeron_sections(m, (stop - start) * line.length_km, circuit.dt) for m in modes]
                circuit.waves[line.name, start] = max(counts) if min(counts) else 0

    def couple(self, circuit: Circuit, tables: PlantTables) -> None:
        a, b = self._lines(tables)
        own, other = self.stretches(tables)
        opposite = other[1] < other[0]
        second = [laid for laid in circuit.laid[b.name] if _inside((laid.start + laid.end) / 2, other)]
        first = [laid for laid in circuit.laid[a.name] if _inside((laid.start + laid.end) / 2, own)]
        for one, two in zip(first, reversed(second) if opposite else second, strict=True):
            if one.waves:
                self._couple_waves(circuit, one, two, a.constants(circuit.frequency_hz), opposite)
            else:
                self._couple_branches(circuit, one, two, a.length_km, opposite)

    def _couple_waves(
        self, circuit: Circuit, one: Laid, two: Laid, constants: LineConstants, opposite: bool
    ) -> None:
        """The sum's zero mode to the first, the difference's to the second."""
        for i in range(one.number):
            j = two.first + (two.number - 1 - i if opposite else i)
            i += one.first
            for at, mode in zip((i, j), self._modes(constants), strict=True):
                section = circuit.sections[at]
                wave = _with_zero_mode(section.wave, Wave.of(mode, one.section_km, circuit.dt))
                circuit.sections[at] = replace(section, wave=wave)
            circuit.coupled.append(CoupledWaves(i, j, opposite))

    def _couple_branches(
        self, circuit: Circuit, one: Laid, two: Laid, length_km: float, opposite: bool
    ) -> None:
        omega = 2 * np.pi * circuit.frequency_hz
        km, sign = one.section_km, -1 if opposite else 1
        for i in range(one.number):
            j = two.first + (two.number - 1 - i if opposite else i)
            r, l = sign * self.r0m_ohm_per_km * km, sign * self.x0m_ohm_per_km * km / omega
            circuit.coupled.append(CoupledBranches(one.first + i, j, r, l))
        if not self.b0m_us_per_km:
            return
        nodes = list(reversed(two.nodes)) if opposite else two.nodes
        between = self.b0m_us_per_km * 1e-6 / omega * km
        for i, (x, y) in enumerate(zip(one.nodes, nodes, strict=True)):
            share = between * (0.5 if i in (0, one.number) else 1.0)
            # b0 of a line is all that it has: what goes to the other circuit does not go to earth
            circuit.add_to_lines(Capacitor(x, y, np.array([share, 0.0])), self.lines)
            for node, line in ((x, self.lines[0]), (y, self.lines[1])):
                circuit.add_to_lines(Capacitor(node, GROUND, np.array([-share, 0.0])), (line,))

    def _modes(self, line: LineConstants) -> list[LineConstants]:
        """Of the circuits' sum and difference, in place of the zero sequence."""
        omega = 2 * np.pi * line.frequency_hz
        r, l = self.r0m_ohm_per_km, self.x0m_ohm_per_km / omega
        c = self.b0m_us_per_km * 1e-6 / omega
        zero = np.array([1.0, 0.0])
        return [
            replace(line, r=line.r + s * r * zero, l=line.l + s * l * zero, c=line.c - s * c * zero)
            for s in (1, -1)
        ]


def _with_zero_mode(wave: Wave, other: Wave) -> Wave:
    """``wave`` with the other's mode 0."""

    def mixed(own: np.ndarray, zero: np.ndarray) -> np.ndarray:
        return np.stack([zero[0], own[1]])

    return Wave(
        mixed(wave.y, other.y),
        mixed(wave.h, other.h),
        mixed(wave.delay, other.delay),
        mixed(wave.newest, other.newest),
        mixed(wave.weights, other.weights),
    )


def _inside(place: float, stretch: Stretch) -> bool:
    return min(stretch) - SAME_POINT <= place <= max(stretch) + SAME_POINT


def _beside(place: float, stretch: Stretch, other: Stretch) -> float:
    """The place on the other line."""
    share = (place - stretch[0]) / (stretch[1] - stretch[0])
    return min(max(other[0] + share * (other[1] - other[0]), 0.0), 1.0)


def _overlap(a: Stretch, b: Stretch) -> bool:
    return min(max(a), max(b)) - max(min(a), min(b)) > SAME_POINT
