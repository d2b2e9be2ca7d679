"""The primary system, advanced sample by sample for the relays."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from faultloop.errors import InputError, nearest
from faultloop.plant import kernel
from faultloop.plant.breaker import Breaker
from faultloop.plant.build import circuit_of
from faultloop.plant.component import PlantTables
from faultloop.plant.elements.switch import POLE_BITS, Action, Kind, poles
from faultloop.plant.frontend import (
    FrontEnds,
    analog_shapes,
    convert_block,
    front_ends,
    magnetize,
    settle,
)
from faultloop.plant.kernel import PENDING, ROW, STEP, STOP, Watch
from faultloop.plant.line import Line
from faultloop.plant.mechanism import commanded
from faultloop.plant.network import Model
from faultloop.plant.probe import Probe
from faultloop.plant.state import State, fill, new_state, renew_switch_currents
from faultloop.plant.steady import ROTATION, Steady, steady_states

NS = 1_000_000_000
SLIPPING = 0.1
"""A source that is off the nominal frequency by less than this share is a system that slips."""
SAME_INSTANT = 1e-6
"""Current zeros closer than this, in steps, are one instant: poles in series open together."""


@dataclass(frozen=True)
class Change:
    """A pole or a fault that changed at ``t_ns``: breaker ``index`` now has the poles ``value`` closed
    (A = 1, B = 2, C = 4), or fault ``index`` is on (1) or off (0)."""

    t_ns: int
    kind: Kind
    index: int
    value: int


class PlantState(NamedTuple):
    """What `Plant.save` returns."""

    buffer: NDArray[np.float64]
    clock: NDArray[np.int64]
    armed: NDArray[np.bool_]
    masks: tuple[int, ...]
    actions: tuple[Action, ...]
    sample_count: int


class Plant:
    """The network of a scenario, advanced sample by sample.

    Parameters
    ----------
    tables : the components, and where relays measure; a `Scenario` is one.

    Raises
    ------
    InputError
        Where the network has no unique solution or a fault has no voltage to time it by.

    Attributes
    ----------
    sampling_hz, steps_per_sample : samples per second; solution steps in a sampling interval.
    notes : list of str
        What a log should say: the model of a short section, the exact instant of a fault.
    sample_count : int
        Number of the next sample; sample k is taken at ``k * 10**9 // sampling_hz`` ns.
    samples : (m, relays, 6) array
        Of the last `advance`: va vb vc ia ib ic [V, A], primary, current from the bus into the line.
        Overwritten by the next one.
    changes : list of Change
        Of the last `advance`.
    """

    def __init__(self, tables: PlantTables) -> None:
        self.tables = tables
        self.sampling_hz = tables.system.sampling_hz
        self.steps_per_sample = tables.system.steps_per_sample
        self.sample_count = 0
        self.changes: list[Change] = []
        circuit = circuit_of(tables)
        self._rate = circuit.rate
        self._model = Model(circuit)
        self._breakers = {breaker.name: breaker for breaker in tables.all(Breaker)}
        self._seen_as = _numbered([switch.kind for switch in circuit.switches])
        self._front = self._front_ends()
        self._buffer, self._state = _new_state(self._model, self._front)
        switches = len(circuit.switches)
        self._watch = Watch(
            clock=np.array([0, self.steps_per_sample, 0, 0, 1], dtype=np.int64),
            armed=np.zeros((switches, 3), dtype=np.bool_),
            zero=np.zeros((switches, 3)),
            instant=np.zeros(2),
        )
        self._masks = tuple(7 if s.closed else 0 for s in circuit.switches)
        self._factor = self._model.factor(self._masks)
        steady = steady_states(self._model)
        self._settle(steady)
        planned = [item.actions(self._model, steady) for item in tables.items()]
        self._actions = tuple(action for actions, _ in planned for action in actions)
        self.notes = circuit.notes + [note for _, notes in planned for note in notes]
        self._samples = np.empty((0, len(tables.relay), 6))
        self.samples = self._samples

    # ------------------------------------------------------------------ running

    def advance(self, n: int) -> int:
        """Computes up to ``n`` samples into `samples`, and stops after the sample in which a pole or a fault
        changed; returns their number, at least 1."""
        if n < 1:
            raise ValueError(f"advance needs n >= 1, not {n}")
        if len(self._samples) < n:
            self._samples = np.empty((n, len(self.tables.relay), 6))
        clock, network = self._watch.clock, self._model.network
        clock[ROW] = 0
        self.changes = []
        end = (self.sample_count + n - 1) * self.steps_per_sample
        while clock[STEP] < end or clock[PENDING]:
            now = int(clock[STEP])
            due = [action for action in self._actions if action.step <= now < end]
            if due and not clock[PENDING]:
                self._actions = tuple(action for action in self._actions if action.step > now)
                self._act(due)
            else:
                clock[STOP] = min([end, *(a.step for a in self._actions)])
                if kernel.run(network, self._factor, self._state, self._watch, self._front, self._samples):
                    self._open_at_zero()
            if self.changes:
                end = min(end, -(-int(clock[STEP]) // self.steps_per_sample) * self.steps_per_sample)
        m = int(clock[ROW])
        self.sample_count += m
        self.samples = self._samples[:m]
        return m

    def history(self, n: int) -> NDArray[np.float64]:
        """The ``n`` samples before sample 0, (n, relays, 6), of the steady state that the run begins in.

        Systems that slip against each other do so from step 0 on: until then they stand as they do there, or
        the time before the run would hold a pole slip that never was.
        """
        steps = np.arange(-n, 0)[:, None, None] * self.steps_per_sample
        values = np.zeros((n, len(self.tables.relay), 6))
        for angle, phasors in self._standing():
            values += (phasors * np.exp(1j * angle * steps)).real
        convert_block(self._front, -n, values, values)
        return values

    def _standing(self) -> list[tuple[float, NDArray[np.complex128]]]:
        """Turn per step and phasors of what `history` is made of: of all frequencies that can be a system's,
        the one nearest to the nominal is everybody's."""
        nominal = 2 * math.pi * self.tables.system.frequency_hz / self._rate
        systems = [angle for angle, _ in self._before if abs(angle - nominal) < SLIPPING * nominal]
        common = min(systems, key=lambda angle: abs(angle - nominal), default=nominal)
        return [(common if angle in systems else angle, phasors) for angle, phasors in self._before]

    def command(self, breaker: str, action: Literal["open", "close"], poles_mask: int, t_ns: int) -> None:
        """A breaker receives a command at ``t_ns``, not before the last advanced time.

        It acts ``operate_ms`` or ``close_ms`` later.  Opening, each pole then conducts to its first current
        zero.  A repeated open changes nothing; an open cancels a close that has not acted yet.
        """
        if breaker not in self._breakers:
            raise InputError(f"there is no breaker '{breaker}'; {nearest(breaker, self._breakers)}")
        if action not in ("open", "close") or not 1 <= poles_mask <= 7:
            raise ValueError(
                f"a command is 'open' or 'close' with a mask of 1 to 7: {action!r}, {poles_mask}"
            )
        if t_ns < self._now_ns():
            raise ValueError(f"a command at {t_ns} ns comes too late: the plant is at {self._now_ns()} ns")
        switch, settings = self._switch_of(breaker), self._breakers[breaker]
        delay = settings.operate_ms if action == "open" else settings.close_ms
        step = max(self._step_at(t_ns + round(delay * 1e6)), int(self._watch.clock[STEP]))
        kind = "part" if action == "open" else "make"
        self._actions = commanded(self._actions, Action(step, kind, switch, poles_mask))

    def closed(self, breaker: str) -> int:
        """Mask of the breaker's conducting poles, now."""
        if breaker not in self._breakers:
            raise InputError(f"there is no breaker '{breaker}'; {nearest(breaker, self._breakers)}")
        return self._masks[self._switch_of(breaker)]

    def save(self) -> PlantState:
        """A copy of everything that changes."""
        watch = self._watch
        return PlantState(
            self._buffer.copy(),
            watch.clock.copy(),
            watch.armed.copy(),
            self._masks,
            self._actions,
            self.sample_count,
        )

    def restore(self, state: PlantState) -> None:
        """Back to a saved state; what follows is the same to the bit."""
        self._buffer[:] = state.buffer
        self._watch.clock[:] = state.clock
        self._watch.armed[:] = state.armed
        self._masks, self._actions, self.sample_count = state.masks, state.actions, state.sample_count
        self._factor = self._model.factor(self._masks)
        self.changes = []

    @property
    def probe(self) -> Probe:
        """Any voltage and current of the network, now."""
        return Probe(self._model, self._factor, self._state)

    # ------------------------------------------------------------------ switching

    def _act(self, due: list[Action]) -> None:
        """Does what is due at the present step; where something began to conduct, takes the step with it."""
        masks = list(self._masks)
        for action in due:
            which = poles(action.mask)
            if action.kind == "part":
                self._watch.armed[action.switch] |= which & poles(masks[action.switch])
            else:
                self._watch.armed[action.switch] &= ~which
                masks[action.switch] |= action.mask
        if tuple(masks) != self._masks:
            renew_switch_currents(self._model, self._factor, self._state)
            self._watch.instant[:] = 0
            self._change(tuple(masks))
            if kernel.commutate(self._model.network, self._factor, self._state, self._watch):
                self._open_at_zero()

    def _open_at_zero(self) -> None:
        """Takes the trial step back to its first current zero, opens the poles that have it there, and goes
        to the step's end; as often as there is a zero."""
        watch = self._watch
        again = True
        while again:
            first = watch.zero[watch.zero >= 0].min()
            opening = (watch.zero >= 0) & (watch.zero <= first + SAME_INSTANT)
            watch.armed[:] &= ~opening
            kernel.go_back(self._state, watch, first)
            bits = opening @ POLE_BITS
            self._change(tuple(m & ~int(b) for m, b in zip(self._masks, bits, strict=True)))
            again = kernel.commutate(self._model.network, self._factor, self._state, watch)

    def _change(self, masks: tuple[int, ...]) -> None:
        """From ``watch.instant`` of the present step on, the conducting poles are ``masks``."""
        step, instant = int(self._watch.clock[STEP]), float(self._watch.instant[0])
        t_ns = step * NS // self._rate if instant == 0 else math.floor((step + instant) * NS / self._rate)
        for switch, (old, new) in enumerate(zip(self._masks, masks, strict=True)):
            kind, index = self._seen_as[switch]
            if kind == "pole" and old != new:
                self.changes.append(Change(t_ns, kind, index, new))
            elif kind == "fault" and bool(old) != bool(new):
                self.changes.append(Change(t_ns, kind, index, int(bool(new))))
        self._masks = masks
        self._factor = self._model.factor(masks)

    def _switch_of(self, breaker: str) -> int:
        return self._model.circuit.number[Breaker.table, breaker]

    # ------------------------------------------------------------------ setting up

    def _front_ends(self) -> FrontEnds:
        """Where each relay's voltage and current come from."""
        circuit, row = self._model.circuit, self._model.row
        bus, terms = [], []
        for relay in self.tables.relay:
            line = self.tables.find(Line, relay.line, f"relay[{relay.name}].line")
            at_bus = relay.voltage_at == "bus"
            node = line.bus(relay.end) if at_bus else circuit.terminals[relay.line, relay.end]
            bus.append(row[node])
            parts = circuit.terms[relay.line, relay.end]
            terms.append([(circuit.current_row(kind, i), sign) for kind, i, sign in parts])
        return front_ends(self.tables, bus, terms, float(self._rate))

    def _settle(self, steady: list[Steady]) -> None:
        """The state of an eternal run at step 0."""
        fill(self._model, steady, self._state)
        front = self._front
        self._before: list[tuple[float, NDArray[np.complex128]]] = []
        for s in steady:
            x = np.zeros((len(self.tables.relay), 6), dtype=complex)
            for i in range(len(x)):
                x[i, :3] = s.v[front.bus[i]] * ROTATION
                span = slice(front.pointer[i], front.pointer[i + 1])
                x[i, 3:] = (front.sign[span] * s.current[front.term[span]]).sum() * ROTATION
            self._before.append((s.angle, settle(front, self._state.analog, x, s.angle)))
        magnetize(front, self._state.analog, self.tables)

    def _step_at(self, t_ns: int) -> int:
        """The first step at or after a time."""
        return -(-t_ns * self._rate // NS)

    def _now_ns(self) -> int:
        return int(self._watch.clock[STEP]) * NS // self._rate


def _numbered(kinds: list[Kind]) -> list[tuple[Kind, int]]:
    """Each with its place among those of its kind."""
    return [(kind, kinds[:i].count(kind)) for i, kind in enumerate(kinds)]


def _new_state(model: Model, front: FrontEnds) -> tuple[NDArray[np.float64], State]:
    branches, waves = len(model.circuit.branches), len(model.circuit.sections)
    rows, currents = len(model.row), branches + 2 * waves + len(model.circuit.switches)
    shapes = {
        "v": (rows, 3),
        "current": (currents, 3),
        "history": (branches, 3),
        "ring": (model.ring_slots, 6),
        "emf": (len(model.circuit.emfs), 3),
        "old_v": (rows, 3),
        "old_current": (currents, 3),
        "half_v": (rows, 3),
        "half_current": (currents, 3),
        "arriving": (waves, 6),
        "varistor": (len(model.circuit.varistors), 2, 3),
        "measured": (len(front.bus), 6),
    } | analog_shapes(front)
    return new_state(shapes, (branches, 2 * waves))
