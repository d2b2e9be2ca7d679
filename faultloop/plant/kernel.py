"""The time step: trapezoidal companion models, travelling waves, and the instants at which a switch acts.

Per step (H. W. Dommel, IEEE Trans. PAS-88, 1969): the histories of all branches and lines are injected into
the buses, the voltages solved, the histories renewed.  A branch between two buses is ``i = G v + h``; with a
series R-L and the trapezoidal rule ``G = 1 / (R + 2L/dt)`` and, from step to step,
``h' = G v + G (2L/dt - R) i``; with a capacitor ``G = 2C/dt``, ``h' = -G v - i``.  So every branch has
``h' = P v + K i``.

When a switch acts, one step is made of two backward-Euler steps of half the size (critical damping
adjustment, J. R. Marti and J. Lin, 1989): G is the same there, ``L / (dt/2)``, so nothing is factored anew,
and the trapezoidal rule never sees the discontinuity.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from faultloop.jit import njit
from faultloop.plant.factor import Factor, Structure, solve
from faultloop.plant.frontend import FrontEnds, convert, lowpass, measure
from faultloop.plant.lines import TAPS

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

HALF_ROOT_3 = math.sqrt(3) / 2
EMF_BLOCK = 32
"""Steps between exact sines; within a block the phasor turns by a table: random access and no drift."""
NO_CURRENT = 1e-6
"""A pole with less than this carries nothing but rounding, and opens at once [A]."""


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
    """v and current one step ago, kept while a pole waits for its current zero"""
    old_current: Floats
    wave_history: Floats
    """(waves, 6) [A], modal, order as in ring"""
    measured: Floats
    """(relays, 6)"""


class Watch(NamedTuple):
    """The clock, and the poles that wait for a current zero."""

    clock: Ints
    """(5,) step, steps per sample, step to stop at, row of the next sample, 1 while the present step has not
    been delivered to the front ends"""
    armed: NDArray[np.bool_]
    """(switches, 3)"""
    zero: Floats
    """(switches, 3) where between the state kept and the present one an armed pole's current is zero
    (0 .. 1; -1: nowhere)"""
    instant: Floats
    """(2,) when in the step a commutation happens, 0 .. 1; 1.0 where the ring's newest slot is the step's end
    (from the trial), 0.0 where it is its start"""


@njit
def run(net: Network, factor: Factor, state: State, watch: Watch, front: FrontEnds, samples: Floats) -> bool:
    """Steps to ``watch.clock[2]``, with each sample due put in ``samples`` (rows, relays, 6).  True where an
    armed pole's current crossed zero: then the last step is on trial, and has not been delivered."""
    clock = watch.clock
    if clock[4]:
        arrive(net, factor, state, watch, front, samples)
    waiting = watch.armed.any()
    if waiting:
        switch_currents(net, factor, state)
    while clock[0] < clock[2]:
        if waiting:
            keep(state)
            watch.instant[0] = 0.0
        clock[0] += 1
        clock[4] = 1
        renew_emf(net, state, clock[0])
        wave_histories(net, state, clock[0])
        inject(net, state)
        solve(net.structure, factor, state.v)
        branch_step(net, state)
        wave_currents(net, state)
        wave_push(net, state, clock[0])
        if waiting:
            switch_currents(net, factor, state)
            first = state.current.shape[0] - net.switch_bus.shape[0]
            if crossings(watch, state.old_current[first:], state.current[first:]):
                return True
        if (
            clock[0] % clock[1] == 0 or front.filtered[0]
        ):  # a call costs 60 ns: it passes a hundred array fields
            arrive(net, factor, state, watch, front, samples)
        else:
            clock[4] = 0
    return False


@njit
def commutate(net: Network, factor: Factor, state: State, watch: Watch) -> bool:
    """One step in which switches act, ``factor`` being the matrix after it, at ``watch.instant`` (0 .. 1) of
    the step; the state is the one at that instant, and is kept.  True where an armed pole's current has a
    zero in the rest of the step: then this step, too, is on trial.

    Two backward-Euler half steps go from the instant t to t + dt/2 and t + dt; the end of the step lies on
    the straight line through both, which keeps every linear equation of the network.
    """
    step, instant = watch.clock[0], watch.instant[0]
    first = state.current.shape[0] - net.switch_bus.shape[0]
    start_v, start_current = state.v.copy(), state.current.copy()
    for half in (0.5, 1.0):
        keep(state)
        branch_histories(net, state, net.euler)
        exact_emf(net, state, step + (instant + half))
        wave_histories_at(net, state, watch, half)
        inject(net, state)
        solve(net.structure, factor, state.v)
        branch_currents(net, state)
        wave_currents(net, state)
    between(state, 1.0 - 2.0 * instant)
    watch.clock[0] = step + 1
    watch.clock[4] = 1
    branch_histories(net, state, net.trapezoid)
    wave_push(net, state, step + 1)
    switch_currents(net, factor, state)
    state.old_v[:] = start_v
    state.old_current[:] = start_current
    return crossings(watch, state.old_current[first:], state.current[first:])


