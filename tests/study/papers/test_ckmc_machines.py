"""Swinging machines: at rest from the load flow, and against the unreduced network under scipy's solver."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from faultloop.errors import InputError
from faultloop.study.papers.ckmc.cases import data_folder
from faultloop.study.papers.ckmc.machines import (
    Exciter,
    LineFault,
    System,
    read_system,
    reduced_impedances,
    simulate,
    steady_state,
    with_damping,
)
from faultloop.study.papers.ckmc.machines.network import admittance, without_line
from faultloop.study.papers.ckmc.machines.swing import derivatives, prepare

FAULT = LineFault((16, 21), 0.4, 0.1, 0.2)
EXCITER = Exciter(gain=20.0)


@pytest.fixture(scope="module")
def system() -> System:
    return with_damping(read_system(data_folder()), 1.0)


def test_at_rest_nothing_moves(system: System) -> None:
    x, machines, work = prepare(system, FAULT, EXCITER, 1e-3)
    dx = np.full_like(x, np.nan)
    derivatives(x, machines, 0, work, dx)
    assert np.abs(dx).max() < 1e-9
    swing = simulate(system, replace(FAULT, start_s=5.0), 1.0, every=100)
    assert np.abs(swing.states - swing.states[0]).max() < 1e-9


def test_the_rest_is_the_load_flow(system: System) -> None:
    rest = steady_state(system)
    i = rest.inputs[:, 2] + 1j * rest.inputs[:, 3]
    power = system.voltage[system.machine_bus] * np.conj(i)
    assert np.abs(power - system.dispatch).max() < 2e-3  # the data's own mismatch
    assert rest.inputs[:, 0] == pytest.approx(power.real, abs=1e-12)  # no armature resistance


def test_turning_the_load_flow_turns_the_rotors(system: System) -> None:
    turned = replace(system, voltage=system.voltage * np.exp(0.7j))
    a, b = (simulate(s, FAULT, 1.0, exciter=EXCITER, every=50) for s in (system, turned))
    assert b.states[..., 0] - a.states[..., 0] == pytest.approx(0.7, abs=1e-8)
    assert b.states[..., 1:] == pytest.approx(a.states[..., 1:], abs=1e-8)


def unreduced(system: System, stage: int):
    """All buses and a node for the fault, held at zero by a shunt of 1e9 pu; machines as Norton sources.

    Written from the equations with complex numbers, without the package's reduction and machine.
    """
    near, far = (system.buses.index(b) for b in FAULT.line)
    y = np.zeros((40, 40), dtype=complex)
    y[:39, :39] = admittance(without_line(system, FAULT.line) if stage else system)
    y[39, 39] = 1e9
    if stage == 1:
        k = next(k for k, ends in enumerate(system.branches) if set(ends) == {near, far})
        for bus, part in ((near, FAULT.at_pu), (far, 1 - FAULT.at_pu)):
            series, shunt = 1 / (part * system.impedance[k]), 0.5j * part * system.charging[k]
            y[[bus, 39], [bus, 39]] += series + shunt
            y[bus, 39] -= series
            y[39, bus] -= series
    real = np.block([[y.real, -y.imag], [y.imag, y.real]])
    bus = system.machine_bus
    inertia, damping, xd, xq, xd1, xq1, td0, tq0, _ = system.parameters.T
    rest = steady_state(system)
    v0, (tm, ufd0) = np.abs(system.voltage[bus]), rest.inputs[:, :2].T

    def rhs(t: float, flat: np.ndarray) -> np.ndarray:
        delta, omega, eq, ed, ufd = flat.reshape(5, -1)
        g = real.copy()
        e = ed * np.exp(1j * (delta - np.pi / 2)) + eq * np.exp(1j * delta)
        # i = B (e - v): d leads to q by the quadrature reactances, so B is a real 2 x 2 for each machine.
        injected = np.zeros(80)
        gain = []
        for k, n in enumerate(bus):
            turn = np.array([[np.sin(delta[k]), -np.cos(delta[k])], [np.cos(delta[k]), np.sin(delta[k])]])
            own = turn.T @ np.array([[0, 1 / xd1[k]], [-1 / xq1[k], 0]]) @ turn
            g[np.ix_([n, n + 40], [n, n + 40])] += own
            injected[[n, n + 40]] += own @ [e[k].real, e[k].imag]
            gain.append(own)
        v = np.linalg.solve(g, injected)
        u = (v[:40] + 1j * v[40:])[bus]
        i = np.array([complex(*(b @ [z.real, z.imag])) for b, z in zip(gain, e - u, strict=True)])
        at_rotor = i * np.exp(-1j * delta)
        i_q, i_d = at_rotor.real, -at_rotor.imag
        speed = (tm - (u * np.conj(i)).real - damping * omega) / inertia
        wanted = np.clip(ufd0 + EXCITER.gain * (v0 - np.abs(u)), 0, EXCITER.ceiling_pu)
        field = (wanted - ufd) / EXCITER.lag_s
        return np.concatenate(
            [omega, speed, (ufd - eq - (xd - xd1) * i_d) / td0, (-ed + (xq - xq1) * i_q) / tq0, field]
        )

    return rhs


def test_the_modified_euler_method_converges_to_the_unreduced_network(system: System) -> None:
    """Second order, to what a tight Runge-Kutta method makes of all 39 buses."""
    rest = steady_state(system)
    x = np.concatenate([*rest.states.T, rest.inputs[:, 1]])
    for stage, (start, end) in enumerate(((0.0, 0.1), (0.1, 0.3), (0.3, 0.6))):
        solved = solve_ivp(unreduced(system, stage), (start, end), x, method="DOP853", rtol=1e-9, atol=1e-10)
        x = solved.y[:, -1]
    truth = x.reshape(5, -1)[:4].T
    errors = []
    for step in (1e-3, 5e-4):
        swing = simulate(system, FAULT, 0.6, exciter=EXCITER, step_s=step)
        errors.append(np.abs(swing.states[-1] - truth).max())
    assert np.abs(truth[:, 0] - rest.states[:, 0]).max() > 0.5  # it does swing
    assert errors[0] < 3e-4
    assert 3.5 < errors[0] / errors[1] < 4.5


def test_a_fault_at_the_end_of_the_line_is_that_at_its_bus(system: System) -> None:
    for end, near in ((0.0, 1e-7), (1.0, 1 - 1e-7)):
        a, b = (reduced_impedances(system, replace(FAULT, at_pu=at)) for at in (end, near))
        assert b == pytest.approx(a, abs=1e-6)


def test_currents_jump_where_the_network_is_switched(system: System) -> None:
    swing = simulate(system, FAULT, 0.5)
    jump = np.abs(swing.inputs - swing.inputs_before)[..., 2:].max(axis=(1, 2))
    assert np.flatnonzero(jump > 1e-9).tolist() == [100, 300]
    assert np.array_equal(swing.inputs[..., :2], swing.inputs_before[..., :2])


@pytest.mark.parametrize(
    ("file", "old", "new", "message"),
    [
        ("buses.csv", "bus,vm_pu", "bus,vm", "columns bus, vm_pu"),
        ("buses.csv", "1.04852", "much", "line 2, vm_pu: 'much' should be a number"),
        ("branches.csv", "1,2,0.0035,0.0411", "1,2,0.0035,-0.0411", "x_pu: a branch needs"),
        ("branches.csv", "1,2,", "1,77,", "bus 77 is not in buses.csv"),
        ("generators.csv", "6.56,1.5,30.3", "6.56,1.5,0", "h_s: should be positive"),
    ],
)
def test_wrong_data_is_named(tmp_path: Path, file: str, old: str, new: str, message: str) -> None:
    for name in ("buses.csv", "branches.csv", "generators.csv"):
        shutil.copyfile(data_folder() / name, tmp_path / name)
    text = (tmp_path / file).read_text(encoding="utf-8")
    assert old in text
    (tmp_path / file).write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(InputError) as error:
        read_system(tmp_path)
    assert file in str(error.value) and message in str(error.value)


def test_wrong_requests_are_named(system: System, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"buses\.csv: no such file"):
        read_system(tmp_path)
    with pytest.raises(InputError, match="no line 16-22"):
        simulate(system, replace(FAULT, line=(16, 22)), 1.0)
    with pytest.raises(InputError, match="is a transformer"):
        simulate(system, replace(FAULT, line=(12, 11)), 1.0)
    with pytest.raises(InputError, match="at_pu: should be from 0 to 1"):
        simulate(system, replace(FAULT, at_pu=1.1), 1.0)
    with pytest.raises(InputError, match="machine's own terminals"):
        simulate(system, replace(FAULT, line=(1, 39), at_pu=1.0), 1.0)
    with pytest.raises(InputError, match=r"at most 0\.0025 s"):
        simulate(system, FAULT, 1.0, step_s=0.01)
    with pytest.raises(InputError, match=r"multiples of 0\.001 s"):
        simulate(system, replace(FAULT, start_s=0.1004), 1.0)
    with pytest.raises(InputError, match="ceiling at least"):
        simulate(system, FAULT, 1.0, exciter=Exciter(gain=1.0, ceiling_pu=1.0))
    with pytest.raises(InputError, match="no machine at bus 5"):
        system.machine_at(5)
    with pytest.raises(InputError, match="per_s"):
        with_damping(system, -1.0)
