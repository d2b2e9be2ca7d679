"""The sinusoidal steady state of the discrete equations, and the state that an eternal run would be in.

Before the first fault everything is balanced - sources, transposed lines, closed breakers - so one complex
number per bus, positive sequence, is the whole solution; sources of several frequencies superpose.  The step
matters: to the trapezoidal rule an inductance is ``j (2/dt) tan(w dt/2) L``, and a travel time is what its
interpolation makes of it.  With those, the first samples already are the steady state, to rounding.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from faultloop.errors import InputError
from faultloop.plant.elements import GROUND, Complex
from faultloop.plant.elements.switch import CONTACT_OHM
from faultloop.plant.network import LEAKAGE_S, Model

RESONANT = 100.0
"""A bus at more than this many times the largest source is at a resonance."""
DENSE = 200
"""Most buses for which a dense solution is quicker than loading a sparse solver."""
ROTATION = np.exp(-2j * np.pi / 3 * np.arange(3))
"""Phases A, B, C of a positive-sequence phasor."""


@dataclass(frozen=True)
class Steady:
    """Peak phasors of phase A at step 0, for one frequency."""

    angle: float
    """Turn per step [rad]."""
    v: Complex
    """(rows of v,) [V]"""
    current: Complex
    """(rows of current,) [A]"""


def steady_states(model: Model) -> list[Steady]:
    """One for each distinct source frequency.  Raises InputError where the network resonates undamped."""
    frequencies = sorted({emf.frequency_hz for emf in model.circuit.emfs})
    return [solve_at(model, frequency) for frequency in frequencies]


def solve_at(model: Model, frequency: float) -> Steady:
    """Of the sources of that frequency alone.  Raises InputError where the network resonates undamped."""
    circuit, row = model.circuit, model.row
    angle = 2 * np.pi * frequency * circuit.dt
    v = np.zeros(len(row), dtype=complex)
    for emf in circuit.emfs:
        if emf.frequency_hz == frequency:
            v[row[emf.behind.start]] = emf.amplitude * np.exp(1j * emf.phase)
    n = model.bus_count
    injected = np.zeros(n, dtype=complex)
    inner = []
    for i, j, y in _admittances(model, angle):
        if i < n and j < n:
            inner.append((i, j, y))
        elif i < n:
            injected[i] -= y * v[j]
    v[:n] = _linear_solution(inner, injected)
    if not np.abs(v).max() < RESONANT * max(emf.amplitude for emf in circuit.emfs):
        raise InputError(
            f"at {frequency:g} Hz the network is at an undamped resonance and has no steady state; "
            "give its lines and sources some resistance",
            key="system.frequency_hz",
        )
    return Steady(angle, v, _currents(model, angle, v))


def _linear_solution(entries: list[tuple[int, int, complex]], right: Complex) -> Complex:
    """Of the sparse system with the given entries; NaN where it is singular."""
    i, j, y = (np.array(part) for part in zip(*entries, strict=True))
    n = len(right)
    try:
        if n <= DENSE:  # importing scipy.sparse takes 0.25 s
            matrix = np.zeros((n, n), dtype=complex)
            np.add.at(matrix, (i, j), y)
            return np.asarray(np.linalg.solve(matrix, right), dtype=np.complex128)
        from scipy.sparse import coo_array
        from scipy.sparse.linalg import splu

        return splu(coo_array((y, (i, j)), shape=(n, n)).tocsc()).solve(right)
    except (np.linalg.LinAlgError, RuntimeError):
        return np.full(n, np.nan, dtype=complex)


def _admittances(model: Model, angle: float) -> Iterator[tuple[int, int, complex]]:
    """(row, row, admittance) of every part; duplicates add up."""
    circuit, row = model.circuit, model.row
    for bus in range(model.bus_count):
        yield bus, bus, LEAKAGE_S
    for branch in circuit.branches:
        y = branch.admittance(derivative(angle, circuit.dt))
        yield from _between(row[branch.start], row[branch.end], y)
    for switch in circuit.switches:
        if switch.closed:
            yield from _between(row[switch.start], row[switch.end], 1 / CONTACT_OHM)
    for section in circuit.sections:
        own, mutual = section.admittance(angle)
        k, m = row[section.start], row[section.end]
        yield from ((k, k, own), (m, m, own), (k, m, mutual), (m, k, mutual))


def _between(k: int, m: int, y: complex) -> Iterator[tuple[int, int, complex]]:
    yield from ((k, k, y), (m, m, y), (k, m, -y), (m, k, -y))


def derivative(angle: float, dt: float) -> complex:
    """What the trapezoidal rule makes of d/dt at ``angle`` per step [1/s]."""
    return complex(2j / dt * np.tan(angle / 2))


def _currents(model: Model, angle: float, v: Complex) -> Complex:
    """In the order of `State.current`."""
    circuit, row = model.circuit, model.row
    out: list[complex] = []
    for branch in circuit.branches:
        y = branch.admittance(derivative(angle, circuit.dt))
        out.append(y * (v[row[branch.start]] - v[row[branch.end]]))
    for section in circuit.sections:
        own, mutual = section.admittance(angle)
        k, m = v[row[section.start]], v[row[section.end]]
        out += [own * k + mutual * m, mutual * k + own * m]
    for switch in circuit.switches:
        across = v[row[switch.start]] - v[row[switch.end]]
        out.append(across / CONTACT_OHM if switch.closed else 0j)
    return np.array(out)


def voltage(model: Model, states: Sequence[Steady], node: str, steps: NDArray[np.int64]) -> Complex:
    """Phase A's voltage at a node as an analytic signal over steps [V]: its real part is the wave."""
    total = sum(s.v[model.row[node]] * np.exp(1j * s.angle * steps) for s in states)
    return np.asarray(total if node != GROUND else 0 * steps, dtype=complex)
