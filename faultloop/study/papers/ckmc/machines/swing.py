"""All machines swinging against each other, from a load flow on, by the modified Euler method.

Each machine's stator gives ``V = T' e + T' X T i`` in the network's frame (T turns into its rotor's axes),
the reduced network gives ``V = Z i``; together one real linear system of two rows a machine, solved for the
currents at every evaluation.  It holds for x'd and x'q unequal, without iterations.

The field voltage is that of a static exciter with one lag, limited at its entry:

    Ufd' = (clip(Ufd0 + gain (V0 - |V|), 0, ceiling) - Ufd) / T

With gain 0 it is constant.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from faultloop.errors import InputError
from faultloop.jit import njit
from faultloop.study.papers.ckmc.machines.data import System
from faultloop.study.papers.ckmc.machines.machine import (
    DELTA,
    ED,
    EQ,
    II,
    IR,
    STEP,
    TD0,
    TQ0,
    UFD,
    XD,
    XD1,
    XQ,
    XQ1,
    derivative,
    terminal_voltage,
)
from faultloop.study.papers.ckmc.machines.network import LineFault, admittance, reduced, reduced_impedances

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

FIELD = 4
"""The field voltage, after a machine's four states."""


@dataclass(frozen=True)
class Exciter:
    """Every machine's: gain [pu field per pu voltage], lag [s], ceiling [pu field]."""

    gain: float = 0.0
    lag_s: float = 0.05
    ceiling_pu: float = 5.0


@dataclass(frozen=True)
class SteadyState:
    """At rest: (m, 4) ``machine.STATES``, (m, 4) inputs Tm, Ufd, iR, iI, (m,) terminal voltage [pu]."""

    states: Array
    inputs: Array
    voltage: Array


@dataclass(frozen=True)
class Swing:
    """A simulation, sampled.

    Attributes
    ----------
    t : (n,) [s].
    states : (n, m, 4), ``machine.STATES`` of every machine.
    inputs : (n, m, 4), Tm, Ufd and the currents iR, iI just after t.
    inputs_before : the same just before t: the currents differ where the network was switched at t.
    """

    t: Array
    states: Array
    inputs: Array
    inputs_before: Array


class Machines(NamedTuple):
    """What a run does not change.

    (m, 9) ``machine.PARAMETERS``; (m, 5) gain, lag, ceiling, V0, Ufd0; (3, 2m, 2m) networks.
    """

    constants: Array
    exciters: Array
    networks: Array


class Workspace(NamedTuple):
    """What the kernels write: inputs, two derivatives and a trial state, the system of the currents."""

    u: Array
    first: Array
    second: Array
    trial: Array
    a: Array
    b: Array


def steady_state(system: System) -> SteadyState:
    """At rest before the fault (Sauer, Pai 1998, ch. 7.6).

    The currents are those of the reduced network at the load flow's terminal voltages, and not of the listed
    dispatch: so the derivatives are zero to rounding, whatever the load flow's own mismatch.
    """
    v = system.voltage[system.machine_bus]
    i = reduced(admittance(system), system.machine_bus) @ v
    p = system.parameters
    delta = np.angle(v + 1j * p[:, XQ] * i)
    turn = np.exp(-1j * delta)
    (i_q, i_d), (v_q, v_d) = ((a.real, -a.imag) for a in (i * turn, v * turn))
    e_q = v_q + p[:, XD1] * i_d
    e_d = v_d - p[:, XQ1] * i_q
    field = e_q + (p[:, XD] - p[:, XD1]) * i_d
    inputs = np.column_stack([v_d * i_d + v_q * i_q, field, i.real, i.imag])
    return SteadyState(np.column_stack([delta, np.zeros_like(delta), e_q, e_d]), inputs, np.abs(v))


def workspace(inputs: Array) -> Workspace:
    """For m machines with ``inputs`` (m, 4)."""
    m = len(inputs)
    first, second, trial = np.zeros((3, m, 5))
    return Workspace(inputs.copy(), first, second, trial, np.zeros((2 * m, 2 * m)), np.zeros(2 * m))


@njit
def solve_inputs(x: Array, p: Array, z: Array, work: Workspace) -> None:
    """Inputs of all machines with the states ``x`` (m, 5) on the network ``z`` (2m, 2m), into ``work.u``."""
    a, b = work.a, work.b
    a[:] = z
    for k in range(len(x)):
        sin, cos = math.sin(x[k, DELTA]), math.cos(x[k, DELTA])
        r, i = 2 * k, 2 * k + 1
        saliency = sin * cos * (p[k, XQ1] - p[k, XD1])
        a[r, r] -= saliency
        a[r, i] -= p[k, XQ1] * sin * sin + p[k, XD1] * cos * cos
        a[i, r] += p[k, XQ1] * cos * cos + p[k, XD1] * sin * sin
        a[i, i] += saliency
        b[r] = x[k, ED] * sin + x[k, EQ] * cos
        b[i] = x[k, EQ] * sin - x[k, ED] * cos
    current = np.linalg.solve(a, b)
    for k in range(len(x)):
        work.u[k, UFD] = x[k, FIELD]
        work.u[k, IR] = current[2 * k]
        work.u[k, II] = current[2 * k + 1]


