"""Travelling waves: the two ends of a Bergeron section meet only in what was sent a travel time ago.

The ends' phase values go through Clarke's transformation (alpha, beta, zero), in which a transposed line is
three single-phase ones, the aerial two alike.  `faultloop.plant.lines.Wave` has the equations.
"""

from __future__ import annotations

import math

import numpy as np

from faultloop.jit import njit
from faultloop.plant.elements import HALF_ROOT_3, Network, State
from faultloop.plant.lines import TAPS


@njit(forceinline=True)
def wave_histories(net: Network, state: State, step: int) -> None:
    """What arrives at both ends of every wave at a step."""
    ring = state.ring
    for w in range(net.wave_tap.shape[0]):
        offset, mask = net.wave_tap[w, 0], net.wave_tap[w, 1]
        a, b, c, d = 0.0, 0.0, 0.0, 0.0
        zero_start, zero_end = 0.0, 0.0
        at, at_zero = step - net.wave_tap[w, 2], step - net.wave_tap[w, 3]
        for t in range(TAPS):
            row, weight = offset + ((at - t) & mask), net.wave[w, 0, 4 + t]
            a += weight * ring[row, 0]
            b += weight * ring[row, 1]
            c += weight * ring[row, 2]
            d += weight * ring[row, 3]
            row, weight = offset + ((at_zero - t) & mask), net.wave[w, 1, 4 + t]
            zero_start += weight * ring[row, 4]
            zero_end += weight * ring[row, 5]
        far, near = net.wave[w, 0, 2], net.wave[w, 0, 3]
        h = state.wave_history[w]
        h[0] = -far * c - near * a
        h[1] = -far * d - near * b
        h[2] = -far * a - near * c
        h[3] = -far * b - near * d
        far, near = net.wave[w, 1, 2], net.wave[w, 1, 3]
        h[4] = -far * zero_end - near * zero_start
        h[5] = -far * zero_start - near * zero_end


@njit
def wave_histories_at(net: Network, state: State, now: float, newest: int) -> None:
    """The same at a time ``now`` [steps] off the grid: by a cubic through the four nearest steps that are
    known, the last of them ``newest``."""
    u = np.empty(6)
    for w in range(net.wave_tap.shape[0]):
        for mode in range(2):
            time = now - net.wave[w, mode, 8]
            base = min(int(math.floor(time)) - 1, newest - 3)
            x = time - base
            weight = (
                -(x - 1) * (x - 2) * (x - 3) / 6,
                x * (x - 2) * (x - 3) / 2,
                -x * (x - 1) * (x - 3) / 2,
                x * (x - 1) * (x - 2) / 6,
            )
            for c in range(4 * mode, 4 + 2 * mode):
                u[c] = 0.0
                for t in range(TAPS):
                    row = net.wave_tap[w, 0] + ((base + t) & net.wave_tap[w, 1])
                    u[c] += weight[t] * state.ring[row, c]
        for c in range(6):
            mode = c // 4
            other = c ^ 2 if mode == 0 else c ^ 1
            state.wave_history[w, c] = -net.wave[w, mode, 2] * u[other] - net.wave[w, mode, 3] * u[c]


@njit(forceinline=True)
def wave_inject(net: Network, state: State) -> None:
    """What arrives at the ends, as currents out of their buses, into the buses' rows of v."""
    v = state.v
    for w in range(net.wave_bus.shape[0]):
        for end in range(2):
            k = net.wave_bus[w, end]
            alpha, beta = state.wave_history[w, 2 * end], state.wave_history[w, 2 * end + 1]
            zero = state.wave_history[w, 4 + end]
            v[k, 0] -= alpha + zero
            v[k, 1] -= zero - 0.5 * alpha + HALF_ROOT_3 * beta
            v[k, 2] -= zero - 0.5 * alpha - HALF_ROOT_3 * beta


@njit(forceinline=True)
def wave_currents(net: Network, state: State) -> None:
    """Phase currents into both ends of every wave."""
    first = net.branch_bus.shape[0]
    for w in range(net.wave_bus.shape[0]):
        y1, y0 = net.wave[w, 0, 0], net.wave[w, 1, 0]
        for end in range(2):
            v = state.v[net.wave_bus[w, end]]
            i = state.current[first + 2 * w + end]
            alpha = y1 * ((2 * v[0] - v[1] - v[2]) / 3) + state.wave_history[w, 2 * end]
            beta = y1 * ((v[1] - v[2]) / (2 * HALF_ROOT_3)) + state.wave_history[w, 2 * end + 1]
            zero = y0 * ((v[0] + v[1] + v[2]) / 3) + state.wave_history[w, 4 + end]
            i[0] = alpha + zero
            i[1] = zero - 0.5 * alpha + HALF_ROOT_3 * beta
            i[2] = zero - 0.5 * alpha - HALF_ROOT_3 * beta


@njit(forceinline=True)
def wave_push(net: Network, state: State, step: int) -> None:
    """``u = y v + H i`` of a step into the rings (as a sum of phase values: the transformation is linear)."""
    first = net.branch_bus.shape[0]
    for w in range(net.wave_bus.shape[0]):
        y1, h1, y0, h0 = net.wave[w, 0, 0], net.wave[w, 0, 1], net.wave[w, 1, 0], net.wave[w, 1, 1]
        row = state.ring[net.wave_tap[w, 0] + (step & net.wave_tap[w, 1])]
        for end in range(2):
            v = state.v[net.wave_bus[w, end]]
            i = state.current[first + 2 * w + end]
            a, b, c = y1 * v[0] + h1 * i[0], y1 * v[1] + h1 * i[1], y1 * v[2] + h1 * i[2]
            row[2 * end] = (2 * a - b - c) / 3
            row[2 * end + 1] = (b - c) / (2 * HALF_ROOT_3)
            row[4 + end] = (y0 * (v[0] + v[1] + v[2]) + h0 * (i[0] + i[1] + i[2])) / 3
