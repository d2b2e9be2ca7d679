"""A circuit as arrays for the kernels, and its conductance matrix for every switch state."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from faultloop.plant.circuit import GROUND, Branch, Circuit, Switch, WaveSection
from faultloop.plant.elements import EMF_BLOCK, Network, State
from faultloop.plant.factor import Factor, elimination_order, factorize, symbolic
from faultloop.plant.lines import Pair

CONTACT_OHM = 1e-4
"""Of a closed pole, and the least of a fault from phase to common point and from there to ground."""
LEAKAGE_S = 1e-9
"""From every phase of every bus to ground: it defines the voltage of a part that breakers have cut off."""
RING_MARGIN = 8
"""Slots beyond the travel time: four taps, the present step and a trial one."""


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
        rows = [buses[i] for i in order] + [GROUND] + [emf.node for emf in circuit.emfs]
        self.row = {name: i for i, name in enumerate(rows)}
        self.bus_count = len(buses)
        pairs = [(self.row[buses[i]], self.row[buses[j]]) for i, j in joined]
        self.structure = symbolic(len(buses), pairs)
        self._coefficients = [branch_coefficients(b, circuit.dt) for b in circuit.branches]
        self.ring_slots, taps = self._rings()
        self.network = self._network(taps)
        self._fixed = self._fixed_part()
        self._factors: dict[tuple[int, ...], Factor] = {}

    def factor(self, masks: tuple[int, ...]) -> Factor:
        """The matrix with the given poles of each switch conducting (A = 1, B = 2, C = 4), factored once."""
        if masks not in self._factors:
            diagonal, lower = (part.copy() for part in self._fixed)
            switch = np.zeros((len(masks), 9))
            for i, (s, mask) in enumerate(zip(self.circuit.switches, masks, strict=True)):
                y = switch_conductance(s, mask)
                switch[i] = y.ravel()
                self._stamp(diagonal, lower, self.row[s.start], self.row[s.end], y)
            factorize(self.structure, diagonal, lower)
            self._factors[masks] = Factor(diagonal, lower, switch)
        return self._factors[masks]

    def _fixed_part(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        diagonal = np.tile((np.eye(3) * LEAKAGE_S).ravel(), (self.bus_count, 1))
        lower = np.zeros((len(self.structure.row), 9))
        for branch, coefficient in zip(self.circuit.branches, self._coefficients, strict=True):
            y = circulant(coefficient[0])
            self._stamp(diagonal, lower, self.row[branch.start], self.row[branch.end], y)
        for section in self.circuit.waves:
            for end in (section.start, section.end):
                diagonal[self.row[end]] += circulant(section.wave.y).ravel()
        return diagonal, lower

    def _stamp(
        self,
        diagonal: NDArray[np.float64],
        lower: NDArray[np.float64],
        k: int,
        m: int,
        y: NDArray[np.float64],
    ) -> None:
        for row in (k, m):
            if row < self.bus_count:
                diagonal[row] += y.ravel()
        if max(k, m) < self.bus_count:
            first, last = self.structure.pointer[min(k, m) : min(k, m) + 2]
            at = first + int(np.searchsorted(self.structure.row[first:last], max(k, m)))
            lower[at] -= y.ravel()

    def _rings(self) -> tuple[int, NDArray[np.int64]]:
        """Total ring slots, and for each wave: offset, mask, delay of the newest tap of modes 1 and 0."""
        taps, offset = [], 0
        for section in self.circuit.waves:
            size = 1 << int(section.wave.newest.max() + RING_MARGIN).bit_length()
            taps.append([offset, size - 1, section.wave.newest[1], section.wave.newest[0]])
            offset += size
        return offset, np.array(taps, dtype=np.int64).reshape(-1, 4)

    def _network(self, taps: NDArray[np.int64]) -> Network:
        circuit, row = self.circuit, self.row
        modal = np.array(self._coefficients, dtype=np.float64).reshape(-1, 5, 2)
        pairs = np.stack([modal[..., 1], (modal[..., 0] - modal[..., 1]) / 3], axis=-1)
        turn = np.arange(EMF_BLOCK) * 2 * np.pi * circuit.dt
        angles = np.array([emf.frequency_hz for emf in circuit.emfs])[:, None] * turn

        def ends(parts: list[Branch] | list[WaveSection] | list[Switch]) -> NDArray[np.int64]:
            return np.array([[row[x.start], row[x.end]] for x in parts], dtype=np.int64).reshape(-1, 2)

        return Network(
            structure=self.structure,
            emf=np.array([[e.amplitude, e.frequency_hz, e.phase] for e in circuit.emfs]),
            emf_turn=np.stack([np.cos(angles), np.sin(angles)], axis=-1),
            branch_bus=ends(circuit.branches),
            trapezoid=np.ascontiguousarray(pairs[:, [0, 1, 2]]).reshape(-1, 6),
            euler=np.ascontiguousarray(pairs[:, [0, 3, 4]]).reshape(-1, 6),
            wave_bus=ends(circuit.waves),
            wave_tap=taps,
            wave=np.array([wave_constants(s) for s in circuit.waves]).reshape(-1, 2, 9),
            switch_bus=ends(circuit.switches),
            rate=np.array([float(circuit.rate)]),
        )


def renew_switch_currents(model: Model, factor: Factor, state: State) -> None:
    """Brings the currents through poles and faults up to the present voltages (as the kernel does only where
    it needs them)."""
    ends = model.network.switch_bus
    across = state.v[ends[:, 0]] - state.v[ends[:, 1]]
    count = len(ends)
    if count:
        state.current[-count:] = np.einsum("spq,sq->sp", factor.switch.reshape(count, 3, 3), across)


def branch_coefficients(branch: Branch, dt: float) -> NDArray[np.float64]:
    """(5, 2) rows G; P, K of the trapezoidal rule; P, K of an Euler half step; columns mode 0, mode 1."""
    zero = np.zeros(2)
    if branch.c is not None:
        g = 2 * branch.c / dt
        return np.array([g, -g, np.where(g > 0, -1.0, 0.0), -g, zero])
    reactive = 2 * branch.l / dt
    g = 1 / (branch.r + reactive)
    inductive = branch.l > 0  # a resistance alone has no history
    return np.array(
        [
            g,
            np.where(inductive, g, 0.0),
            np.where(inductive, g * (reactive - branch.r), 0.0),
            zero,
            g * reactive,
        ]
    )


def wave_constants(section: WaveSection) -> NDArray[np.float64]:
    """(2, 9), modes 1 and 0, as `Network.wave`."""
    w = section.wave
    columns = [w.y, w.h, (1 + w.h) / 2, (1 - w.h) / 2, *w.weights.T, w.delay]
    return np.stack(columns, axis=1)[::-1]


def circulant(modes: Pair) -> NDArray[np.float64]:
    """(3, 3) matrix with the given eigenvalues of zero and positive sequence."""
    return np.eye(3) * modes[1] + (modes[0] - modes[1]) / 3


def switch_conductance(switch: Switch, mask: int) -> NDArray[np.float64]:
    """(3, 3) between the ends of a switch, for its conducting poles [S].

    A fault is a star of ``resistance_ohm``, its common point to ground by ``ground_ohm`` and eliminated."""
    on = np.array([mask >> p & 1 for p in range(3)], dtype=np.float64)
    if switch.fault is None:
        return np.diag(on / CONTACT_OHM)
    star = on / max(switch.fault.resistance_ohm, CONTACT_OHM)
    ground = 1 / max(switch.fault.ground_ohm, CONTACT_OHM) if switch.fault.type.endswith("G") else 0.0
    if not mask or (total := star.sum() + ground) == 0:
        return np.zeros((3, 3))
    return np.diag(star) - np.outer(star, star) / total
