"""The time step, and the instants in it at which a switch acts.

Per step (H. W. Dommel, IEEE Trans. PAS-88, 1969): the histories of all branches and lines are injected into
the buses, the voltages solved, the histories renewed.

When a switch acts, one step is made of two backward-Euler steps of half the size (critical damping
adjustment, J. R. Marti and J. Lin, 1989): G is the same there, ``L / (dt/2)``, so nothing is factored anew,
and the trapezoidal rule never sees the discontinuity.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from faultloop.jit import njit
from faultloop.plant.elements import Floats, Ints
from faultloop.plant.elements.bergeron import (
    wave_currents,
    wave_histories,
    wave_histories_at,
    wave_inject,
    wave_push,
)
from faultloop.plant.elements.branch import branch_currents, branch_histories, branch_inject, branch_step
from faultloop.plant.elements.converter import control, set_voltages
from faultloop.plant.elements.emf import exact_emf, renew_emf
from faultloop.plant.elements.mutual import (
    coupled_arrivals,
    coupled_currents,
    coupled_histories,
    coupled_push,
    coupled_step,
    coupled_wave_currents,
)
from faultloop.plant.elements.switch import crossings, switch_currents, waiting
from faultloop.plant.elements.varistor import conduct
from faultloop.plant.factor import Factor, solve
from faultloop.plant.frontend import FrontEnds, convert, measure, transform
from faultloop.plant.network import Network
from faultloop.plant.state import State

STEP, PER_SAMPLE, STOP, ROW, PENDING = range(5)
"""Of the clock: step number; steps per sample; step to stop at; row of the next sample; 1 while the present
step has not been delivered to the front ends."""


class Watch(NamedTuple):
    """The clock, and the poles that wait for a current zero."""

    clock: Ints
    """(5,) indexed by STEP .. PENDING"""
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
    """Steps to the clock's ``STOP``, with each sample due put in ``samples`` (rows, relays, 6).  True where
    an armed pole's current crossed zero: then the last step is on trial, and has not been delivered."""
    # compiled twice: beside a converter's control a small network's step takes a quarter longer
    if net.converter.row.shape[0] > 0:
        return steps(net, factor, state, watch, front, samples, True)
    return steps(net, factor, state, watch, front, samples, False)


@njit(forceinline=True)
def steps(
    net: Network,
    factor: Factor,
    state: State,
    watch: Watch,
    front: FrontEnds,
    samples: Floats,
    converted: bool,
) -> bool:
    """`run`, with converters or without."""
    clock = watch.clock
    if clock[PENDING]:
        if converted:
            control(net.converter, state.converter, state.past, state.v, state.branch_current, clock[STEP])
        arrive(net, factor, state, watch, front, samples)
    # asked here and not in the functions: a call passes all their arrays and takes as long as a step
    coupled = net.coupling.branch.shape[0] + net.coupling.wave.shape[0] > 0
    arrested = net.varistor.bus.shape[0] > 0
    armed = waiting(watch.armed)
    if armed:
        switch_currents(net.switch_bus, factor.switch, state.v, state.switch_current)
    while clock[STEP] < clock[STOP]:
        if armed:
            copy(state.v, state.old_v)
            copy(state.current, state.old_current)
            watch.instant[0] = 0.0
        clock[STEP] += 1
        clock[PENDING] = 1
        renew_emf(net.emf, state.emf, state.v, clock[STEP])
        if converted:
            set_voltages(net.converter, state.converter, state.v, 0.0)
        wave_histories(net.wave, state.ring, state.arriving, clock[STEP])
        if coupled:
            coupled_arrivals(net.coupling, state.arriving)
        branch_inject(net.branch, state.history, state.v, net.emf.wave.shape[0])
        wave_inject(net.wave, state.arriving, state.v)
        solve(net.structure, factor, state.v)
        if arrested:
            conduct(net.varistor, factor, state.v, state.varistor)
        branch_step(net.branch, state.history, state.v, state.branch_current)
        wave_currents(net.wave, state.arriving, state.v, state.wave_current)
        if coupled:
            coupled_step(net.coupling, net.branch, state.history, state.v, state.branch_current)
            coupled_wave_currents(net.coupling, net.wave, state.v, state.wave_current)
        wave_push(net.wave, state.ring, state.v, state.wave_current, clock[STEP])
        if coupled:
            coupled_push(net.coupling, net.wave, state.ring, state.v, state.wave_current, clock[STEP])
        if armed:
            switch_currents(net.switch_bus, factor.switch, state.v, state.switch_current)
            if crossings(watch.armed, state.old_switch_current, state.switch_current, watch.zero):
                return True
        if converted:
            control(net.converter, state.converter, state.past, state.v, state.branch_current, clock[STEP])
        # asked here and not in the function: a call passes a hundred array fields and takes 60 ns
        if front.stepped[0] or clock[STEP] % clock[PER_SAMPLE] == 0:
            arrive(net, factor, state, watch, front, samples)
        else:
            clock[PENDING] = 0
    return False


