"""A circuit as arrays for the kernels, and its conductance matrix for every switch state."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from faultloop.jit import njit
from faultloop.plant.circuit import Circuit
from faultloop.plant.elements import GROUND, Floats, Ints, circulant
from faultloop.plant.elements.bergeron import Waves, wave_constants
from faultloop.plant.elements.branch import Branches, branch_constants
from faultloop.plant.elements.converter import Converters, converter_constants
from faultloop.plant.elements.emf import Emfs, emf_constants
from faultloop.plant.elements.mutual import CoupledBranches, CoupledWaves, Couplings, coupling_constants
from faultloop.plant.elements.varistor import Varistors, respond, varistor_constants
from faultloop.plant.factor import Factor, Structure, elimination_order, factorize, symbolic

LEAKAGE_S = 1e-9
"""From every phase of every bus to ground: it defines the voltage of a part that breakers have cut off."""


class Network(NamedTuple):
    """Constants.  Rows of ``v``: buses in elimination order, ground, one per source."""

    structure: Structure
    emf: Emfs
    branch: Branches
    wave: Waves
    coupling: Couplings
    varistor: Varistors
    converter: Converters
    switch_bus: Ints
    """(switches, 2) rows of v"""


class Matrix(NamedTuple):
    """The conductance matrix without its switches, and what each of these adds."""

    diagonal: Floats
    """(buses, 9)"""
    lower: Floats
    """(blocks, 9)"""
    stamp: Ints
    """(switches, 3) rows of v, and the block between them; -1: there is none"""
    conductance: Floats
    """(switches, 8, 9) by the mask of conducting poles [S]"""


@njit
def refactor(net: Network, matrix: Matrix, masks: Ints, factor: Factor) -> None:
    """``factor`` becomes that of the state in which each switch's poles ``masks`` conduct."""
    diagonal, lower = factor.inverse, factor.lower
    buses = diagonal.shape[0]
    copy_blocks(matrix.diagonal, diagonal)
    copy_blocks(matrix.lower, lower)
    for s in range(masks.shape[0]):
        y = matrix.conductance[s, masks[s]]
        k, m, at = matrix.stamp[s, 0], matrix.stamp[s, 1], matrix.stamp[s, 2]
        for c in range(9):
            factor.switch[s, c] = y[c]
            if k < buses:
                diagonal[k, c] += y[c]
            if m < buses:
                diagonal[m, c] += y[c]
            if at >= 0:
                lower[at, c] -= y[c]
    factorize(net.structure, diagonal, lower)
    if net.varistor.bus.shape[0] > 0:
        respond(net.structure, factor, net.varistor.bus)


