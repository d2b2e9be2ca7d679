"""What the switches of a plant do while it runs: what is due, what was ordered, what has changed, and the
factored matrix of each state that they are in.

Records and arrays, so that the plant runs from one change to the next without Python.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from faultloop.jit import njit
from faultloop.plant.elements import Ints
from faultloop.plant.elements.switch import Action
from faultloop.plant.factor import Factor
from faultloop.plant.mechanism import KIND, MAKE, MASK, PART, STEP, SWITCH, row_of, take_command
from faultloop.plant.network import Matrix, Model, Network, refactor

NS = 1_000_000_000
KEPT = 16
"""Switch states whose factors are kept; then the oldest one gives way."""
ROOM = 64
"""For commands that have not come to their end, beside what is planned."""
FAR = np.iinfo(np.int64).max

CONTROL = np.dtype(
    [
        (name, "i8")
        for name in (
            "rate",  # steps per second
            "sampling_hz",
            "sample",  # number of the next sample
            "row",  # where the next run puts its first sample
            "wanted",  # how many samples it is to make
            "foresees",  # 1: commands of before its end may still come
            "actions",  # how many are pending
            "orders",  # how many are not yet taken
            "changes",  # how many there were in the last run
            "state",  # place of the present switch state's factor
            "newest",  # place of the one made last
        )
    ]
)
ORDER = np.dtype([("t_ns", "i8"), ("breaker", "i8"), ("opens", "i8"), ("poles", "i8")])
"""A command that a breaker has received."""
CHANGE = np.dtype([("t_ns", "i8"), ("is_pole", "i8"), ("index", "i8"), ("value", "i8")])
"""The poles of breaker ``index`` that are closed now, or whether fault ``index`` is on."""

Records = Any


class Switches(NamedTuple):
    """The switches' state and constants."""

    matrix: Matrix
    control: Records
    """(1,) CONTROL"""
    masks: Ints
    """(switches,) of the poles that conduct"""
    before: Ints
    """(switches,) the same before a change"""
    pending: Ints
    """(n, 5) rows of `mechanism`"""
    order: Records
    """(n,) ORDER"""
    change: Records
    """(n,) CHANGE"""
    number: Ints
    """(switches, 2) 1 for a breaker, 0 for a fault; its number among those"""
    breaker: Ints
    """(breakers, 3) switch, delay to close and to open [ns]"""
    known: Ints
    """(KEPT, switches + 1) masks of each kept factor, and at last whether there is one"""
    factor: Factor
    """arrays of KEPT factors"""


def new_switches(
    model: Model, actions: Sequence[Action], breakers: Sequence[tuple[int, int, int]], sampling_hz: int
) -> Switches:
    """As they are when the run begins; ``breakers``: switch, delay to close and to open [ns]."""
    switches = model.circuit.switches
    control = np.zeros(1, CONTROL)
    control["rate"], control["sampling_hz"], control["newest"] = model.circuit.rate, sampling_hz, KEPT - 1
    control["actions"] = len(actions)
    pending = np.zeros((len(actions) + 2 * ROOM, 5), dtype=np.int64)
    for k, action in enumerate(actions):
        pending[k] = row_of(action)
    kinds = [switch.kind for switch in switches]
    number = [(kind == "pole", kinds[:i].count(kind)) for i, kind in enumerate(kinds)]
    masks = np.array([7 if switch.closed else 0 for switch in switches], dtype=np.int64)
    # a pole that opens was made to conduct before: by an action, or when the run began
    changes = 3 * len(switches) + 4 * len(pending)
    return Switches(
        matrix=model.matrix,
        control=control,
        masks=masks,
        before=masks.copy(),
        pending=pending,
        order=np.zeros(ROOM, ORDER),
        change=np.zeros(changes, CHANGE),
        number=np.array(number, dtype=np.int64).reshape(-1, 2),
        breaker=np.array(breakers, dtype=np.int64).reshape(-1, 3),
        known=np.zeros((KEPT, len(switches) + 1), dtype=np.int64),
        factor=model.new_factors((KEPT,)),
    )


@njit(inline="always")
def present(switches: Switches) -> Factor:
    """The factor of the present state."""
    f, k = switches.factor, switches.control[0].state
    return Factor(f.inverse[k], f.lower[k], f.switch[k], f.response[k])


