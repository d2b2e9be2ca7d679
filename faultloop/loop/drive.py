"""The closed loop's clock, compiled: the plant and the estimators run ahead by as much as no command can
touch, the relays decide sample by sample, and before each sample the exchange follows to its time.

`follow` returns where Python has a part: what the exchange needs it for (`faultloop.loop.exchange`), an
estimator that is plain Python, full tables, the end of what was asked for.  It goes on when called again.
Plant, relays and exchange are called by their addresses: this is compiled without them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numba
import numpy as np
from numba.core import types
from numpy.typing import NDArray

from faultloop.io.can.port import CLOSE
from faultloop.io.can.record import Records
from faultloop.jit import Address, call_for_nothing, call_for_number, call_step, compiled, njit
from faultloop.loop.exchange import (
    ACTED,
    DONE,
    FAULT_CHANGED,
    LOOK,
    POLES_CHANGED,
    RING,
    SECOND_NS,
    SILENCE,
    STATE_TAKEN,
    Exchange,
    due_ns,
    serve,
    tell,
)
from faultloop.loop.phasors import give_sets, say_set
from faultloop.nodes.clock import SampleClock
from faultloop.nodes.goose import set_state
from faultloop.nodes.relay import hear
from faultloop.plant import PlantParts
from faultloop.plant.advance import advance
from faultloop.relay.bank import Bank
from faultloop.relay.chain import decide
from faultloop.relay.loops import measure

STOPPED, FLUSH, ESTIMATE, ORDERS = range(100, 104)
"""Why it returns, beside the exchange's reasons: the stop is reached; what has happened is to be told and
room to be made; Python is to estimate what the plant has made; the plant needs room for commands."""
NOBODY = -1
AHEAD = 240
"""Samples that the plant makes at once, at most."""

CLOCK = np.dtype(
    [
        (name, "i8")
        for name in (
            "sampling_hz",
            "sample",  # number of the next sample
            "stop",  # and of the one before which it stops
            "end",  # and of the one that is never made
            "made",  # the plant has made the samples before this one
            "base",  # number of the sample in the first row
            "ahead",  # samples that the plant makes at once, at most
            "heard",  # how many events of the ring have been acted on
        )
    ]
)
BREAKER = np.dtype([("closed", "i8"), ("seat", "i8")])
"""Its closed poles as of the last sample taken, and its node's seat; NOBODY's: it is somebody else's."""


class Course(NamedTuple):
    """What the loop itself remembers."""

    clock: Records
    """(1,) CLOCK"""
    breaker: Records
    """(breakers,) BREAKER"""
    samples: NDArray[np.float64]
    """(N, rows, 6): of the relays, then of the breakers' other sides"""


def new_course(closed: Sequence[int], measured: int, clock: SampleClock, rows: int) -> Course:
    """At sample 0; ``closed``: the poles of each breaker; ``measured``: places at which the plant does."""
    course = Course(np.zeros(1, CLOCK), np.zeros(len(closed), BREAKER), np.zeros((rows, measured, 6)))
    course.clock["sampling_hz"], course.clock["ahead"] = clock.sampling_hz, AHEAD
    course.breaker["closed"], course.breaker["seat"] = closed, NOBODY
    return course


class Kernels(NamedTuple):
    """Their addresses."""

    measure: int
    decide: int
    advance: int
    serve: int


@njit(nogil=True)  # other threads run beside it: one that writes the log, another run
def follow(course: Course, x: Exchange, plant: Any, bank: Any, kernels: Kernels) -> int:
    """Lets time pass until something is Python's; returns what."""
    c, w = course.clock[0], x.control[0]
    next_ns = due_ns(x)
    while True:
        if c.heard < w.events and not act(course, x, plant.switches, bank):
            return ORDERS
        k = c.sample
        t_ns = k * SECOND_NS // c.sampling_hz
        if w.phase != LOOK or next_ns <= t_ns or k >= c.stop:
            show(course, x, bank)
            code = call_for_number(kernels.serve, (x, t_ns))
            next_ns = due_ns(x)
            if code == ACTED:
                continue
            if code != DONE:
                return code
        if k >= c.stop:
            return STOPPED
        rows = course.samples.shape[0]
        if k - c.base >= rows or full(bank):
            show(course, x, bank)
            return FLUSH
        if k >= c.made:
            make(course, plant, min(c.ahead, rows - (k - c.base), c.end - k), kernels)
        if not estimate(course, bank, kernels):
            return ESTIMATE
        if k == c.made - 1:
            if w.events + plant.switches.control[0].changes > RING:
                show(course, x, bank)
                return FLUSH
            if take_changes(course, x, plant.switches, t_ns):
                next_ns = t_ns
        apart = False
        for i in range(bank.relay.shape[0]):
            if not bank.relay[i].away and decides(course, x, bank, i, kernels):
                next_ns = t_ns
                apart = apart or bank.relay[i].apart != 0
        c.sample = k + 1
        w.sample = k + 1
        if apart:
            show(course, x, bank)
            return FLUSH


