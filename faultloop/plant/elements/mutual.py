"""Zero-sequence coupling of two parallel circuits: of two series branches, of two Bergeron sections.

Transposed circuits meet in their zero sequence alone.  Of branches the mode's constants become 2x2 matrices
(H. W. Dommel, EMTP Theory Book, 1986, section 3.1); of waves its two travelling modes are the sum and the
difference of both circuits (ibid., section 4.1.5): the ring of the first wave of a pair keeps the sum's zero
mode, that of the second the difference's, each with its own constants.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from faultloop.jit import njit
from faultloop.plant.elements import Floats, Ints
from faultloop.plant.elements.bergeron import Waves, WaveSection
from faultloop.plant.elements.branch import Branch, Branches
from faultloop.plant.elements.series_rl import SeriesRL

ROOT_HALF = math.sqrt(0.5)


@dataclass(frozen=True)
class CoupledBranches:
    """Two series R-L with a common impedance in the zero sequence."""

    first: int
    second: int
    """Their numbers among the circuit's `passive`."""
    r: float
    """[ohm]"""
    l: float
    """[H]; both negative where the second's end is beside the first's start."""

    def coefficients(self, branches: Sequence[Branch], dt: float) -> Floats:
        """(3, 2, 2) zero-mode matrices G, K of the trapezoidal rule, K of an Euler half step; in both
        ``G = (R + 2L/dt)^-1``, the trapezoid's P is G, the half step's nothing."""
        a, b = branches[self.first], branches[self.second]
        assert isinstance(a, SeriesRL)
        assert isinstance(b, SeriesRL)
        r = np.array([[a.r[0], self.r], [self.r, b.r[0]]])
        reactive = np.array([[a.l[0], self.l], [self.l, b.l[0]]]) * 2 / dt
        g = np.linalg.inv(r + reactive)
        return np.array([g, g @ (reactive - r), g @ reactive], dtype=np.float64)

    def beside(self, branches: Sequence[Branch]) -> list[tuple[str, str, int]]:
        """Nodes between which there is a conductance for it, and its sign."""
        a, b = branches[self.first], branches[self.second]
        return [(a.start, b.start, 1), (a.start, b.end, -1), (a.end, b.start, -1), (a.end, b.end, 1)]


@dataclass(frozen=True)
class CoupledWaves:
    """Two Bergeron sections of equal zero-sequence constants; the first's `Wave` has the sum's zero mode, the
    second's the difference's."""

    first: int
    second: int
    """Their numbers among the circuit's `sections`."""
    opposite: bool
    """Whether the second's end is beside the first's start."""

    def beside(self, sections: Sequence[WaveSection]) -> list[tuple[str, str, int]]:
        """Nodes between which there is a conductance for it, and its sign."""
        a, b = sections[self.first], sections[self.second]
        near, far = (b.end, b.start) if self.opposite else (b.start, b.end)
        return [(a.start, near, 1), (a.end, far, 1)]

    def half_difference(self, sections: Sequence[WaveSection]) -> float:
        """Of both modes' y [S]: by it the voltage of one circuit drives the other's current."""
        return float(sections[self.first].wave.y[0] - sections[self.second].wave.y[0]) / 2


class Couplings(NamedTuple):
    """Constants of all."""

    branch: Ints
    """(pairs, 2) rows of the branches' arrays"""
    trapezoid: Floats
    """(pairs, 2, 3) of each of the two: G, P, K by which the other acts on it (a third: on each phase)"""
    euler: Floats
    """(pairs, 2, 3) the same of a backward-Euler half step"""
    wave: Ints
    """(pairs, 3) both waves; 1 where they run in opposite directions"""
    conductance: Floats
    """(pairs,) half the difference of the modes' y [S]"""


def coupling_constants(
    branches: Sequence[tuple[int, int]],
    matrices: Sequence[Floats],
    waves: Sequence[CoupledWaves],
    conductance: Sequence[float],
) -> Couplings:
    """``branches``: rows of each pair; ``matrices``: their `CoupledBranches.coefficients`; ``conductance``:
    of the waves, `CoupledWaves.half_difference`."""
    g, trapezoid, half = np.array(matrices, dtype=np.float64).reshape(-1, 3, 2, 2).swapaxes(0, 1) / 3
    other = ([0, 1], [1, 0])
    return Couplings(
        branch=np.array(branches, dtype=np.int64).reshape(-1, 2),
        trapezoid=np.stack([m[:, *other] for m in (g, g, trapezoid)], axis=-1),
        euler=np.stack([m[:, *other] for m in (g, np.zeros_like(g), half)], axis=-1),
        wave=np.array([[w.first, w.second, w.opposite] for w in waves], dtype=np.int64).reshape(-1, 3),
        conductance=np.array(conductance, dtype=np.float64),
    )


