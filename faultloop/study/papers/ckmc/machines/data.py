"""A power system by its load flow: branches, buses, generators, on one base."""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from faultloop.errors import InputError
from faultloop.study.papers.ckmc.machines import machine

Array = NDArray[np.float64]

BASE_MVA = 100.0
FILES = {
    "buses.csv": ("bus", "vm_pu", "va_deg", "load_mw", "load_mvar", "shunt_mvar"),
    "branches.csv": ("from_bus", "to_bus", "r_pu", "x_pu", "b_pu", "tap_ratio"),
    "generators.csv": (
        *("bus", "p_mw", "q_mvar", "td0_s", "tq0_s", "h_s", "d_pu"),
        *("xd_pu", "xq_pu", "xd1_pu", "xq1_pu"),
    ),
}
POSITIVE = {
    "buses.csv": ("vm_pu",),
    "branches.csv": ("tap_ratio",),
    "generators.csv": ("td0_s", "tq0_s", "h_s", "xd_pu", "xq_pu", "xd1_pu", "xq1_pu"),
}
OPTIONAL = {"tap_ratio": 1.0}


@dataclass(frozen=True)
class System:
    """A solved load flow and its machines, per unit on 100 MVA.

    Attributes
    ----------
    buses : bus numbers.
    voltage : (buses,) complex, the solved load flow.
    load, shunt : (buses,) complex, power drawn, and susceptive power fed in at 1 pu.
    branches : (k, 2) places in ``buses``; the tap is at the first.
    impedance, charging, tap : (k,) of the branches.
    machine_bus : (m,) places in ``buses``.
    dispatch : (m,) complex, power of the machines in the load flow.
    parameters : (m, 9), rows of ``machine.PARAMETERS``; their step is NaN.
    frequency_hz : nominal.
    """

    buses: tuple[int, ...]
    voltage: NDArray[np.complex128]
    load: NDArray[np.complex128]
    shunt: NDArray[np.complex128]
    branches: NDArray[np.intp]
    impedance: NDArray[np.complex128]
    charging: Array
    tap: Array
    machine_bus: NDArray[np.intp]
    dispatch: NDArray[np.complex128]
    parameters: Array
    frequency_hz: float

    def machine_at(self, bus: int) -> int:
        """The place of the machine at a bus.  Raises InputError where there is none."""
        at = [self.buses[b] for b in self.machine_bus]
        if bus not in at:
            raise InputError(f"there is no machine at bus {bus}; there are at {', '.join(map(str, at))}")
        return at.index(bus)


def read_system(folder: Path, frequency_hz: float = 60.0) -> System:
    """Read ``buses.csv``, ``branches.csv`` and ``generators.csv`` (their columns: ``FILES``).

    Raises InputError for a missing or unreadable file, a missing column, a cell that is no number, an unknown
    bus, a branch without reactance, or a voltage, tap or machine's constant that is not positive.
    """
    buses, branches, machines = (_read(folder / name, columns) for name, columns in FILES.items())
    numbers = tuple(int(n) for n in buses["bus"])
    if not np.all(branches["x_pu"] > 0):
        raise InputError("a branch needs a positive reactance", file=folder / "branches.csv", key="x_pu")
    ends = [_places(branches[key], numbers, folder / "branches.csv", key) for key in ("from_bus", "to_bus")]
    w0 = 2 * math.pi * frequency_hz
    parameters = np.column_stack(
        [
            2 * machines["h_s"] / w0,
            machines["d_pu"] / w0,
            *(machines[key] for key in ("xd_pu", "xq_pu", "xd1_pu", "xq1_pu", "td0_s", "tq0_s")),
            np.full(len(machines["bus"]), math.nan),
        ]
    )
    assert parameters.shape[1] == len(machine.PARAMETERS)
    return System(
        buses=numbers,
        voltage=_complex(buses["vm_pu"] * np.exp(1j * np.deg2rad(buses["va_deg"]))),
        load=_complex(buses["load_mw"] + 1j * buses["load_mvar"]) / BASE_MVA,
        shunt=_complex(1j * buses["shunt_mvar"]) / BASE_MVA,
        branches=np.column_stack(ends),
        impedance=_complex(branches["r_pu"] + 1j * branches["x_pu"]),
        charging=branches["b_pu"],
        tap=branches["tap_ratio"],
        machine_bus=_places(machines["bus"], numbers, folder / "generators.csv", "bus"),
        dispatch=_complex(machines["p_mw"] + 1j * machines["q_mvar"]) / BASE_MVA,
        parameters=parameters,
        frequency_hz=frequency_hz,
    )


def _read(path: Path, columns: tuple[str, ...]) -> dict[str, Array]:
    if not path.is_file():
        raise InputError(f"no such file; the system's folder needs {', '.join(FILES)}", file=path)
    try:
        with path.open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"cannot be read as CSV: {error}", file=path) from error
    if not rows or any(c not in rows[0] for c in columns):
        raise InputError(f"needs rows with the columns {', '.join(columns)}", file=path)
    table = {c: np.array([_number(row[c], path, c, n) for n, row in enumerate(rows, 2)]) for c in columns}
    for key in POSITIVE.get(path.name, ()):
        if not np.all(table[key] > 0):
            raise InputError("should be positive in every row", file=path, key=key)
    return table


def _complex(values: object) -> NDArray[np.complex128]:
    return np.asarray(values, dtype=np.complex128)


def _number(text: str | None, path: Path, column: str, line: int) -> float:
    if not text and column in OPTIONAL:
        return OPTIONAL[column]
    try:
        value = float(text or "")
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(f"'{text}' should be a number", file=path, key=f"line {line}, {column}")
    return value


def _places(numbers: Array, buses: tuple[int, ...], path: Path, key: str) -> NDArray[np.intp]:
    unknown = [n for n in numbers if n not in buses]
    if unknown:
        raise InputError(f"bus {unknown[0]:.0f} is not in buses.csv", file=path, key=key)
    return np.array([buses.index(int(n)) for n in numbers])


def with_damping(system: System, per_s: float) -> System:
    """The same with a damping torque that lets each machine's speed decay at ``per_s`` [1/s].

    That is D / 2H of the inertia constant H [s] and the damping coefficient D [pu torque per pu speed].
    Raises InputError for a negative one.
    """
    if not per_s >= 0:
        raise InputError(f"{per_s:g} should not be negative", key="per_s")
    parameters = system.parameters.copy()
    parameters[:, machine.DAMPING] = per_s * parameters[:, machine.INERTIA]
    return replace(system, parameters=parameters)
