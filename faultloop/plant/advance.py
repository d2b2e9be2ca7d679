"""From sample to sample, whatever the switches do: the one way in which a plant runs."""

from __future__ import annotations

from faultloop.jit import njit
from faultloop.plant.elements import Floats
from faultloop.plant.elements.switch import switch_currents
from faultloop.plant.frontend import FrontEnds
from faultloop.plant.kernel import PENDING, PER_SAMPLE, ROW, STEP, STOP, Watch, commutate, go_back, run
from faultloop.plant.network import Network
from faultloop.plant.state import State
from faultloop.plant.switches import (
    Switches,
    begin,
    choose,
    foreseen,
    next_step,
    note_changes,
    present,
    take_orders,
)

SAME_INSTANT = 1e-6
"""Current zeros closer than this, in steps, are one instant: poles in series open together."""


@njit
def advance(
    net: Network, state: State, watch: Watch, front: FrontEnds, switches: Switches, samples: Floats
) -> int:
    """Makes up to ``control.wanted`` samples, into ``samples`` (n, relays, 6) from ``control.row`` on, and
    stops after the one in which a pole or a fault changed.  Returns their number, at least 1."""
    clock, c = watch.clock, switches.control[0]
    take_orders(switches, clock[STEP])
    c.changes = 0
    clock[ROW] = c.row
    wanted = foreseen(switches, c.wanted, clock[PER_SAMPLE]) if c.foresees else c.wanted
    end = (c.sample + wanted - 1) * clock[PER_SAMPLE]
    choose(net, switches)
    while clock[STEP] < end or clock[PENDING]:
        acting = False
        if not clock[PENDING] and next_step(switches) <= clock[STEP]:
            acting = begin(switches, watch.armed, clock[STEP])
            if acting:
                switch_currents(net.switch_bus, present(switches).switch, state.v, state.switch_current)
                watch.instant[0] = 0.0
                watch.instant[1] = 0.0
        else:
            clock[STOP] = min(end, next_step(switches))
            acting = run(net, present(switches), state, watch, front, samples)
            if acting:
                open_at_zero(state, watch, switches)
        while acting:
            note_changes(switches, clock[STEP], watch.instant[0])
            choose(net, switches)
            acting = commutate(net, present(switches), state, watch)
            if acting:
                open_at_zero(state, watch, switches)
        if c.changes:
            end = min(end, -(-clock[STEP] // clock[PER_SAMPLE]) * clock[PER_SAMPLE])
    done = clock[ROW] - c.row
    c.sample += done
    return done


@njit
def open_at_zero(state: State, watch: Watch, switches: Switches) -> None:
    """Takes the trial step back to its first current zero, and opens the poles that have it there."""
    first = 2.0
    for s in range(watch.zero.shape[0]):
        for p in range(3):
            if 0.0 <= watch.zero[s, p] < first:
                first = watch.zero[s, p]
    go_back(state, watch, first)
    for s in range(watch.zero.shape[0]):
        switches.before[s] = switches.masks[s]
        for p in range(3):
            if 0.0 <= watch.zero[s, p] <= first + SAME_INSTANT:
                watch.armed[s, p] = False
                switches.masks[s] &= ~(1 << p)
