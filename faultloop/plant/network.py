"""A circuit as arrays for the kernels, and its conductance matrix for every switch state."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from faultloop.plant.circuit import Circuit
from faultloop.plant.elements import GROUND, Floats, Ints, circulant
from faultloop.plant.elements.bergeron import Waves, wave_constants
from faultloop.plant.elements.branch import Branches, branch_constants
from faultloop.plant.elements.emf import Emfs, emf_constants
from faultloop.plant.factor import Factor, Structure, elimination_order, factorize, symbolic

LEAKAGE_S = 1e-9
"""From every phase of every bus to ground: it defines the voltage of a part that breakers have cut off."""


class Network(NamedTuple):
    """Constants.  Rows of ``v``: buses in elimination order, ground, one per source."""

    structure: Structure
    emf: Emfs
    branch: Branches
    wave: Waves
    switch_bus: Ints
    """(switches, 2) rows of v"""


class Model:
    """The circuit's constants and matrices.

    Attributes
    ----------
    network : the kernels' constants.
    row : row of ``v`` of every node.
    """

    def __init__(self, circuit: Circuit) -> None:
        self.circuit = circuit
        buses = circuit.buses
        number = {name: i for i, name in enumerate(buses)}
        joined = [
            (number[x.start], number[x.end])
            for x in (*circuit.branches, *circuit.switches)
            if x.start in number and x.end in number
        ]
        order = elimination_order(len(buses), joined)
        rows = [buses[i] for i in order] + [GROUND] + [emf.behind.start for emf in circuit.emfs]
        self.row = {name: i for i, name in enumerate(rows)}
        self.bus_count = len(buses)
        pairs = [(self.row[buses[i]], self.row[buses[j]]) for i, j in joined]
        self.structure = symbolic(len(buses), pairs)
        self._coefficients = [branch.coefficients(circuit.dt) for branch in circuit.branches]
        waves, self.ring_slots = wave_constants(circuit.sections, self.row)
        self.network = Network(
            structure=self.structure,
            emf=emf_constants(circuit.emfs, circuit.rate),
            branch=branch_constants(circuit.branches, self._coefficients, self.row),
            wave=waves,
            switch_bus=np.array(
                [[self.row[s.start], self.row[s.end]] for s in circuit.switches], dtype=np.int64
            ).reshape(-1, 2),
        )
        self._fixed = self._fixed_part()
        self._factors: dict[tuple[int, ...], Factor] = {}

    def factor(self, masks: tuple[int, ...]) -> Factor:
        """The matrix with the given poles of each switch conducting (A = 1, B = 2, C = 4), factored once."""
        if masks not in self._factors:
            diagonal, lower = (part.copy() for part in self._fixed)
            switch = np.zeros((len(masks), 9))
            for i, (s, mask) in enumerate(zip(self.circuit.switches, masks, strict=True)):
                y = s.conductance(mask)
                switch[i] = y.ravel()
                self._stamp(diagonal, lower, self.row[s.start], self.row[s.end], y)
            factorize(self.structure, diagonal, lower)
            self._factors[masks] = Factor(diagonal, lower, switch)
        return self._factors[masks]

    def _fixed_part(self) -> tuple[Floats, Floats]:
        diagonal = np.tile((np.eye(3) * LEAKAGE_S).ravel(), (self.bus_count, 1))
        lower = np.zeros((len(self.structure.row), 9))
        for branch, coefficient in zip(self.circuit.branches, self._coefficients, strict=True):
            y = circulant(coefficient[0])
            self._stamp(diagonal, lower, self.row[branch.start], self.row[branch.end], y)
        for section in self.circuit.sections:
            for end in (section.start, section.end):
                diagonal[self.row[end]] += circulant(section.wave.y).ravel()
        return diagonal, lower

    def _stamp(
        self,
        diagonal: Floats,
        lower: Floats,
        k: int,
        m: int,
        y: Floats,
    ) -> None:
        for row in (k, m):
            if row < self.bus_count:
                diagonal[row] += y.ravel()
        if max(k, m) < self.bus_count:
            first, last = self.structure.pointer[min(k, m) : min(k, m) + 2]
            at = first + int(np.searchsorted(self.structure.row[first:last], max(k, m)))
            lower[at] -= y.ravel()