@njit
def excite(x: Array, u: Array, p: Array, exciter: Array) -> float:
    """The field voltage's derivative."""
    v_re, v_im = terminal_voltage(x, u[IR], u[II], p)
    gain, lag, ceiling, reference, rest = exciter
    wanted = rest + gain * (reference - math.sqrt(v_re * v_re + v_im * v_im))
    return (min(max(wanted, 0.0), ceiling) - x[FIELD]) / lag


@njit
def derivatives(x: Array, machines: Machines, stage: int, work: Workspace, dx: Array) -> None:
    """All machines on the network of a stage, into ``dx`` (m, 5)."""
    p = machines.constants
    solve_inputs(x, p, machines.networks[stage], work)
    for k in range(len(x)):
        derivative(x[k], work.u[k], p[k], dx[k])
        dx[k, FIELD] = excite(x[k], work.u[k], p[k], machines.exciters[k])


@njit
def advance(x: Array, machines: Machines, stage: int, work: Workspace) -> None:
    """One step of the modified Euler (Heun) method, in place."""
    dt = machines.constants[0, STEP]
    derivatives(x, machines, stage, work, work.first)
    work.trial[:] = x + dt * work.first
    derivatives(work.trial, machines, stage, work, work.second)
    x += 0.5 * dt * (work.first + work.second)


@njit
def run(
    x: Array, machines: Machines, stages: NDArray[np.int64], work: Workspace, out: tuple[Array, Array, Array]
) -> None:
    """Step through the networks of ``stages`` (n,).

    ``out``: states at each step's start, inputs just after and just before it.
    """
    states, after, before = out
    for n in range(len(stages)):
        solve_inputs(x, machines.constants, machines.networks[stages[max(n - 1, 0)]], work)
        before[n] = work.u
        solve_inputs(x, machines.constants, machines.networks[stages[n]], work)
        after[n] = work.u
        states[n] = x
        advance(x, machines, stages[n], work)


def real_blocks(z: Complex) -> Array:
    """(..., m, m) complex as (..., 2m, 2m) real, each number a 2 x 2 block."""
    m = z.shape[-1]
    blocks = np.empty((*z.shape[:-2], m, 2, m, 2))
    blocks[..., 0, :, 0] = blocks[..., 1, :, 1] = z.real
    blocks[..., 1, :, 0] = z.imag
    blocks[..., 0, :, 1] = -z.imag
    return blocks.reshape(*z.shape[:-2], 2 * m, 2 * m)


def prepare(
    system: System, fault: LineFault, exciter: Exciter, step_s: float
) -> tuple[Array, Machines, Workspace]:
    """The initial state (m, 5), and what the kernels need.  Raises InputError as ``simulate``."""
    fastest = min(float(system.parameters[:, [TD0, TQ0]].min()), exciter.lag_s)
    if not 0 < step_s <= fastest / 4:
        raise InputError(
            f"{step_s:g} s should be positive and at most {fastest / 4:g} s, a quarter of the shortest time"
            " constant",
            key="step_s",
        )
    rest = steady_state(system)
    constants = system.parameters.copy()
    constants[:, STEP] = step_s
    field = rest.inputs[:, UFD]
    if exciter.gain < 0 or exciter.ceiling_pu < field.max():
        raise InputError(
            f"the gain should not be negative and the ceiling at least {field.max():.2f} pu", key="exciter"
        )
    settings = np.tile([exciter.gain, exciter.lag_s, exciter.ceiling_pu], (len(field), 1))
    exciters = np.column_stack([settings, rest.voltage, field])
    networks = real_blocks(reduced_impedances(system, fault))
    return (
        np.column_stack([rest.states, field]),
        Machines(constants, exciters, networks),
        workspace(rest.inputs),
    )


def simulate(
    system: System,
    fault: LineFault,
    duration_s: float,
    *,
    exciter: Exciter = Exciter(),
    step_s: float = 1e-3,
    every: int = 1,
) -> Swing:
    """From the steady state through the fault.

    Parameters
    ----------
    duration_s : of the simulation.
    step_s : of the integration [s]; fault and clearing are at whole steps.
    every : of so many steps one is kept.

    Raises InputError for a step that is not positive or too long for the fastest machine, for fault instants
    between steps, an exciter that cannot hold the load flow, and as ``reduced_impedances``.
    """
    x, machines, work = prepare(system, fault, exciter, step_s)
    start, end = (t / step_s for t in (fault.start_s, fault.start_s + fault.duration_s))
    if max(abs(start - round(start)), abs(end - round(end))) > 1e-6:
        raise InputError(f"the fault should begin and end at multiples of {step_s:g} s", key="start_s")
    steps = np.arange(round(duration_s / step_s) + 1)
    stages = (steps >= round(start)).astype(np.int64) + (steps >= round(end))
    out = (
        np.empty((len(steps), len(x), 5)),
        np.empty((len(steps), len(x), 4)),
        np.empty((len(steps), len(x), 4)),
    )
    run(x, machines, stages, work, out)
    states, after, before = (a[::every, :, :4].copy() for a in out)
    t = np.asarray(steps[::every] * step_s, dtype=np.float64)
    return Swing(t, states, after, before)
