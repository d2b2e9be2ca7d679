"""The primary system, advanced sample by sample for the relays."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from faultloop.config.place import measured_rows
from faultloop.errors import InputError, nearest
from faultloop.plant.advance import advance
from faultloop.plant.breaker import Breaker
from faultloop.plant.build import circuit_of
from faultloop.plant.component import PlantTables
from faultloop.plant.elements import Floats, Ints
from faultloop.plant.elements.converter import FIELDS, ring_length
from faultloop.plant.elements.switch import Action, Kind
from faultloop.plant.fault import Fault
from faultloop.plant.frontend import (
    FrontEnds,
    analog_shapes,
    convert_block,
    front_ends,
    magnetize,
    settle,
)
from faultloop.plant.kernel import STEP, Watch
from faultloop.plant.line import Line
from faultloop.plant.mechanism import row_of, take_in_python
from faultloop.plant.network import Model, Network
from faultloop.plant.power_flow import balance
from faultloop.plant.probe import Probe
from faultloop.plant.state import State, fill, new_state
from faultloop.plant.steady import ROTATION, Steady, steady_states
from faultloop.plant.switches import (
    ROOM,
    Switches,
    new_switches,
    next_step,
    put_actions,
    saved_actions,
)

NS = 1_000_000_000
KEPT_PLANTS = 2
"""Networks that come in turns."""
SLIPPING = 0.1
"""A source that is off the nominal frequency by less than this share is a system that slips."""


@dataclass(frozen=True)
class Change:
    """What changed at ``t_ns``, a pole or a fault by its ``kind``.

    Breaker ``index`` now has the poles ``value`` closed (A = 1, B = 2, C = 4), or fault ``index`` is on (1)
    or off (0).
    """

    t_ns: int
    kind: Kind
    index: int
    value: int


class PlantState(NamedTuple):
    """What `Plant.save` returns."""

    buffer: Floats
    clock: Ints
    armed: NDArray[np.bool_]
    masks: Ints
    actions: Ints
    sample_count: int


class PlantParts(NamedTuple):
    """What `advance` works on."""

    net: Network
    state: State
    watch: Watch
    front: FrontEnds
    switches: Switches


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
        self.changes: list[Change] = []
        with tables.naming_its_file():
            circuit = circuit_of(tables)
        self._rate = circuit.rate
        self._model = Model(circuit)
        self._breakers = {breaker.name: breaker for breaker in tables.all(Breaker)}
        front = self._front_ends()
        self._buffer, state = _new_state(self._model, front)
        count = len(circuit.switches)
        watch = Watch(
            clock=np.array([0, self.steps_per_sample, 0, 0, 1], dtype=np.int64),
            armed=np.zeros((count, 3), dtype=np.bool_),
            zero=np.zeros((count, 3)),
            instant=np.zeros(2),
        )
        with tables.naming_its_file():
            balance(self._model)
            steady = steady_states(self._model)
            self._settle(steady, front, state)
            self._steady = steady
            actions = self._plan()
        breakers = [
            (self._switch_of(name), round(own.close_ms * 1e6), round(own.operate_ms * 1e6))
            for name, own in self._breakers.items()
        ]
        switches = new_switches(self._model, actions, breakers, self.sampling_hz)
        net, front = _contiguous(self._model.network), _contiguous(front)
        self.parts = PlantParts(net, state, watch, front, switches)
        self._new = self.save()
        self._samples = np.empty((0, measured_rows(tables.relay), 6))
        self.samples = self._samples

    def begin_again(self, tables: PlantTables) -> None:
        """As a new one of ``tables``, of the same network (`PlantTables.is_same_network`).

        Raises InputError as a new one does."""
        self.tables = tables
        circuit, matrix = self._model.circuit, self._model.matrix
        for fault in tables.all(Fault):
            number = circuit.number[Fault.table, fault.name]
            circuit.switches[number] = star = fault.star(circuit.switches[number].start)
            matrix.conductance[number] = star.conductances()
        self.parts.switches.known[:] = 0  # factors of other resistances
        actions = np.array([row_of(action) for action in self._plan()], dtype=np.int64).reshape(-1, 5)
        self.restore(self._new._replace(actions=()))
        self.make_room(len(actions))
        put_actions(self.parts.switches, actions)

    def _plan(self) -> list[Action]:
        """What is to happen, from the state before it; and the notes."""
        planned = [item.actions(self._model, self._steady) for item in self.tables.items()]
        self.notes = self._model.circuit.notes + [note for _, notes in planned for note in notes]
        return [action for actions, _ in planned for action in actions]

    # ------------------------------------------------------------------ running

    def advance(self, n: int) -> int:
        """Computes up to ``n`` samples into `samples`, and stops after the sample in which a pole or a fault
        changed; returns their number, at least 1."""
        if n < 1:
            raise ValueError(f"advance needs n >= 1, not {n}")
        if len(self._samples) < n:
            self._samples = np.empty((n, measured_rows(self.tables.relay), 6))
        control = self._control
        control["row"], control["wanted"], control["foresees"] = 0, n, 0
        m = advance(*self.parts, self._samples)
        told = self.parts.switches.change[: int(control["changes"])].tolist()
        self.changes = [Change(t, "pole" if is_pole else "fault", i, v) for t, is_pole, i, v in told]
        self.samples = self._samples[:m]
        return m

    @property
    def sample_count(self) -> int:
        """Samples taken since the start."""
        return int(self._control["sample"])

    @property
    def samples_before_actions(self) -> int:
        """Samples from 0 on that are made before the first step at which anything is due."""
        return next_step(self.parts.switches) // self.steps_per_sample

    @property
    def _control(self) -> Any:
        return self.parts.switches.control[0]

    def history(self, n: int) -> NDArray[np.float64]:
        """The ``n`` samples before sample 0, (n, rows, 6), of the steady state that the run begins in.

        Systems that slip against each other do so from step 0 on: until then they stand as they do there, or
        the time before the run would hold a pole slip that never was.
        """
        steps = np.arange(-n, 0)[:, None, None] * self.steps_per_sample
        values = np.zeros((n, measured_rows(self.tables.relay), 6))
        for angle, phasors in self._standing():
            values += (phasors * np.exp(1j * angle * steps)).real
        convert_block(self.parts.front, -n, values, values)
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
        self.make_room()
        self.order(list(self._breakers).index(breaker), action == "open", poles_mask, t_ns)

    def order(self, breaker: int, opens: bool, poles: int, t_ns: int) -> None:
        """`command`, unchecked, where the plant may have run ahead of it; ``breaker`` by its number."""
        switches = self.parts.switches
        switch, close_ns, open_ns = switches.breaker[breaker].tolist()
        at_ns = t_ns + (open_ns if opens else close_ns)
        step = max(-(-at_ns * self._rate // NS), int(self.parts.watch.clock[STEP]))
        action = np.array(row_of(Action(step, "part" if opens else "make", switch, poles)))
        self._control["actions"] = take_in_python(switches.pending, int(self._control["actions"]), action)

    def take_orders(self) -> None:
        """What the compiled loop has ordered, where it waits for room."""
        self.make_room()
        for t_ns, breaker, opens, poles in self.parts.switches.order[: int(self._control["orders"])].tolist():
            self.order(breaker, bool(opens), poles, t_ns)
        self._control["orders"] = 0
        self.make_room()

    def make_room(self, actions: int = 0) -> None:
        """For `ROOM` more commands, and as many actions."""
        switches = self.parts.switches
        if (more := int(self._control["actions"]) + actions + ROOM) > len(switches.pending):
            pending = np.concatenate([switches.pending, np.zeros((more, 5), dtype=np.int64)])
            change = np.zeros(len(switches.change) + 4 * more, switches.change.dtype)
            self.parts = self.parts._replace(switches=switches._replace(pending=pending, change=change))

    def closed(self, breaker: str) -> int:
        """Mask of the breaker's conducting poles, now."""
        if breaker not in self._breakers:
            raise InputError(f"there is no breaker '{breaker}'; {nearest(breaker, self._breakers)}")
        return int(self.parts.switches.masks[self._switch_of(breaker)])

    def save(self) -> PlantState:
        """A copy of everything that changes."""
        watch, switches = self.parts.watch, self.parts.switches
        return PlantState(
            self._buffer.copy(),
            watch.clock.copy(),
            watch.armed.copy(),
            switches.masks.copy(),
            saved_actions(switches),
            self.sample_count,
        )

    def restore(self, state: PlantState) -> None:
        """Back to a saved state; what follows is the same to the bit."""
        self._buffer[:] = state.buffer
        self.parts.watch.clock[:] = state.clock
        self.parts.watch.armed[:] = state.armed
        self.parts.switches.masks[:] = state.masks
        put_actions(self.parts.switches, state.actions)
        self._control["sample"] = state.sample_count
        self.changes = []

    def go_on_from(self, state: PlantState) -> None:
        """`restore`, but for what is due."""
        self.restore(state._replace(actions=saved_actions(self.parts.switches)))

    @property
    def probe(self) -> Probe:
        """Any voltage and current of the network, now."""
        return Probe(self._model, self._model.factor(self.parts.switches.masks), self.parts.state)

    def _switch_of(self, breaker: str) -> int:
        return self._model.circuit.number[Breaker.table, breaker]

    # ------------------------------------------------------------------ setting up

    def _front_ends(self) -> FrontEnds:
        """Where each relay's voltage and current come from."""
        circuit, row = self._model.circuit, self._model.row
        bus, terms, others = [], [], []
        for number, relay in enumerate(self.tables.relay):
            line = self.tables.find(Line, relay.line, f"relay[{relay.name}].line")
            nodes = [line.bus(relay.end), circuit.terminals[relay.line, relay.end]]
            own, other = nodes if relay.voltage_at == "bus" else nodes[::-1]
            bus.append(row[own])
            parts = circuit.terms[relay.line, relay.end]
            terms.append([(circuit.current_row(kind, i), sign) for kind, i, sign in parts])
            if relay.synchro_vt:
                others.append((number, row[other]))
        return front_ends(self.tables, bus, terms, others, float(self._rate))

    def _settle(self, steady: list[Steady], front: FrontEnds, state: State) -> None:
        """The state of an eternal run at step 0."""
        fill(self._model, steady, state)
        self._before: list[tuple[float, NDArray[np.complex128]]] = []
        for s in steady:
            x = np.zeros((len(front.bus), 6), dtype=complex)
            for i in range(len(x)):
                x[i, :3] = s.v[front.bus[i]] * ROTATION
                span = slice(front.pointer[i], front.pointer[i + 1])
                x[i, 3:] = (front.sign[span] * s.current[front.term[span]]).sum() * ROTATION
            self._before.append((s.angle, settle(front, state.analog, x, s.angle)))
        magnetize(front, state.analog, self.tables)

    def _now_ns(self) -> int:
        return int(self.parts.watch.clock[STEP]) * NS // self._rate