@njit
def choose(net: Network, switches: Switches) -> None:
    """Have the factor of the present state ready: one that was made before, or a new one."""
    c, masks, known = switches.control[0], switches.masks, switches.known
    for place in range(-1, known.shape[0]):
        k = c.state if place < 0 else place  # mostly it is the present one
        if known[k, masks.shape[0]] and same(masks, known[k]):
            c.state = k
            return
    c.newest = (c.newest + 1) % known.shape[0]
    c.state = c.newest
    for s in range(masks.shape[0]):
        known[c.state, s] = masks[s]
    known[c.state, masks.shape[0]] = 1
    refactor(net, switches.matrix, masks, present(switches))


@njit
def same(a: Ints, b: Ints) -> bool:
    """Whether all of ``a`` are also in ``b``, at the same places."""
    for s in range(a.shape[0]):  # noqa: SIM110 - a kernel knows no `all`
        if a[s] != b[s]:
            return False
    return True


@njit
def next_step(switches: Switches) -> int:
    """When the next action is due."""
    step = FAR
    for k in range(switches.control[0].actions):
        step = min(step, switches.pending[k, STEP])
    return step


@njit(heap=True)
def take_orders(switches: Switches, now: int) -> None:
    """What breakers have been ordered to do becomes actions, not before step ``now``."""
    c = switches.control[0]
    action = np.empty(5, np.int64)
    for k in range(c.orders):
        order = switches.order[k]
        own = switches.breaker[order.breaker]
        at_ns = order.t_ns + own[2 if order.opens else 1]
        action[STEP] = max(-(-at_ns * c.rate // NS), now)
        action[KIND] = PART if order.opens else MAKE
        action[SWITCH], action[MASK], action[4] = own[0], order.poles, 0
        c.actions = take_command(switches.pending, c.actions, action)
    c.orders = 0


@njit
def foreseen(switches: Switches, wanted: int, per_sample: int) -> int:
    """How many samples can be made before a command that is not known yet can matter: it acts after its
    breaker's delay, and may take back what that breaker is about to do."""
    c = switches.control[0]
    n = wanted
    for b in range(switches.breaker.shape[0]):
        quickest_ns = min(switches.breaker[b, 1], switches.breaker[b, 2])
        n = min(n, 1 + quickest_ns * c.sampling_hz // NS)
        for k in range(c.actions):
            if switches.pending[k, SWITCH] == switches.breaker[b, 0]:
                n = min(n, switches.pending[k, STEP] // per_sample - c.sample + 1)
    return max(n, 1)


@njit
def begin(switches: Switches, armed: NDArray[np.bool_], step: int) -> bool:
    """Does what is due at ``step``; True where poles begin to conduct (those that part wait, ``armed``, for
    their current zero)."""
    c, masks = switches.control[0], switches.masks
    for s in range(masks.shape[0]):
        switches.before[s] = masks[s]
    kept = 0
    for k in range(c.actions):
        action = switches.pending[k]
        if action[STEP] > step:
            for column in range(action.shape[0]):
                switches.pending[kept, column] = action[column]
            kept += 1
            continue
        s, mask = action[SWITCH], action[MASK]
        for p in range(3):
            if mask >> p & 1:
                armed[s, p] = action[KIND] == PART and (armed[s, p] or masks[s] >> p & 1 == 1)
        if action[KIND] == MAKE:
            masks[s] |= mask
    c.actions = kept
    return not same(switches.before, masks)


@njit
def note_changes(switches: Switches, step: int, instant: float) -> None:
    """The poles conduct otherwise than ``before``, from ``instant`` (0 .. 1) of a step on."""
    c = switches.control[0]
    t_ns = step * NS // c.rate if instant == 0.0 else int(math.floor((step + instant) * NS / c.rate))
    for s in range(switches.masks.shape[0]):
        is_pole, old, new = switches.number[s, 0], switches.before[s], switches.masks[s]
        if not is_pole:
            old, new = min(old, 1), min(new, 1)
        if old != new:
            change = switches.change[c.changes]
            change.t_ns = t_ns
            change.is_pole = is_pole
            change.index = switches.number[s, 1]
            change.value = new
            c.changes += 1


def saved_actions(switches: Switches) -> Ints:
    """A copy of what is pending."""
    return switches.pending[: int(switches.control["actions"][0])].copy()


def put_actions(switches: Switches, actions: Sequence[Any] | Ints) -> None:
    """What is pending, from `saved_actions`."""
    if len(actions):
        switches.pending[: len(actions)] = actions
    switches.control["actions"], switches.control["orders"] = len(actions), 0