@njit
def copy_blocks(a: Floats, b: Floats) -> None:
    """b = a, (n, 9): a slice assignment takes a second to compile."""
    for i in range(a.shape[0]):
        for c in range(9):
            b[i, c] = a[i, c]


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
        joined = [(number[a], number[b]) for a, b in circuit.joined if a in number and b in number]
        order = elimination_order(len(buses), joined)
        rows = [buses[i] for i in order] + [GROUND] + [emf.behind.start for emf in circuit.emfs]
        self.row = {name: i for i, name in enumerate(rows)}
        self.bus_count = len(buses)
        pairs = [(self.row[buses[i]], self.row[buses[j]]) for i, j in joined]
        self.structure = symbolic(len(buses), pairs)
        self._coefficients = [branch.coefficients(circuit.dt) for branch in circuit.branches]
        self._coupled_waves = [c for c in circuit.coupled if isinstance(c, CoupledWaves)]
        self._coupled_branches = [c for c in circuit.coupled if isinstance(c, CoupledBranches)]
        self._matrices = [c.coefficients(circuit.passive, circuit.dt) for c in self._coupled_branches]
        coupling = self._couple()
        waves, self.ring_slots = wave_constants(circuit.sections, self.row)
        self.network = Network(
            structure=self.structure,
            emf=emf_constants(circuit.emfs, circuit.rate),
            branch=branch_constants(circuit.branches, self._coefficients, self.row),
            wave=waves,
            coupling=coupling,
            varistor=varistor_constants(circuit.varistors, self.row),
            converter=converter_constants(
                circuit.converters,
                self.row,
                [emf.behind.start for emf in circuit.emfs],
                circuit.rate,
                circuit.frequency_hz,
            ),
            switch_bus=np.array(
                [[self.row[s.start], self.row[s.end]] for s in circuit.switches], dtype=np.int64
            ).reshape(-1, 2),
        )
        self.matrix = Matrix(*self._fixed_part(), self._stamps(), self._conductances())
        self.waves: dict[Any, tuple[Floats, Floats]] = {}
        """Voltages that components have looked at, for the next run of the same network."""

    def factor(self, masks: Sequence[int] | Ints) -> Factor:
        """The matrix with the given poles of each switch conducting (A = 1, B = 2, C = 4)."""
        factor = self.new_factors(())
        refactor(self.network, self.matrix, np.array(masks, dtype=np.int64), factor)
        return factor

    def new_factors(self, many: tuple[int, ...]) -> Factor:
        """Room for factors, ``many`` of them: an array of each part."""
        n, varistors = self.bus_count, len(self.network.varistor.bus)
        parts = ((n, 9), (len(self.structure.row), 9), (len(self.circuit.switches), 9), (varistors, 3, n, 3))
        return Factor(*(np.empty((*many, *part)) for part in parts))

    def _conductances(self) -> Floats:
        return np.array([s.conductances() for s in self.circuit.switches]).reshape(-1, 8, 9)

    def _stamps(self) -> Ints:
        stamps = []
        for start, end in self.network.switch_bus.tolist():
            between = max(start, end) < self.bus_count
            stamps.append((start, end, self._block(start, end) if between else -1))
        return np.array(stamps, dtype=np.int64).reshape(-1, 3)

    def _couple(self) -> Couplings:
        """The coupled elements' constants; each branch's own zero mode becomes that of the pair."""
        first = len(self.circuit.emfs)  # the sources' own branches come before
        rows = [(first + c.first, first + c.second) for c in self._coupled_branches]
        for pair, (g, trapezoid, half) in zip(rows, self._matrices, strict=True):
            for i, row in enumerate(pair):
                self._coefficients[row][:, 0] = g[i, i], g[i, i], trapezoid[i, i], 0.0, half[i, i]
        differences = [c.half_difference(self.circuit.sections) for c in self._coupled_waves]
        return coupling_constants(rows, self._matrices, self._coupled_waves, differences)

    def _fixed_part(self) -> tuple[Floats, Floats]:
        diagonal = np.tile((np.eye(3) * LEAKAGE_S).ravel(), (self.bus_count, 1))
        lower = np.zeros((len(self.structure.row), 9))
        for branch, coefficient in zip(self.circuit.branches, self._coefficients, strict=True):
            y = circulant(coefficient[0])
            self._stamp(diagonal, lower, self.row[branch.start], self.row[branch.end], y)
        for section in self.circuit.sections:
            for end in (section.start, section.end):
                diagonal[self.row[end]] += circulant(section.wave.y).ravel()
        for pair, matrix in zip(self._coupled_branches, self._matrices, strict=True):
            for a, b, sign in pair.beside(self.circuit.passive):
                y = circulant(np.array([sign * matrix[0, 0, 1], 0.0]))
                self._stamp_between(diagonal, lower, self.row[a], self.row[b], y)
        for pair in self._coupled_waves:
            y = circulant(np.array([pair.half_difference(self.circuit.sections), 0.0]))
            for a, b, _ in pair.beside(self.circuit.sections):
                self._stamp_between(diagonal, lower, self.row[a], self.row[b], y)
                diagonal[self.row[a]] -= y.ravel()  # each section was taken for one of its own mode
                diagonal[self.row[b]] += y.ravel()
        return diagonal, lower

    def _stamp(self, diagonal: Floats, lower: Floats, k: int, m: int, y: Floats) -> None:
        """A conductance from one node to another."""
        for row in (k, m):
            if row < self.bus_count:
                diagonal[row] += y.ravel()
        self._stamp_between(diagonal, lower, k, m, -y)

    def _stamp_between(self, diagonal: Floats, lower: Floats, k: int, m: int, y: Floats) -> None:
        """The voltage of each of two nodes drives a current out of the other."""
        if k == m:
            diagonal[k] += 2 * y.ravel()
        elif max(k, m) < self.bus_count:
            lower[self._block(k, m)] += y.ravel()

    def _block(self, k: int, m: int) -> int:
        first, last = self.structure.pointer[min(k, m) : min(k, m) + 2].tolist()
        return first + int(np.searchsorted(self.structure.row[first:last], max(k, m)))