@njit(forceinline=True)
def zero_across(bus: Ints, v: Floats) -> float:
    """Sum of the phase voltages across a branch [V]."""
    u, w = v[bus[0]], v[bus[1]]
    return u[0] - w[0] + u[1] - w[1] + u[2] - w[2]


@njit
def coupled_currents(net: Couplings, branch: Branches, v: Floats, current: Floats) -> None:
    """What the voltage across one branch of a pair drives through the other."""
    for m in range(net.branch.shape[0]):
        for one in range(2):
            b, other = net.branch[m, one], net.branch[m, 1 - one]
            driven = net.trapezoid[m, one, 0] * zero_across(branch.bus[other], v)
            for p in range(3):
                current[b, p] += driven


@njit
def coupled_histories(
    net: Couplings, coefficient: Floats, branch: Branches, history: Floats, v: Floats, current: Floats
) -> None:
    """What each branch of a pair remembers of the other; ``coefficient`` (pairs, 2, 3)."""
    for m in range(net.branch.shape[0]):
        for one in range(2):
            b, other = net.branch[m, one], net.branch[m, 1 - one]
            i = current[other]
            remembered = coefficient[m, one, 1] * zero_across(branch.bus[other], v)
            remembered += coefficient[m, one, 2] * (i[0] + i[1] + i[2])
            for p in range(3):
                history[b, p] += remembered


@njit
def coupled_step(net: Couplings, branch: Branches, history: Floats, v: Floats, current: Floats) -> None:
    """After `branch_step`, which knew nothing of the other branch: currents and next histories."""
    for m in range(net.branch.shape[0]):
        for one in range(2):
            b, other = net.branch[m, one], net.branch[m, 1 - one]
            driven = net.trapezoid[m, one, 0] * zero_across(branch.bus[other], v)
            own = (branch.trapezoid[b, 4] + 3 * branch.trapezoid[b, 5]) * driven
            for p in range(3):
                current[b, p] += driven
                history[b, p] += own
    coupled_histories(net, net.trapezoid, branch, history, v, current)


@njit
def coupled_arrivals(net: Couplings, arriving: Floats) -> None:
    """What arrives in the sum's and the difference's zero mode, as what arrives in each circuit's."""
    for m in range(net.wave.shape[0]):
        one, other, opposite = net.wave[m]
        for end in range(2):
            total, difference = arriving[one, 4 + end], arriving[other, 4 + (end ^ opposite)]
            arriving[one, 4 + end] = ROOT_HALF * (total + difference)
            arriving[other, 4 + (end ^ opposite)] = ROOT_HALF * (total - difference)


@njit
def coupled_wave_currents(net: Couplings, waves: Waves, v: Floats, current: Floats) -> None:
    """After `wave_currents`, which took each mode's y for its circuit's own."""
    for m in range(net.wave.shape[0]):
        one, other, opposite = net.wave[m]
        for end in range(2):
            far = end ^ opposite
            u, w = v[waves.bus[one, end]], v[waves.bus[other, far]]
            a, b = (u[0] + u[1] + u[2]) / 3, (w[0] + w[1] + w[2]) / 3
            q = net.conductance[m]
            for p in range(3):
                current[2 * one + end, p] += q * (b - a)
                current[2 * other + far, p] += q * (a + b)


@njit
def coupled_push(net: Couplings, waves: Waves, ring: Floats, v: Floats, current: Floats, step: int) -> None:
    """After `wave_push`: ``u = y v + H i`` of the sum's and the difference's zero mode into the rings."""
    for m in range(net.wave.shape[0]):
        one, other, opposite = net.wave[m]
        for end in range(2):
            far = end ^ opposite
            vo, vt = v[waves.bus[one, end]], v[waves.bus[other, far]]
            io, it = current[2 * one + end], current[2 * other + far]
            a, b = (vo[0] + vo[1] + vo[2]) / 3, (vt[0] + vt[1] + vt[2]) / 3
            c, d = (io[0] + io[1] + io[2]) / 3, (it[0] + it[1] + it[2]) / 3
            for w, e, voltage, amps in ((one, end, a + b, c + d), (other, far, a - b, c - d)):
                row = waves.tap[w, 0] + (step & waves.tap[w, 1])
                ring[row, 4 + e] = ROOT_HALF * (waves.mode[w, 1, 0] * voltage + waves.mode[w, 1, 1] * amps)
