"""The primary system as elements between named nodes: what the solver is built from."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

from faultloop.plant.elements import GROUND
from faultloop.plant.elements.bergeron import WaveSection
from faultloop.plant.elements.branch import Branch
from faultloop.plant.elements.converter import Converter
from faultloop.plant.elements.emf import Emf
from faultloop.plant.elements.mutual import CoupledBranches, CoupledWaves
from faultloop.plant.elements.switch import Switch
from faultloop.plant.elements.varistor import Varistor

SAME_POINT = 1e-9
"""Two positions on a line closer than this, per unit, are one."""

Part = Literal["branch", "wave_start", "wave_end", "switch"]
Term = tuple[Part, int, float]
"""One summand of a line-end current: what, its index, sign."""


class Laid(NamedTuple):
    """A stretch of a line between two of its cuts, as elements."""

    start: float
    end: float
    """Positions [pu]."""
    waves: bool
    """Whether it is made of `sections`, else of `passive`."""
    first: int
    number: int
    """Of its series elements: the first, and how many."""
    nodes: list[str]
    """(number + 1,)"""
    section_km: float


@dataclass
class Circuit:
    """Nodes are named: a bus by its name, the line side of a breaker ``LINE:from``, a point on a line
    ``LINE@0.25``, an inner point of a cascade ``LINE@0.25#3``."""

    rate: int
    """Steps per second."""
    frequency_hz: float
    """Nominal; what reactances are given at."""
    base_v: float
    """Nominal voltage, line-to-line RMS."""
    emfs: list[Emf] = field(default_factory=list)
    passive: list[Branch] = field(default_factory=list)
    """The branches but for the sources' own."""
    sections: list[WaveSection] = field(default_factory=list)
    switches: list[Switch] = field(default_factory=list)
    number: dict[tuple[str, str], int] = field(default_factory=dict)
    """Of a component's switch or emf: ``("breaker", "QA")``."""
    cuts: dict[str, list[float]] = field(default_factory=dict)
    """Positions [pu] at which a line has a node, its ends included."""
    terminals: dict[tuple[str, str], str] = field(default_factory=dict)
    """Node of each line end, ``(line, "from" | "to")``: behind its breaker where it has one."""
    terms: dict[tuple[str, str], list[Term]] = field(default_factory=dict)
    """What makes up the current from the bus into each line end: the breaker's, where there is one."""
    laid: dict[str, list[Laid]] = field(default_factory=dict)
    """The stretches of each line."""
    waves: dict[tuple[str, float], int] = field(default_factory=dict)
    """How many waves a stretch is to be, by line and start, where the line does not decide alone; 0: none."""
    coupled: list[CoupledBranches | CoupledWaves] = field(default_factory=list)
    varistors: list[Varistor] = field(default_factory=list)
    converters: list[Converter] = field(default_factory=list)
    apart: set[tuple[str, float]] = field(default_factory=set)
    """Places, line and position, at which something lies in series with the line."""
    notes: list[str] = field(default_factory=list)

    @property
    def dt(self) -> float:
        """Step [s]."""
        return 1 / self.rate

    @property
    def branches(self) -> list[Branch]:
        """All, those of the sources first."""
        return [*(emf.behind for emf in self.emfs), *self.passive]

    @property
    def joined(self) -> list[tuple[str, str]]:
        """Pairs of nodes between which there is a conductance."""
        pairs = [(x.start, x.end) for x in (*self.branches, *self.switches)]
        for coupled in self.coupled:
            waves = isinstance(coupled, CoupledWaves)
            beside = coupled.beside(self.sections) if waves else coupled.beside(self.passive)
            pairs += [(a, b) for a, b, _ in beside if a != b]
        return pairs

    @property
    def buses(self) -> list[str]:
        """Every node with an unknown voltage, in order of first use."""
        known = {emf.behind.start for emf in self.emfs} | {GROUND}
        ends = [n for x in (*self.branches, *self.sections, *self.switches) for n in (x.start, x.end)]
        return [n for n in dict.fromkeys(ends) if n not in known]

    def current_row(self, kind: Part, index: int) -> int:
        """Row of `State.current`: branches, then start and end of each wave, then switches.

        A ``branch`` counts among `passive`."""
        branches, waves = len(self.emfs) + len(self.passive), len(self.sections)
        match kind:
            case "branch":
                return len(self.emfs) + index
            case "wave_start" | "wave_end":
                return branches + 2 * index + (kind == "wave_end")
            case "switch":
                return branches + 2 * waves + index

    def add_emf(self, table: str, name: str, emf: Emf) -> None:
        """A source, to be found by its table and name."""
        self.number[table, name] = len(self.emfs)
        self.emfs.append(emf)

    def add_switch(self, table: str, name: str, switch: Switch) -> int:
        """A switch, to be found by its table and name; returns its number."""
        self.number[table, name] = len(self.switches)
        self.switches.append(switch)
        return self.number[table, name]

    def add_to_lines(self, branch: Branch, lines: Iterable[str]) -> None:
        """A branch that belongs to these lines: its current is part of theirs where it is at an end."""
        if branch.start == branch.end:
            return
        for line in lines:
            for end in ("from", "to"):
                node, terms = self.terminals[line, end], self.terms[line, end]
                if node in (branch.start, branch.end) and terms[0][0] != "switch":
                    terms.append(("branch", len(self.passive), 1.0 if branch.start == node else -1.0))
        self.passive.append(branch)

    def cut(self, line: str, positions: Iterable[float]) -> None:
        """The line gets a node at each position [pu]; those that differ only by rounding are one."""
        points = self.cuts.setdefault(line, [0.0, 1.0])
        for position in positions:
            if all(abs(position - p) > SAME_POINT for p in points):
                points.append(position)
        points.sort()

    def take_apart(self, line: str, position: float) -> None:
        """The line gets two nodes at a place [pu] at which it was cut."""
        self.apart.add((line, self._point(line, position)))

    def sides(self, line: str, position: float) -> tuple[str, str]:
        """Nodes towards the ``from`` end and towards the ``to`` end of a place at which the line was cut; one
        and the same where nothing lies in series there."""
        point = self._point(line, position)
        node = f"{line}@{point!r}"
        if point in (0.0, 1.0):
            node = self.terminals[line, "to" if point else "from"]
        if (line, point) not in self.apart:
            return node, node
        inner = f"{line}@{point!r}|"
        return (inner, node) if point == 1.0 else (node, inner)

    def node_at(self, line: str, position: float) -> str:
        """Of a place [pu] at which the line was cut; of two, the one towards the middle of the line."""
        return self.sides(line, position)[position < 0.5]

    def _point(self, line: str, position: float) -> float:
        return min(self.cuts[line], key=lambda p: abs(p - position))

    def fed(self) -> set[str]:
        """The nodes that reach a source (a converter follows one), through open switches too: elsewhere
        nothing fixes a voltage, or all
        is zero for ever."""
        joined: dict[str, set[str]] = {}
        for part in (*self.branches, *self.sections, *self.switches):
            if GROUND not in (part.start, part.end):
                joined.setdefault(part.start, set()).add(part.end)
                joined.setdefault(part.end, set()).add(part.start)
        reached: set[str] = set()
        follows = {converter.emf for converter in self.converters}
        front = [emf.behind.start for k, emf in enumerate(self.emfs) if k not in follows]
        while front:
            node = front.pop()
            if node not in reached:
                reached.add(node)
                front += joined[node]
        return reached
