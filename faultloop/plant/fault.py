"""``[[fault]]``: on a line or at a bus, at a time or at a point on the wave of the voltage before it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, ClassVar, Literal, Self, get_args

import numpy as np
from pydantic import Field, model_validator

from faultloop.config.tables import Name, NonNegative, Number, Seconds
from faultloop.errors import InputError
from faultloop.plant.circuit import SAME_POINT, Circuit
from faultloop.plant.component import Component, PlantTables
from faultloop.plant.elements import Complex, Floats
from faultloop.plant.elements.switch import Action, Star
from faultloop.plant.elements.varistor import Varistor
from faultloop.plant.line import ENDS, Line
from faultloop.plant.network import Model
from faultloop.plant.steady import ROTATION, Steady, voltage

FaultType = Literal["AG", "BG", "CG", "AB", "BC", "CA", "ABG", "BCG", "CAG", "ABC", "ABCG"]
FAULT_TYPES: tuple[FaultType, ...] = get_args(FaultType)
TINY = 1e-9
KEPT_WAVES = 64
ARC_A, ARC_EXPONENT = 1000.0, 40.0
"""Current at which an arc has its voltage, and how flat that is: i ~ v^40, 6 % more at ten times the
current."""


class Fault(Component):
    """``at_km`` or ``at_pu`` count from the line's ``from`` end.  It begins on a step of the plant."""

    table: ClassVar[str] = "fault"
    letter: ClassVar[str] = "F"

    name: Name = ""
    """F1, F2, ... where not given."""
    line: Name | None = None
    """Where it is: a line with `at_km` or `at_pu`, or a `bus`."""
    at_km: NonNegative | None = None
    """From the line's `from` end."""
    at_pu: Annotated[float, Field(ge=0, le=1)] | None = None
    """The same as a part of the line."""
    bus: Name | None = None
    """In place of a line."""
    type: FaultType
    """Phases, and G where ground is in it."""
    start_s: Seconds | None = None
    """When it begins, at the nearest step; or `angle_deg`."""
    angle_deg: Number | None = None
    """Point on wave: the angle of the first faulted phase's voltage (of A to B for AB, and so on, where no
    ground is involved), 0 at its rising zero."""
    after_s: Seconds = 0.0
    """With ``angle_deg``: not before this time."""
    resistance_ohm: Annotated[float, Field(ge=0, le=1e9)] = 0.0
    """From each faulted phase to their common point."""
    ground_ohm: Annotated[float, Field(ge=0, le=1e9)] = 0.0
    """From the common point to ground."""
    arc_kv: Annotated[float, Field(gt=0, le=1e3)] | None = None
    """Peak voltage of an arc in each faulted phase, before the resistances: nearly the same at any current
    (some 1.2 kV for each metre of its length); none where not given.  Of faults to ground only."""
    duration_s: Annotated[float, Field(gt=0, le=1e6)] | None = None
    """Removed after this time, each phase at its current zero; permanent where not given."""

    @model_validator(mode="after")
    def _placed_and_timed(self) -> Fault:
        if (self.line is None) == (self.bus is None):
            raise ValueError("give either line (with at_km or at_pu) or bus")
        if self.line is not None and (self.at_km is None) == (self.at_pu is None):
            raise ValueError("a fault on a line needs either at_km or at_pu")
        if self.bus is not None and not (self.at_km is None and self.at_pu is None):
            raise ValueError("at_km and at_pu belong to a fault on a line")
        if (self.start_s is None) == (self.angle_deg is None):
            raise ValueError("give either start_s or angle_deg (with after_s)")
        if self.ground_ohm and not self.type.endswith("G"):
            raise ValueError(f"ground_ohm belongs to a fault to ground, not to {self.type}")
        if self.arc_kv is not None and not self.type.endswith("G"):
            # its varistors see each other alone, and take their currents from ground (`varistor.conduct`)
            raise ValueError(
                f"arc_kv belongs to a fault to ground: of {self.type} no current would be found; take "
                f"{self.type}G, or resistance_ohm: 4 / pi of the arc's voltage over the current's peak"
            )
        return self

    def check(self, tables: PlantTables) -> None:
        if self.line is not None:
            length = tables.find(Line, self.line, self.key("line")).length_km
            if self.at_km is not None and self.at_km > length:
                raise InputError(
                    f"{self.at_km:g} is beyond line '{self.line}' of {length:g} km", key=self.key("at_km")
                )
        if self.bus is not None:
            tables.known_bus(self.bus, self.key("bus"))
        at, start = ("after_s", self.after_s) if self.start_s is None else ("start_s", self.start_s)
        tables.within_run(start, self.key(at))

    def position(self, line: Line) -> float:
        """From the line's ``from`` end [pu]; exactly 0 or 1 at the ends."""
        pu = self.at_pu if self.at_pu is not None else (self.at_km or 0.0) / line.length_km
        return round(pu) * 1.0 if abs(pu - round(pu)) <= SAME_POINT else pu

    def cuts(self, tables: PlantTables) -> list[tuple[str, float]]:
        if self.line is None:
            return []
        return [(self.line, self.position(tables.find(Line, self.line, self.key("line"))))]

    def as_network(self) -> object:
        return self.name, self.line, self.at_km, self.at_pu, self.bus, self.arc_kv

    def foot(self, circuit: Circuit, node: str) -> str:
        """Where its switch is: behind the arc, which is of the same kind as a varistor."""
        if self.arc_kv is None:
            return node
        foot = f"arc {self.name}"
        circuit.varistors.append(Varistor(node, foot, self.arc_kv * 1e3, ARC_A, ARC_EXPONENT))
        return foot

    def star(self, node: str) -> Star:
        """Its switch, at a node."""
        ground = self.ground_ohm if self.type.endswith("G") else math.inf
        return Star(node, self.resistance_ohm, ground)

    def add(self, circuit: Circuit, tables: PlantTables) -> None:
        if self.bus is not None:
            circuit.add_switch(self.table, self.name, self.star(self.foot(circuit, self.bus)))
            return
        assert self.line is not None
        line = tables.find(Line, self.line, self.key("line"))
        node = circuit.node_at(line.name, self.position(line))
        number = circuit.add_switch(self.table, self.name, self.star(self.foot(circuit, node)))
        for place, end in enumerate(ENDS):
            # it lies beyond the current transformer, which must see it (with a breaker it does)
            if self.position(line) == place and line.bus(end) == circuit.terminals[line.name, end]:
                circuit.terms[line.name, end].append(("switch", number, 1.0))

    def actions(self, model: Model, steady: Sequence[Steady]) -> tuple[list[Action], list[str]]:
        """Raises InputError where there is no voltage to take an angle of."""
        rate = model.circuit.rate
        switch = model.circuit.number[self.table, self.name]
        if self.start_s is not None:
            exact = self.start_s * rate
        else:
            before = {arc.end: arc.start for arc in model.circuit.varistors}
            foot = model.circuit.switches[switch].start
            exact = self._point_on_wave(model, steady, before.get(foot, foot))
        on = round(exact)
        mask = sum(1 << "ABC".index(phase) for phase in self.type.rstrip("G"))
        actions = [Action(on, "make", switch, mask)]
        if self.duration_s is not None:
            actions.append(Action(on + max(1, round(self.duration_s * rate)), "part", switch, mask))
        notes = []
        if abs(exact - on) > TINY * max(1.0, exact):
            notes.append(
                f"fault {self.name}: begins at {on / rate * 1e3:.6f} ms, "
                f"the step nearest to {exact / rate * 1e3:.6f} ms"
            )
        return actions, notes

    def beginning_at(self, begins_s: float, tables: PlantTables) -> Self | None:
        """A fault that is on begins with the new run; the transient of its beginning is not there."""
        key = "after_s" if self.start_s is None else "start_s"
        start_s = getattr(self, key) - begins_s
        if start_s >= 0:
            return self.model_copy(update={key: start_s})
        duration_s = None if self.duration_s is None else self.duration_s + start_s
        if duration_s is not None and duration_s <= 0:
            return None
        return self.model_copy(update={"start_s": 0.0, "angle_deg": None, "duration_s": duration_s})

    def _point_on_wave(self, model: Model, steady: Sequence[Steady], node: str) -> float:
        """First time [steps], not before ``after_s``, at which the fault's voltage has its angle; 0 is the
        rising zero.  The voltage is the one before any fault."""
        assert self.angle_deg is not None
        start = self.after_s * model.circuit.rate
        steps, turns = self._wave(model, steady, node, start)
        # sin-angle of the wave less the one wanted, in turns: a whole number at the instants sought
        turns = turns - self.angle_deg / 360
        for whole in range(int(np.ceil(turns[0] - TINY)), int(turns.max()) + 2):
            at = float(np.interp(whole, turns, steps))
            if at >= start - TINY:
                return at
        raise AssertionError("two cycles hold every angle")

    def _wave(self, model: Model, steady: Sequence[Steady], node: str, start: float) -> tuple[Floats, Floats]:
        """Steps from ``start`` on, and sin-angles of the fault's voltage at them [turns]."""
        known = model.waves.get((node, self.type, start))
        if known is not None:
            return known
        slowest = min(s.angle for s in steady)
        steps = np.arange(np.floor(start), np.ceil(start + 2 * 2 * np.pi / slowest) + 1)
        signal = fault_voltage(voltage(model, steady, node, steps), self.type)
        if np.abs(signal).min() < TINY * model.circuit.base_v:
            raise InputError(
                "there is no voltage at the fault to take an angle of; give start_s",
                key=self.key("angle_deg"),
            )
        if len(model.waves) >= KEPT_WAVES:
            model.waves.clear()
        wave = steps, np.unwrap(np.angle(signal)) / (2 * np.pi) + 0.25
        model.waves[node, self.type, start] = wave
        return wave


def fault_voltage(a: Complex, kind: str) -> Complex:
    """The voltage that a fault type's angle is taken of, from phase A's: the first faulted phase to ground,
    or to the second phase for AB, BC and CA."""
    first = a * ROTATION["ABC".index(kind[0])]
    if kind in ("AB", "BC", "CA"):
        return first - a * ROTATION["ABC".index(kind[1])]
    return first
