"""The circuit as arrays, and the elements that are one branch: sources, R-L and capacitive branches.

A branch between two buses is ``i = G v + h``; with a series R-L and the trapezoidal rule
``G = 1 / (R + 2L/dt)`` and, from step to step, ``h' = G v + G (2L/dt - R) i``; with a capacitor
``G = 2C/dt`` and ``h' = -G v - i``.  So every branch has ``h' = P v + K i``.  All three matrices are
circulant: ``G x = g x + gx sum(x)``.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from faultloop.jit import njit
from faultloop.plant.factor import Structure

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

HALF_ROOT_3 = math.sqrt(3) / 2
EMF_BLOCK = 32
"""Steps between exact sines; within a block the phasor turns by a table: random access and no drift."""


class Network(NamedTuple):
    """Constants of the circuit.  Rows of ``v``: buses in elimination order, ground, one per source."""

    structure: Structure
    emf: Floats
    """(sources, 3) amplitude [V peak], frequency [Hz], phase [rad]; its branch to the bus has its number"""
    emf_turn: Floats
    """(sources, EMF_BLOCK, 2) cos, sin of the angle turned in k steps"""
    branch_bus: Ints
    """(branches, 2) rows of v"""
    trapezoid: Floats
    """(branches, 6) circulant (g, gx), (p, px), (k, kx): ``G x = g x + gx sum(x)``"""
    euler: Floats
    """(branches, 6) the same of a backward-Euler half step"""
    wave_bus: Ints
    """(waves, 2) rows of v"""
    wave_tap: Ints
    """(waves, 4) ring offset, ring mask, delay of the newest tap of modes 1 and 0"""
    wave: Floats
    """(waves, 2, 9) modes 1 and 0: y [S], H, (1+H)/2, (1-H)/2, four weights, delay [steps]"""
    switch_bus: Ints
    """(switches, 2) rows of v"""
    rate: Floats
    """(1,) steps per second"""


class State(NamedTuple):
    """All that changes from step to step, views of one buffer; rows as in `Network`."""

    v: Floats
    """(buses + 1 + sources, 3) [V]"""
    current: Floats
    """(branches + 2 waves + switches, 3): branches, start and end of each wave, switches [A]"""
    history: Floats
    """(branches, 3) [A]"""
    ring: Floats
    """(slots, 6) past ``u = y v + H i``: alpha, beta of a wave's start, of its end, zero of both [A]"""
    emf: Floats
    """(sources, 3) cos and sin at the first step of a block, and that block's number"""
    lowpass: Floats
    """(relays, 6, sections, 2)"""
    old_v: Floats
    """v and current one step ago, or at an instant in the step, kept while a pole waits for its zero"""
    old_current: Floats
    half_v: Floats
    """v and current half a step ago, in a commutation"""
    half_current: Floats
    wave_history: Floats
    """(waves, 6) [A], modal, order as in ring"""
    measured: Floats
    """(relays, 6)"""


@njit(forceinline=True)
def renew_emf(net: Network, state: State, step: int) -> None:
    """Source voltages of a step into their rows of v."""
    block, turn = step // EMF_BLOCK, step % EMF_BLOCK
    for s in range(net.emf.shape[0]):
        if state.emf[s, 2] != block:
            angle = emf_angle(net, s, float(block * EMF_BLOCK))
            state.emf[s, 0], state.emf[s, 1] = math.cos(angle), math.sin(angle)
            state.emf[s, 2] = block
        c, d = state.emf[s, 0], state.emf[s, 1]
        e, f = net.emf_turn[s, turn, 0], net.emf_turn[s, turn, 1]
        put_emf(net, state, s, c * e - d * f, d * e + c * f)


@njit
def exact_emf(net: Network, state: State, time: float) -> None:
    """Source voltages at any time [steps] into their rows of v."""
    for s in range(net.emf.shape[0]):
        angle = emf_angle(net, s, time)
        put_emf(net, state, s, math.cos(angle), math.sin(angle))