@njit(forceinline=True)
def act(course: Course, x: Exchange, switches: Any, bank: Any) -> bool:
    """Does what the states want that were taken since: a relay's inputs, a breaker's command.  False where
    the plant has no room for one."""
    c, w = course.clock[0], x.control[0]
    while c.heard < w.events:
        event = x.events[c.heard]
        if event.what == STATE_TAKEN:
            seat = x.seats[event.node]
            if not seat.breaker:
                state = bank.state[seat.number]
                hear(x.nodes, event.node, state.shared)
                if x.nodes.node[event.node].sources:
                    constants = bank.constants[seat.number]
                    give_sets(
                        x.nodes,
                        event.node,
                        constants.shared,
                        state.shared,
                        constants.pdif[0],
                        state.pdif[0],
                    )
            elif event.value:
                control = switches.control[0]
                room = switches.pending.shape[0] - control.actions
                if control.orders >= min(switches.order.shape[0], room):
                    return False
                order = switches.order[control.orders]
                order.t_ns = event.t_ns
                order.breaker = seat.number
                order.opens = event.identifier - (event.identifier & 0xF) != CLOSE
                order.poles = event.value
                control.orders += 1
                event.closed = course.breaker[seat.number].closed
        elif event.what == SILENCE:
            hear(x.nodes, event.node, bank.state[x.seats[event.node].number].shared)
        c.heard += 1
    return True


@njit
def show(course: Course, x: Exchange, bank: Any) -> None:
    """What the relays measure now, for their nodes to show."""
    for i in range(bank.relay.shape[0]):
        r = bank.relay[i]
        row = r.last - course.clock[0].base
        if not r.away and r.last >= 0 and row >= 0:
            for column in range(14):
                x.nodes.measured[i, column] = bank.phasors[i, row, column]
            x.nodes.measured[i, 14] = bank.state[i].rflo[0].value


@njit
def full(bank: Any) -> bool:
    """Whether there may be no room for what the relays tell at the next sample."""
    return bank.notices[0] + bank.relay.shape[0] > bank.notice.shape[0]


@njit(forceinline=True)
def make(course: Course, plant: Any, wanted: int, kernels: Kernels) -> None:
    """The plant's next samples."""
    c, control = course.clock[0], plant.switches.control[0]
    control.row = c.sample - c.base
    control.wanted = wanted
    control.foresees = 1
    parts = (plant.net, plant.state, plant.watch, plant.front, plant.switches, course.samples)
    c.made = c.sample + call_for_number(kernels.advance, parts)


@njit(forceinline=True)
def estimate(course: Course, bank: Any, kernels: Kernels) -> bool:
    """Every relay's estimates of what the plant has made; False where one is Python's."""
    c = course.clock[0]
    for i in range(bank.relay.shape[0]):
        r = bank.relay[i]
        if r.away or r.made > c.sample:
            continue
        if r.step == 0:
            return False
        state = bank.estimator[bank.pointer[i] : bank.pointer[i + 1]]
        first, end = c.sample - c.base, c.made - c.base
        for row in range(first, end):
            call_step(r.step, state, course.samples[row, i], bank.phasors[i, row])
        constants, own = bank.measure_constants[i : i + 1], bank.measure_state[i : i + 1]
        flat = (bank.phasors[i, first:end], bank.loops[i, first:end])
        call_for_nothing(kernels.measure, (constants, own, *flat))
        r.made = c.made
    return True


@njit(forceinline=True)
def take_changes(course: Course, x: Exchange, switches: Any, t_ns: int) -> bool:
    """Poles and faults that have changed up to the sample at ``t_ns``; True where a node has to say so.

    A breaker's node scans its contacts once a sample, so its frame is of the sample after the change."""
    said = False
    for k in range(switches.control[0].changes):
        change = switches.change[k]
        if change.is_pole:
            tell(x, change.t_ns, POLES_CHANGED, change.index, 0, change.value)
            own = course.breaker[change.index]
            own.closed = change.value
            if own.seat != NOBODY:
                set_state(x.nodes.publishers[x.nodes.node[own.seat].first_publisher], change.value, t_ns)
                said = True
        else:
            tell(x, change.t_ns, FAULT_CHANGED, change.index, 0, change.value)
    return said


@njit
def widen(course: Course, bank: Any, i: int, row: int) -> None:
    """What a relay measures in a row, with what it measures beside its own six, into its (WIDE,)."""
    r, wide = bank.relay[i], bank.wide[i]
    for k in range(6):
        wide[k] = course.samples[row, i, k]
    for k in range(3):
        wide[6 + k] = course.samples[row, r.across, k] if r.across >= 0 else np.nan
    wide[9] = np.nan
    if r.beside >= 0:
        wide[9] = course.samples[row, r.beside, 3] + course.samples[row, r.beside, 4]
        wide[9] += course.samples[row, r.beside, 5]


