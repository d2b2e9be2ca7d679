"""What the inverters of a network do before the run: the voltages behind which they deliver their power."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from faultloop.errors import InputError
from faultloop.plant.elements.converter import SUPPORT_BELOW
from faultloop.plant.network import Model
from faultloop.plant.steady import derivative, solve_at

ROUNDS, CLOSE = 500, 1e-13
"""Of the fixed point, and the change of a current per unit at which it ends."""
UNFED = 1e-6
"""Voltage per unit that the sources leave at an inverter's bus behind its filter: below, there is none."""


def balance(model: Model) -> None:
    """Sets magnitude and phase of every converter's voltage, so that each delivers its power at unity power
    factor at its bus.  The network is linear: V = V0 + Z I; with I = conj(2 P / 3 V) a fixed point.

    Raises InputError where the network cannot take the power."""
    circuit, converters = model.circuit, model.circuit.converters
    if not converters:
        return
    count, angle = len(converters), 2 * np.pi * circuit.frequency_hz * circuit.dt
    buses = [model.row[c.bus] for c in converters]

    def voltages(wanted: np.ndarray) -> np.ndarray:
        """At the buses, with these voltages behind the filters."""
        for c, e in zip(converters, wanted.tolist(), strict=True):
            emf = circuit.emfs[c.emf]
            circuit.emfs[c.emf] = replace(emf, amplitude=abs(e), phase=float(np.angle(e)))
        return solve_at(model, circuit.frequency_hz).v[buses]

    alone = voltages(np.zeros(count, complex))
    _check_fed(model, alone)
    unit = np.diag([c.base_v for c in converters])
    alike = zip(unit + 0j, converters, strict=True)
    gain = np.stack([(voltages(row) - alone) / c.base_v for row, c in alike], 1)
    behind = np.diag(
        [1 / circuit.emfs[c.emf].behind.admittance(derivative(angle, circuit.dt)) for c in converters]
    )
    left = np.linalg.inv(np.eye(count) - gain)
    v, impedance = left @ alone, left @ gain @ behind
    open_v, base = v, np.array([c.base_a for c in converters])
    power = np.array([c.power * c.rated_va for c in converters])
    current = np.zeros(count, complex)
    for _ in range(ROUNDS):
        new = np.conj(2 / 3 * power / v)
        change = np.max(np.abs(new - current) / base)
        current = new
        v = open_v + impedance @ current
        if change < CLOSE:
            _check_voltages(model, v)
            voltages(v + behind @ current)
            return
    key = f"inverter[{_names(model)[0]}].power_mw"
    raise InputError("the network cannot take this power; give less, or a stronger network", key=key)


def _check_fed(model: Model, alone: np.ndarray) -> None:
    """An inverter that follows the network needs one: through closed breakers, as they stand at the start."""
    for name, converter, size in zip(
        _names(model), model.circuit.converters, np.abs(alone).tolist(), strict=True
    ):
        if size < UNFED * converter.base_v:
            what = (
                f"bus '{converter.bus}' reaches no source through closed breakers, and an inverter holds no "
                "island alone; give its island a [[source]] or close a breaker to the rest"
            )
            raise InputError(what, key=f"inverter[{name}].bus")


def _check_voltages(model: Model, v: np.ndarray) -> None:
    """Below a limit an inverter gives reactive current: that is no power at unity power factor."""
    for name, converter, size in zip(
        _names(model), model.circuit.converters, np.abs(v).tolist(), strict=True
    ):
        if size < SUPPORT_BELOW * converter.base_v:
            what = f"its bus would be at {size / converter.base_v:.2f} per unit, below {SUPPORT_BELOW:g}"
            raise InputError(f"{what}; give less, or a stronger network", key=f"inverter[{name}].power_mw")


def _names(model: Model) -> list[str]:
    return [name for (table, name) in model.circuit.number if table == "inverter"]