@njit(forceinline=True)
def emf_angle(net: Network, s: int, time: float) -> float:
    """Phase A's angle at a time [steps]; whole cycles are taken out first, so it never loses digits."""
    rate = net.rate[0]
    return 2 * math.pi * ((net.emf[s, 1] * time % rate) / rate) + net.emf[s, 2]


@njit(forceinline=True)
def put_emf(net: Network, state: State, s: int, re: float, im: float) -> None:
    """Three balanced phases."""
    row = state.v.shape[0] - net.emf.shape[0] + s
    amplitude = net.emf[s, 0]
    state.v[row, 0] = amplitude * re
    state.v[row, 1] = amplitude * (HALF_ROOT_3 * im - 0.5 * re)
    state.v[row, 2] = -amplitude * (HALF_ROOT_3 * im + 0.5 * re)


@njit(forceinline=True)
def inject(net: Network, state: State) -> None:
    """The currents that all histories put into the buses, into the buses' rows of v."""
    v, h, bus = state.v, state.history, net.branch_bus
    sources = net.emf.shape[0]
    ground = v.shape[0] - sources - 1
    for k in range(ground):
        for p in range(3):
            v[k, p] = 0.0
    for s in range(sources):
        m, g = bus[s, 1], net.trapezoid[s, 0]
        for p in range(3):
            v[m, p] += g * v[ground + 1 + s, p] + h[s, p]
    for b in range(sources, bus.shape[0]):
        k, m = bus[b, 0], bus[b, 1]
        for p in range(3):
            v[k, p] -= h[b, p]
            v[m, p] += h[b, p]
    for p in range(3):
        v[ground, p] = 0.0


@njit(forceinline=True)
def branch_step(net: Network, state: State) -> None:
    """Currents, and the trapezoidal histories for the next step."""
    v, coefficient = state.v, net.trapezoid
    for b in range(net.branch_bus.shape[0]):
        k, m = net.branch_bus[b, 0], net.branch_bus[b, 1]
        d0, d1, d2 = v[k, 0] - v[m, 0], v[k, 1] - v[m, 1], v[k, 2] - v[m, 2]
        d = d0 + d1 + d2
        g, gd = coefficient[b, 0], coefficient[b, 1] * d
        i0 = g * d0 + gd + state.history[b, 0]
        i1 = g * d1 + gd + state.history[b, 1]
        i2 = g * d2 + gd + state.history[b, 2]
        p, k1 = coefficient[b, 2], coefficient[b, 4]
        common = coefficient[b, 3] * d + coefficient[b, 5] * (i0 + i1 + i2)
        state.history[b, 0] = p * d0 + k1 * i0 + common
        state.history[b, 1] = p * d1 + k1 * i1 + common
        state.history[b, 2] = p * d2 + k1 * i2 + common
        state.current[b, 0], state.current[b, 1], state.current[b, 2] = i0, i1, i2


@njit
def branch_histories(net: Network, state: State, coefficient: Floats) -> None:
    """Histories ``P v + K i`` of the present voltages and currents; ``coefficient`` (branches, 6)."""
    for b in range(net.branch_bus.shape[0]):
        v, w, i = state.v[net.branch_bus[b, 0]], state.v[net.branch_bus[b, 1]], state.current[b]
        d = v[0] - w[0] + v[1] - w[1] + v[2] - w[2]
        common = coefficient[b, 3] * d + coefficient[b, 5] * (i[0] + i[1] + i[2])
        for p in range(3):
            own = coefficient[b, 2] * (v[p] - w[p]) + coefficient[b, 4] * i[p]
            state.history[b, p] = own + common


@njit
def branch_currents(net: Network, state: State) -> None:
    """``G v + h``."""
    for b in range(net.branch_bus.shape[0]):
        v, w = state.v[net.branch_bus[b, 0]], state.v[net.branch_bus[b, 1]]
        common = net.trapezoid[b, 1] * (v[0] - w[0] + v[1] - w[1] + v[2] - w[2])
        for p in range(3):
            state.current[b, p] = net.trapezoid[b, 0] * (v[p] - w[p]) + common + state.history[b, p]