def _contiguous(constants: Any) -> Any:
    """Constants of which every array is laid out row by row: who calls a kernel by address calls it with the
    same types for every network."""
    if isinstance(constants, np.ndarray):
        return np.ascontiguousarray(constants)
    return constants._make(_contiguous(part) for part in constants)


def _new_state(model: Model, front: FrontEnds) -> tuple[NDArray[np.float64], State]:
    branches, waves = len(model.circuit.branches), len(model.circuit.sections)
    rows, currents = len(model.row), branches + 2 * waves + len(model.circuit.switches)
    length = ring_length(model.circuit.rate, model.circuit.frequency_hz)
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
        "converter": (len(model.circuit.converters), FIELDS),
        "past": (len(model.circuit.converters), length, 2),
        "measured": (len(front.bus), 6),
    } | analog_shapes(front)
    return new_state(shapes, (branches, 2 * waves))


class Plants:
    """Plants for one run after the other: what does not change from run to run is made once."""

    def __init__(self) -> None:
        self._kept: list[Plant] = []

    def plant(self, tables: PlantTables) -> Plant:
        """As ``Plant(tables)``; the one that was given before may be the same.  Raises InputError."""
        for place, plant in enumerate(self._kept):
            if plant.tables.is_same_network(tables):
                self._kept.insert(0, self._kept.pop(place))
                plant.begin_again(tables)
                return plant
        plant = Plant(tables)
        self._kept = [plant, *self._kept[: KEPT_PLANTS - 1]]
        return plant
