"""A scenario as a circuit: three-phase buses joined by branches, travelling-wave sections and switches."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Literal

import numpy as np

from faultloop.config.scenario import Fault, Line, Scenario, Source
from faultloop.errors import InputError
from faultloop.plant.lines import PI_SECTION_KM, LineConstants, Pair, Wave, bergeron_sections

GROUND = ":ground"
SAME_POINT = 1e-9
"""Two positions on a line closer than this, per unit, are one."""


@dataclass(frozen=True)
class Branch:
    """A coupled series R-L (``c`` None) or a coupled capacitor from a node to another or to ground."""

    start: str
    end: str
    r: Pair
    """[ohm], ``[mode 0, mode 1]``"""
    l: Pair
    """[H]"""
    c: Pair | None = None
    """[F]"""


@dataclass(frozen=True)
class WaveSection:
    """A Bergeron section between two nodes."""

    start: str
    end: str
    wave: Wave


@dataclass(frozen=True)
class Emf:
    """A balanced voltage behind its impedance, the branch from node ``node`` to the bus."""

    node: str
    amplitude: float
    """Phase to ground, peak [V]."""
    frequency_hz: float
    phase: float
    """Of phase A against cos(2 pi f t) [rad]."""


@dataclass(frozen=True)
class Switch:
    """Three poles between two nodes: a breaker, or a fault from a node to ground."""

    start: str
    end: str
    fault: Fault | None = None


Part = Literal["branch", "wave_start", "wave_end", "switch"]
Term = tuple[Part, int, float]
"""One summand of a line-end current: what, its index, sign."""


@dataclass
class Circuit:
    """What the solver is built from.  Nodes are named: a scenario's bus by its name, the line side of a
    breaker ``LINE:from``, a point on a line ``LINE@0.25``, an inner point of a cascade ``LINE@0.25#3``."""

    scenario: Scenario
    rate: int
    """Steps per second."""
    branches: list[Branch] = field(default_factory=list)
    waves: list[WaveSection] = field(default_factory=list)
    emfs: list[Emf] = field(default_factory=list)
    switches: list[Switch] = field(default_factory=list)
    terminals: dict[tuple[str, str], str] = field(default_factory=dict)
    """Node of each line end, ``(line, "from" | "to")``: behind its breaker where it has one."""
    terms: dict[tuple[str, str], list[Term]] = field(default_factory=dict)
    """What makes up the current from the bus into each line end: the breaker's, where there is one."""
    fault_nodes: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    @classmethod
    def of(cls, scenario: Scenario) -> Circuit:
        """The circuit of a scenario.  Raises InputError for a network without a unique solution."""
        circuit = cls(scenario, scenario.system.sampling_hz * scenario.system.steps_per_sample)
        for breaker in scenario.breaker:
            line = next(line for line in scenario.line if line.name == breaker.line)
            inner = f"{breaker.line}:{breaker.end}"
            circuit.terminals[breaker.line, breaker.end] = inner
            circuit.switches.append(Switch(_bus(line, breaker.end), inner))
        for source in scenario.source:
            circuit._add_source(source)
        for line in scenario.line:
            circuit._add_line(line)
        for fault in scenario.fault:
            circuit._add_fault(fault)
        circuit._check_islands()
        return circuit

    @property
    def dt(self) -> float:
        """Step [s]."""
        return 1 / self.rate

    @property
    def buses(self) -> list[str]:
        """Every node with an unknown voltage, in order of first use."""
        sources = {emf.node for emf in self.emfs} | {GROUND}
        ends = [n for x in (*self.branches, *self.waves, *self.switches) for n in (x.start, x.end)]
        return [n for n in dict.fromkeys(ends) if n not in sources]

    def current_row(self, kind: Part, index: int) -> int:
        """Row of `State.current`: branches, then start and end of each wave, then switches."""
        branches, waves = len(self.branches), len(self.waves)
        match kind:
            case "branch":
                return index
            case "wave_start" | "wave_end":
                return branches + 2 * index + (kind == "wave_end")
            case "switch":
                return branches + 2 * waves + index

    def _add_source(self, source: Source) -> None:
        system = self.scenario.system
        z1, z0 = self._source_impedance(source)
        r = np.array([z0.real, z1.real])
        l = np.array([z0.imag, z1.imag]) / (2 * np.pi * system.frequency_hz)
        node = f"source {source.name}"
        self.branches.append(Branch(node, source.bus, r, l))
        frequency = source.frequency_hz or float(system.frequency_hz)
        if frequency * self.dt > 0.1:
            raise InputError(
                f"{frequency:g} Hz is too high for {self.rate} steps per second; at most {0.1 * self.rate:g}",
                key=f"source[{source.name}].frequency_hz",
            )
        peak = math.sqrt(2 / 3) * source.voltage_pu * system.base_kv * 1e3
        self.emfs.append(Emf(node, peak, frequency, math.radians(source.angle_deg)))

    def _source_impedance(self, source: Source) -> tuple[complex, complex]:
        if source.z1_ohm is not None and source.z0_ohm is not None:
            return complex(*source.z1_ohm), complex(*source.z0_ohm)
        line = next(line for line in self.scenario.line if source.bus in (line.from_bus, line.to_bus))
        assert source.sir is not None
        z1 = source.sir * line.z1_ohm
        return z1, source.z0_over_z1 * z1

    def _add_line(self, line: Line) -> None:
        constants = LineConstants.of(line, self.scenario.system.frequency_hz)
        for end in ("from", "to"):
            self.terminals.setdefault((line.name, end), _bus(line, end))
        points = self._fault_points(line)
        names = [self.terminals[line.name, "from"]]
        names += [f"{line.name}@{p!r}" for p in points[1:-1]]
        names += [self.terminals[line.name, "to"]]
        first = (len(self.branches), len(self.waves))
        for i in range(len(points) - 1):
            self._add_stretch(line, constants, names[i], names[i + 1], points[i : i + 2])
        places = [(b.line, b.end) for b in self.scenario.breaker]
        for end, node in (("from", names[0]), ("to", names[-1])):
            place = (line.name, end)
            if place in places:
                self.terms[place] = [("switch", places.index(place), 1.0)]
            else:
                self.terms[place] = self._currents_from(node, *first)

    def _fault_points(self, line: Line) -> list[float]:
        """Positions [pu] at which the line is cut, both ends included."""
        points = [0.0, 1.0]
        for fault in self.scenario.fault:
            if fault.line == line.name and all(
                abs(fault_position(fault, line) - p) > SAME_POINT for p in points
            ):
                points.append(fault_position(fault, line))
        return sorted(points)

    def _add_stretch(
        self, line: Line, constants: LineConstants, start: str, end: str, span: list[float]
    ) -> None:
        """One stretch between two points of the line, in its model."""
        length = (span[1] - span[0]) * line.length_km
        waves = bergeron_sections(constants, length, self.dt) if line.model == "bergeron" else 0
        if waves:
            wave = Wave.of(constants, length / waves, self.dt)
            names = _cascade(line, start, end, span[0], waves)
            self.waves += [WaveSection(a, b, wave) for a, b in pairwise(names)]
            return
        count = 1
        if line.sections is not None:
            count = max(1, math.ceil(line.sections * (span[1] - span[0]) - SAME_POINT))
        elif line.model != "rl":
            count = math.ceil(length / PI_SECTION_KM)
        if line.model == "bergeron":
            self._note_short(line, constants, length, span)
        names = _cascade(line, start, end, span[0], count)
        r, l, c = (per_km * length / count for per_km in (constants.r, constants.l, constants.c))
        self.branches += [Branch(a, b, r, l) for a, b in pairwise(names)]
        if c.any():
            shares = [0.5, *[1.0] * (count - 1), 0.5]
            zero = np.zeros(2)
            self.branches += [
                Branch(name, GROUND, zero, zero, c * share) for name, share in zip(names, shares, strict=True)
            ]

    def _note_short(self, line: Line, constants: LineConstants, length: float, span: list[float]) -> None:
        tau = constants.travel_time(length).min()
        self.notes.append(
            f"line {line.name} from {span[0]:.6g} to {span[1]:.6g} pu ({length:.4g} km): travel time "
            f"{tau * 1e6:.3g} us is under one step of {self.dt * 1e6:.3g} us, so nominal-pi there"
        )

    def _currents_from(self, node: str, first_branch: int, first_wave: int) -> list[Term]:
        """Currents out of ``node`` into the line's own parts, which begin at the given indices."""
        terms: list[Term] = []
        for i in range(first_branch, len(self.branches)):
            if node in (self.branches[i].start, self.branches[i].end):
                terms.append(("branch", i, 1.0 if self.branches[i].start == node else -1.0))
        for i in range(first_wave, len(self.waves)):
            if self.waves[i].start == node:
                terms.append(("wave_start", i, 1.0))
            if self.waves[i].end == node:
                terms.append(("wave_end", i, 1.0))
        return terms

    def _add_fault(self, fault: Fault) -> None:
        node = fault.bus
        if node is None:
            line = next(line for line in self.scenario.line if line.name == fault.line)
            node = self._node_at(line, fault_position(fault, line))
            breakers = [(b.line, b.end) for b in self.scenario.breaker]
            for end in ("from", "to"):
                # a fault at a line's end lies beyond the current transformer, which must see it
                if node == self.terminals[line.name, end] and (line.name, end) not in breakers:
                    self.terms[line.name, end].append(("switch", len(self.switches), 1.0))
        self.fault_nodes.append(node)
        self.switches.append(Switch(node, GROUND, fault))

    def _node_at(self, line: Line, position: float) -> str:
        """Of a fault on a line; the same for positions that differ only by rounding."""
        point = min(self._fault_points(line), key=lambda p: abs(p - position))
        if point in (0.0, 1.0):
            return self.terminals[line.name, "to" if point else "from"]
        return f"{line.name}@{point!r}"

    def _check_islands(self) -> None:
        """Every bus must reach a source: elsewhere nothing fixes a voltage, or all is zero for ever."""
        joined: dict[str, set[str]] = {}
        for part in (*self.branches, *self.waves, *self.switches):
            if GROUND not in (part.start, part.end):
                joined.setdefault(part.start, set()).add(part.end)
                joined.setdefault(part.end, set()).add(part.start)
        reached: set[str] = set()
        front = [emf.node for emf in self.emfs]
        while front:
            node = front.pop()
            if node not in reached:
                reached.add(node)
                front += joined[node]
        for line in self.scenario.line:
            if line.from_bus not in reached:
                raise InputError(
                    f"bus '{line.from_bus}' reaches no source, so its voltage is undefined; "
                    "give its island a [[source]] or a line to the rest",
                    key=f"line[{line.name}].from",
                )


def fault_position(fault: Fault, line: Line) -> float:
    """From the line's ``from`` end [pu]; exactly 0 or 1 at the ends."""
    pu = fault.at_pu if fault.at_pu is not None else (fault.at_km or 0.0) / line.length_km
    return round(pu) * 1.0 if abs(pu - round(pu)) <= SAME_POINT else pu


def _bus(line: Line, end: str) -> str:
    return line.from_bus if end == "from" else line.to_bus


def _cascade(line: Line, start: str, end: str, at: float, count: int) -> list[str]:
    """Names of the nodes of ``count`` equal sections from position ``at`` on."""
    return [start, *(f"{line.name}@{at!r}#{i}" for i in range(1, count)), end]
