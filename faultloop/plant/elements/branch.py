"""Every element that is one linear branch: ``i = G v + h``, and from step to step ``h' = P v + K i``.

All three matrices are circulant, ``G x = g x + gx sum(x)``; series R-L, capacitance and resistance differ in
nothing but these numbers (H. W. Dommel, 1969), so one kernel steps them all.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple, Protocol

import numpy as np

from faultloop.jit import njit
from faultloop.plant.elements import Floats, Ints


class Branch(Protocol):
    """One between two nodes, or from a node to ground."""

    @property
    def start(self) -> str: ...
    @property
    def end(self) -> str: ...

    def coefficients(self, dt: float) -> Floats:
        """(5, 2) rows G; P, K of the trapezoidal rule; P, K of an Euler half step; columns mode 0, mode 1."""
        ...

    def admittance(self, s: complex) -> complex:
        """Positive sequence [S]; ``s`` is the derivative as the trapezoidal rule has it [1/s]."""
        ...


class Branches(NamedTuple):
    """Constants of all, the sources' own first."""

    bus: Ints
    """(branches, 2) rows of v"""
    trapezoid: Floats
    """(branches, 6) circulant (g, gx), (p, px), (k, kx)"""
    euler: Floats
    """(branches, 6) the same of a backward-Euler half step"""


def branch_constants(
    branches: Sequence[Branch], coefficients: Sequence[Floats], row: Mapping[str, int]
) -> Branches:
    """Of a circuit's branches."""
    modal = np.array(coefficients, dtype=np.float64).reshape(-1, 5, 2)
    pairs = np.stack([modal[..., 1], (modal[..., 0] - modal[..., 1]) / 3], axis=-1)
    return Branches(
        bus=np.array([[row[b.start], row[b.end]] for b in branches], dtype=np.int64).reshape(-1, 2),
        trapezoid=np.ascontiguousarray(pairs[:, [0, 1, 2]]).reshape(-1, 6),
        euler=np.ascontiguousarray(pairs[:, [0, 3, 4]]).reshape(-1, 6),
    )


@njit(forceinline=True)
def branch_inject(net: Branches, history: Floats, v: Floats, sources: int) -> None:
    """The currents that all histories put into the buses, into the buses' rows of v, from nothing."""
    bus = net.bus
    ground = v.shape[0] - sources - 1
    for k in range(ground):
        for p in range(3):
            v[k, p] = 0.0
    for s in range(sources):
        m, g = bus[s, 1], net.trapezoid[s, 0]
        for p in range(3):
            v[m, p] += g * v[ground + 1 + s, p] + history[s, p]
    for b in range(sources, bus.shape[0]):
        k, m = bus[b, 0], bus[b, 1]
        for p in range(3):
            v[k, p] -= history[b, p]
            v[m, p] += history[b, p]
    for p in range(3):
        v[ground, p] = 0.0


@njit(forceinline=True)
def branch_step(net: Branches, history: Floats, v: Floats, current: Floats) -> None:
    """Currents, and the trapezoidal histories for the next step."""
    for b in range(net.bus.shape[0]):
        k, m = net.bus[b, 0], net.bus[b, 1]
        d0, d1, d2 = v[k, 0] - v[m, 0], v[k, 1] - v[m, 1], v[k, 2] - v[m, 2]
        d = d0 + d1 + d2
        g, gd = net.trapezoid[b, 0], net.trapezoid[b, 1] * d
        i0 = g * d0 + gd + history[b, 0]
        i1 = g * d1 + gd + history[b, 1]
        i2 = g * d2 + gd + history[b, 2]
        p, k1 = net.trapezoid[b, 2], net.trapezoid[b, 4]
        common = net.trapezoid[b, 3] * d + net.trapezoid[b, 5] * (i0 + i1 + i2)
        history[b, 0] = p * d0 + k1 * i0 + common
        history[b, 1] = p * d1 + k1 * i1 + common
        history[b, 2] = p * d2 + k1 * i2 + common
        current[b, 0], current[b, 1], current[b, 2] = i0, i1, i2


@njit
def branch_histories(bus: Ints, coefficient: Floats, history: Floats, v: Floats, current: Floats) -> None:
    """Histories ``P v + K i`` of the present voltages and currents; ``coefficient`` (branches, 6)."""
    for b in range(bus.shape[0]):
        u, w, i = v[bus[b, 0]], v[bus[b, 1]], current[b]
        d = u[0] - w[0] + u[1] - w[1] + u[2] - w[2]
        common = coefficient[b, 3] * d + coefficient[b, 5] * (i[0] + i[1] + i[2])
        for p in range(3):
            own = coefficient[b, 2] * (u[p] - w[p]) + coefficient[b, 4] * i[p]
            history[b, p] = own + common


@njit
def branch_currents(net: Branches, history: Floats, v: Floats, current: Floats) -> None:
    """``G v + h``."""
    for b in range(net.bus.shape[0]):
        u, w = v[net.bus[b, 0]], v[net.bus[b, 1]]
        common = net.trapezoid[b, 1] * (u[0] - w[0] + u[1] - w[1] + u[2] - w[2])
        for p in range(3):
            current[b, p] = net.trapezoid[b, 0] * (u[p] - w[p]) + common + history[b, p]
