"""The network as its machines see it: Kron-reduced to their terminals, before, during and after a fault.

Loads are constant admittances at the load flow's voltage, as usual for a first-swing study.  The reduction
keeps the terminals and not the nodes behind the transient reactances: with x'd and x'q unequal there are no
such nodes, the machine's own impedance turns with its rotor (swing.py).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from faultloop.errors import InputError
from faultloop.study.papers.ckmc.machines.data import System

Complex = NDArray[np.complex128]


@dataclass(frozen=True)
class LineFault:
    """A bolted three-phase fault on a line, which is then taken out of service.

    Attributes
    ----------
    line : its two bus numbers.
    at_pu : place from the first, 0 to 1; 0 and 1 are the buses themselves.
    start_s, duration_s : from the fault to the opening of both ends.
    """

    line: tuple[int, int]
    at_pu: float
    start_s: float
    duration_s: float


def admittance(system: System) -> Complex:
    """(buses, buses) nodal admittance matrix [pu], loads and shunts in it."""
    y = np.diag(np.conj(system.load) / np.abs(system.voltage) ** 2 + system.shunt)
    for (f, t), z, b, a in zip(system.branches, system.impedance, system.charging, system.tap, strict=True):
        y[f, f] += (1 / z + 0.5j * b) / a**2
        y[t, t] += 1 / z + 0.5j * b
        y[f, t] -= 1 / (z * a)
        y[t, f] -= 1 / (z * a)
    return y


def reduced(y: Complex, keep: NDArray[np.intp], grounded: int | None = None) -> Complex:
    """Kron reduction to the buses ``keep`` (m,), with one bus at zero volts if any: (m, m) admittance."""
    inner = np.array([b for b in range(len(y)) if b not in keep and b != grounded])
    return y[keep][:, keep] - y[keep][:, inner] @ np.linalg.solve(y[inner][:, inner], y[inner][:, keep])


def without_line(system: System, line: tuple[int, int]) -> System:
    """The system with a line out of service.  Raises InputError where there is no such line."""
    rest = np.arange(len(system.branches)) != _branch(system, line)
    return replace(
        system,
        branches=system.branches[rest],
        impedance=system.impedance[rest],
        charging=system.charging[rest],
        tap=system.tap[rest],
    )


def faulted(system: System, fault: LineFault) -> Complex:
    """(m, m) reduced admittance with the fault on: the line in two sections, grounded between them."""
    y = admittance(without_line(system, fault.line))
    k = _branch(system, fault.line)
    near, far = (system.buses.index(bus) for bus in fault.line)
    if fault.at_pu in (0.0, 1.0):
        y = admittance(system)
        return reduced(y, system.machine_bus, near if fault.at_pu == 0.0 else far)
    for bus, part in ((near, fault.at_pu), (far, 1 - fault.at_pu)):
        y[bus, bus] += 1 / (part * system.impedance[k]) + 0.5j * part * system.charging[k]
    return reduced(y, system.machine_bus)


def reduced_impedances(system: System, fault: LineFault) -> Complex:
    """(3, m, m) impedance matrices [pu] between the machines' terminals: before, during and after the fault.

    Raises InputError where there is no such line, it is a transformer, or ``at_pu`` is not from 0 to 1.
    """
    k = _branch(system, fault.line)
    if system.tap[k] != 1 or system.charging[k] == 0:
        raise InputError(f"{fault.line[0]}-{fault.line[1]} is a transformer; the fault should be on a line")
    if not 0 <= fault.at_pu <= 1:
        raise InputError(f"should be from 0 to 1, not {fault.at_pu:g}", key="at_pu")
    if set(fault.line) & {system.buses[b] for b in system.machine_bus} and fault.at_pu in (0.0, 1.0):
        raise InputError("the fault should not be at a machine's own terminals", key="at_pu")
    before = reduced(admittance(system), system.machine_bus)
    after = reduced(admittance(without_line(system, fault.line)), system.machine_bus)
    stages = np.stack([before, faulted(system, fault), after])
    return np.asarray(np.linalg.inv(stages), dtype=np.complex128)


def _branch(system: System, line: tuple[int, int]) -> int:
    for k, ends in enumerate(system.branches):
        if {system.buses[b] for b in ends} == set(line):
            return k
    raise InputError(f"there is no line {line[0]}-{line[1]}")
