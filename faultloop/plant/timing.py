"""When faults begin: at a time, or at a point on the wave of the pre-fault voltage; always on a step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from faultloop.config.scenario import Fault
from faultloop.errors import InputError
from faultloop.plant.network import Model
from faultloop.plant.steady import ROTATION, Steady, voltage

TINY = 1e-9


@dataclass(frozen=True)
class FaultTime:
    """Steps at which a fault begins and from which its phases clear (None: never)."""

    on: int
    off: int | None
    notes: list[str]


def fault_times(model: Model, steady: list[Steady]) -> list[FaultTime]:
    """Of every fault of the scenario.  Raises InputError where there is no voltage to take an angle of."""
    circuit = model.circuit
    return [
        _fault_time(model, steady, fault, node)
        for fault, node in zip(circuit.scenario.fault, circuit.fault_nodes, strict=True)
    ]


def _fault_time(model: Model, steady: list[Steady], fault: Fault, node: str) -> FaultTime:
    rate = model.circuit.rate
    if fault.start_s is not None:
        exact = fault.start_s * rate
    else:
        exact = _point_on_wave(model, steady, fault, node)
    on = round(exact)
    off = None if fault.duration_s is None else on + max(1, round(fault.duration_s * rate))
    notes = []
    if abs(exact - on) > TINY * max(1.0, exact):
        notes.append(
            f"fault {fault.name}: begins at {on / rate * 1e3:.6f} ms, "
            f"the step nearest to {exact / rate * 1e3:.6f} ms"
        )
    return FaultTime(on, off, notes)


def _point_on_wave(model: Model, steady: list[Steady], fault: Fault, node: str) -> float:
    """First time [steps], not before ``after_s``, at which the fault's voltage has its angle; 0 is the rising
    zero.  The voltage is the one before any fault."""
    rate = model.circuit.rate
    assert fault.angle_deg is not None
    start = fault.after_s * rate
    slowest = min(s.angle for s in steady)
    steps = np.arange(np.floor(start), np.ceil(start + 2 * 2 * np.pi / slowest) + 1)
    signal = fault_voltage(voltage(model, steady, node, steps), fault.type)
    if np.abs(signal).min() < TINY * model.circuit.scenario.system.base_kv * 1e3:
        raise InputError(
            "there is no voltage at the fault to take an angle of; give start_s",
            key=f"fault[{fault.name}].angle_deg",
        )
    # sin-angle of the wave less the one wanted, in turns: a whole number at the instants sought
    turns = np.unwrap(np.angle(signal)) / (2 * np.pi) + 0.25 - fault.angle_deg / 360
    for whole in range(int(np.ceil(turns[0] - TINY)), int(turns.max()) + 2):
        at = float(np.interp(whole, turns, steps))
        if at >= start - TINY:
            return at
    raise AssertionError("two cycles hold every angle")


def fault_voltage(a: NDArray[np.complex128], kind: str) -> NDArray[np.complex128]:
    """The voltage that a fault type's angle is taken of, from phase A's: the first faulted phase to ground,
    or to the second phase for AB, BC and CA."""
    first = a * ROTATION["ABC".index(kind[0])]
    if kind in ("AB", "BC", "CA"):
        return first - a * ROTATION["ABC".index(kind[1])]
    return first