@njit
def go_back(state: State, watch: Watch, share: float) -> None:
    """From the end of a step on trial into it, to a share (0 .. 1) of the way from the state kept, by linear
    interpolation: good for currents of inductances and voltages of capacitances, all that Euler steps look
    back to, even where a commutation lies between."""
    watch.clock[0] -= 1
    watch.instant[0] += share * (1.0 - watch.instant[0])
    watch.instant[1] = 1.0
    between(state, share)


@njit
def keep(state: State) -> None:
    """Voltages and currents, before they are renewed."""
    for i in range(state.v.shape[0]):
        for p in range(3):
            state.old_v[i, p] = state.v[i, p]
    for i in range(state.current.shape[0]):
        for p in range(3):
            state.old_current[i, p] = state.current[i, p]


@njit
def between(state: State, share: float) -> None:
    """Voltages and currents on the line from those kept (0) to the present ones (1)."""
    for i in range(state.v.shape[0]):
        for p in range(3):
            state.v[i, p] = state.old_v[i, p] + share * (state.v[i, p] - state.old_v[i, p])
    for i in range(state.current.shape[0]):
        for p in range(3):
            old = state.old_current[i, p]
            state.current[i, p] = old + share * (state.current[i, p] - old)


@njit
def arrive(
    net: Network, factor: Factor, state: State, watch: Watch, front: FrontEnds, samples: Floats
) -> None:
    """At the end of a step: the analog front ends, and a sample where one is due."""
    clock = watch.clock
    clock[4] = 0
    due = clock[0] % clock[1] == 0
    if not (due or front.filtered[0]):
        return
    switch_currents(net, factor, state)
    measure(front, state.v, state.current, state.measured)
    if front.filtered[0]:
        lowpass(front, state.lowpass, state.measured)
    if due:
        convert(front, clock[0] // clock[1], state.measured, samples[clock[3]])
        clock[3] += 1


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
    for w in range(net.wave_bus.shape[0]):
        for end in range(2):
            k = net.wave_bus[w, end]
            alpha, beta = state.wave_history[w, 2 * end], state.wave_history[w, 2 * end + 1]
            zero = state.wave_history[w, 4 + end]
            v[k, 0] -= alpha + zero
            v[k, 1] -= zero - 0.5 * alpha + HALF_ROOT_3 * beta
            v[k, 2] -= zero - 0.5 * alpha - HALF_ROOT_3 * beta
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
def wave_histories_at(net: Network, state: State, watch: Watch, half: float) -> None:
    """The same at a time ``half`` after the instant of a commutation: off the grid, so by a cubic through the
    four nearest known steps."""
    newest = watch.clock[0] + int(watch.instant[1])
    u = np.empty(6)
    for w in range(net.wave_tap.shape[0]):
        for mode in range(2):
            time = watch.clock[0] + (watch.instant[0] + half) - net.wave[w, mode, 8]
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


@njit
def switch_currents(net: Network, factor: Factor, state: State) -> None:
    """Through every pole and fault."""
    i = state.current[state.current.shape[0] - net.switch_bus.shape[0] :]
    for s in range(net.switch_bus.shape[0]):
        v, w, y = state.v[net.switch_bus[s, 0]], state.v[net.switch_bus[s, 1]], factor.switch[s]
        d0, d1, d2 = v[0] - w[0], v[1] - w[1], v[2] - w[2]
        for p in range(3):
            i[s, p] = y[3 * p] * d0 + y[3 * p + 1] * d1 + y[3 * p + 2] * d2


@njit
def crossings(watch: Watch, before: Floats, after: Floats) -> bool:
    """Looks for a zero of each armed pole's current between two instants; marks where in ``watch.zero``."""
    found = False
    for s in range(before.shape[0]):
        for p in range(3):
            watch.zero[s, p] = -1.0
            if watch.armed[s, p]:
                i, j = before[s, p], after[s, p]
                if abs(i) <= NO_CURRENT:
                    watch.zero[s, p] = 0.0
                elif i * j < 0.0:
                    watch.zero[s, p] = i / (i - j)
                found = found or watch.zero[s, p] >= 0.0
    return found