@njit(forceinline=True)
def decides(course: Course, x: Exchange, bank: Any, i: int, kernels: Kernels) -> bool:
    """One relay's decision on the next sample; True where its outputs changed or it has something to tell."""
    c, r, q = course.clock[0], bank.relay[i], bank.state[i].shared
    poles, close, pilot, notices, transfer = q.poles, q.close_poles, q.pilot, q.notices, q.transfer
    phasors = q.phasors
    q.number = c.sample - 1
    row = c.sample - c.base
    samples = course.samples[row, i : i + 1]
    if r.across >= 0 or r.beside >= 0:
        widen(course, bank, i, row)
        samples = bank.wide[i : i + 1]
    own = (bank.constants[i : i + 1], bank.state[i : i + 1])
    made = (bank.phasors[i, row : row + 1], bank.loops[i, row : row + 1], bank.words[i, row : row + 1])
    call_for_number(kernels.decide, (*own, samples, *made))
    r.last = c.sample
    r.changed += q.changed
    same = q.poles == poles and q.close_poles == close and q.pilot == pilot and q.transfer == transfer
    if same and q.notices == notices and q.phasors == phasors:
        return False
    t_ns = c.sample * SECOND_NS // c.sampling_hz
    if q.phasors != phasors and x.nodes.node[i].sources:
        constants, state = bank.constants[i], bank.state[i]
        say_set(x.nodes, i, constants.shared, q, constants.pdif[0], state.pdif[0], t_ns)
    if same and q.notices == notices:
        return True
    first = x.nodes.node[i].first_publisher
    set_state(x.nodes.publishers[first], q.poles, t_ns)
    set_state(x.nodes.publishers[first + 1], q.close_poles, t_ns)
    set_state(x.nodes.publishers[first + 2], q.pilot, t_ns)
    node = x.nodes.node[i]
    if node.transfers:
        set_state(x.nodes.publishers[first + node.transfers], q.transfer, t_ns)
    if node.back_trips:
        set_state(x.nodes.publishers[first + node.back_trips], q.back_trip, t_ns)
    n = bank.notices[0]
    bank.notice[n, 0] = i
    bank.notice[n, 1] = c.sample
    bank.told[n] = bank.state[i]
    bank.notices[0] = n + 1
    return True


_known: list[tuple[Any, Kernels, list[Address]]] = []


def go_on(course: Course, x: Exchange, plant: PlantParts, bank: Bank) -> int:
    """`follow`, by its machine code: every loop has the same types, and to find them out takes 0.5 ms."""
    if not _known:
        parts = _signatures(course, x, plant, bank)
        owners = [Address(kernel, *sig.args) for kernel, sig in parts]
        kernels = Kernels(*(owner.address for owner in owners))
        _known.append((compiled(follow, course, x, plant, bank, kernels), kernels, owners))
    code, kernels, _ = _known[0]
    return code(course, x, plant, bank, kernels)


def compile_loop(
    course: Course, x: Exchange, plant: PlantParts, bank: Bank, *, backwards: bool = False
) -> None:
    """All that `follow` needs, and itself; nothing where this process has done so, or the cache has it.

    ``backwards`` begins where others end (`faultloop.loop.beside`)."""
    follow_kernel: Any = follow
    if follow_kernel.overloads:  # to find out the types of the arguments takes 8 ms
        return
    kernels = _signatures(course, x, plant, bank)
    called: Any = types.NamedUniTuple(types.int64, len(kernels), Kernels)
    loop = tuple(_typeof(part) for part in (course, x, plant, bank))
    wanted = [*((kernel, sig.args) for kernel, sig in kernels), (follow_kernel, (*loop, called))]
    for kernel, arguments in reversed(wanted) if backwards else wanted:
        kernel.compile(arguments)


def _signatures(
    course: Course, x: Exchange, plant: PlantParts, bank: Bank
) -> tuple[tuple[Any, Any], tuple[Any, Any], tuple[Any, Any], tuple[Any, Any]]:
    """The `Kernels`, in their order, each with its signature."""
    rows = _typeof(course.samples[0])
    flat = (_typeof(bank.phasors[0]), _typeof(bank.loops[0]))
    return (
        (measure, types.void(_typeof(bank.measure_constants), _typeof(bank.measure_state), *flat)),
        (
            decide,
            types.int64(_typeof(bank.constants), _typeof(bank.state), rows, *flat, _typeof(bank.words[0])),
        ),
        (advance, types.int64(*(_typeof(part) for part in plant), _typeof(course.samples))),
        (serve, types.int64(_typeof(x), types.int64)),
    )


_typeof: Any = numba.typeof