@njit
def commutate(net: Network, factor: Factor, state: State, watch: Watch) -> bool:
    """One step in which switches act, ``factor`` being the matrix after it, at ``watch.instant`` (0 .. 1) of
    the step; the state is the one at that instant, and is kept.  True where an armed pole's current has a
    zero in the rest of the step: then this step, too, is on trial.

    Two backward-Euler half steps go from the instant t to t + dt/2 and t + dt; the end of the step lies on
    the straight line through both, which keeps every linear equation of the network.
    """
    step, instant = watch.clock[STEP], watch.instant[0]
    copy(state.v, state.old_v)
    copy(state.current, state.old_current)
    for half in (0.5, 1.0):
        copy(state.v, state.half_v)
        copy(state.current, state.half_current)
        branch_histories(net.branch.bus, net.branch.euler, state.history, state.v, state.branch_current)
        coupled_histories(
            net.coupling, net.coupling.euler, net.branch, state.history, state.v, state.branch_current
        )
        now, newest = step + (instant + half), step + int(watch.instant[1])
        exact_emf(net.emf, state.v, now)
        if net.converter.row.shape[0] > 0:
            set_voltages(net.converter, state.converter, state.v, instant + half - 1.0)
        wave_histories_at(net.wave, state.ring, state.arriving, now, newest)
        coupled_arrivals(net.coupling, state.arriving)
        branch_inject(net.branch, state.history, state.v, net.emf.wave.shape[0])
        wave_inject(net.wave, state.arriving, state.v)
        solve(net.structure, factor, state.v)
        if net.varistor.bus.shape[0] > 0:
            conduct(net.varistor, factor, state.v, state.varistor)
        branch_currents(net.branch, state.history, state.v, state.branch_current)
        coupled_currents(net.coupling, net.branch, state.v, state.branch_current)
        wave_currents(net.wave, state.arriving, state.v, state.wave_current)
        coupled_wave_currents(net.coupling, net.wave, state.v, state.wave_current)
    between(state.half_v, state.v, 1.0 - 2.0 * instant)
    between(state.half_current, state.current, 1.0 - 2.0 * instant)
    watch.clock[STEP] = step + 1
    watch.clock[PENDING] = 1
    branch_histories(net.branch.bus, net.branch.trapezoid, state.history, state.v, state.branch_current)
    coupled_histories(
        net.coupling, net.coupling.trapezoid, net.branch, state.history, state.v, state.branch_current
    )
    wave_push(net.wave, state.ring, state.v, state.wave_current, step + 1)
    coupled_push(net.coupling, net.wave, state.ring, state.v, state.wave_current, step + 1)
    switch_currents(net.switch_bus, factor.switch, state.v, state.switch_current)
    return crossings(watch.armed, state.old_switch_current, state.switch_current, watch.zero)


@njit
def go_back(state: State, watch: Watch, share: float) -> None:
    """From the end of a step on trial into it, to a share (0 .. 1) of the way from the state kept, by linear
    interpolation: good for currents of inductances and voltages of capacitances, all that Euler steps look
    back to, even where a commutation lies between."""
    watch.clock[STEP] -= 1
    watch.instant[0] += share * (1.0 - watch.instant[0])
    watch.instant[1] = 1.0
    between(state.old_v, state.v, share)
    between(state.old_current, state.current, share)


@njit
def copy(a: Floats, b: Floats) -> None:
    """b = a, by rows of three: a slice assignment takes a second to compile."""
    for i in range(a.shape[0]):
        for p in range(3):
            b[i, p] = a[i, p]


@njit
def between(a: Floats, b: Floats, share: float) -> None:
    """b becomes the point on the line from a (0) to b (1)."""
    for i in range(a.shape[0]):
        for p in range(3):
            b[i, p] = a[i, p] + share * (b[i, p] - a[i, p])


@njit(forceinline=True)
def arrive(
    net: Network, factor: Factor, state: State, watch: Watch, front: FrontEnds, samples: Floats
) -> None:
    """At the end of a step: the analog front ends, and a sample where one is due."""
    clock = watch.clock
    clock[PENDING] = 0
    switch_currents(net.switch_bus, factor.switch, state.v, state.switch_current)
    measure(front, state.v, state.current, state.measured)
    if front.stepped[0]:
        transform(front, state.analog, clock[STEP], state.measured)
    if clock[STEP] % clock[PER_SAMPLE] == 0:
        convert(front, clock[STEP] // clock[PER_SAMPLE], state.measured, samples[clock[ROW]])
        clock[ROW] += 1
