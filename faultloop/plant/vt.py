"""``[[vt]]``: a voltage transformer, ideal or capacitive.

A capacitive one is a linear circuit between the tap's voltage and the secondary's
(`faultloop.config.cvt_circuit`), stepped by its modes,

    H(s) = sum r_k / (s - p_k)     x_k' = p_k x_k + u

each exactly for an input of straight pieces (ramp-invariant), so it is stable at any step.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import model_validator

from faultloop.config.cvt_circuit import Circuit, chosen_circuit, what_mistunes
from faultloop.config.tables import NonNegative
from faultloop.errors import InputError
from faultloop.jit import njit
from faultloop.plant.component import PlantTables
from faultloop.plant.elements import Complex, Floats, Ints
from faultloop.plant.instrument import Instrument

MODES = 6
"""Of the largest circuit."""
SMALL = 1e-3
"""Below this |pT| a weight is a series: its formula cancels."""


class Vt(Instrument):
    """Gives its relay primary volts by the nominal ratio; it has no effect on the network."""

    table: ClassVar[str] = "vt"
    first: ClassVar[int] = 0

    model: Literal["ideal", "cvt"] = "ideal"
    """Without a transient of its own, or capacitive."""
    circuit: Circuit | None = None
    """Of a "cvt"; needed there."""
    burden_va: NonNegative | None = None
    """In place of the circuit's."""

    @model_validator(mode="after")
    def _circuit_of_a_cvt(self) -> Vt:
        if self.model == "cvt" and self.circuit is None:
            raise ValueError('model = "cvt" needs circuit = "P1" | "P2" | "A1" | "A2" or a table of its own')
        if self.model == "ideal" and not (self.circuit is None and self.burden_va is None):
            raise ValueError('circuit and burden_va belong to model = "cvt"')
        return self

    def check(self, tables: PlantTables) -> None:
        super().check(tables)
        if self.circuit is not None:
            what = what_mistunes(self.circuit, self.burden_va, tables.system.frequency_hz)
            if what is not None:
                raise InputError(what, key=self.key("circuit"))

    def modes(self, frequency_hz: float) -> tuple[Complex, Complex]:
        """Poles and residues [1/s]; of a conjugate pair the upper one, its residue doubled."""
        assert self.circuit is not None
        omega = 2 * math.pi * frequency_hz
        over, under = chosen_circuit(self.circuit, self.burden_va, frequency_hz).transfer(omega)
        poles = np.asarray(under.roots(), dtype=np.complex128)
        poles = poles[poles.imag >= 0]
        residues = over(poles) / under.deriv()(poles) * np.where(poles.imag > 0, 2.0, 1.0)
        return omega * poles, omega * residues


class Vts(NamedTuple):
    """Constants of the capacitive ones."""

    relay: Ints
    """(vts,) the relay behind each"""
    modes: Ints
    """(vts,)"""
    mode: Complex
    """(vts, MODES, 4) e^(pT), weights of the input before and now [s], residue [1/s]"""


DECAY, BEFORE, NOW, RESIDUE = range(4)


def vt_constants(vts: Sequence[tuple[int, Vt]], frequency_hz: float, rate: float) -> Vts:
    """Of the capacitive ones among ``vts`` (relay's number, VT); ``rate`` in steps per second."""
    own = [(relay, vt) for relay, vt in vts if vt.model == "cvt"]
    mode = np.zeros((len(own), MODES, 4), dtype=np.complex128)
    count = []
    for k, (_, vt) in enumerate(own):
        poles, residues = vt.modes(frequency_hz)
        count.append(len(poles))
        mode[k, : len(poles)] = np.stack([*_ramp_invariant(poles / rate, 1 / rate), residues], axis=1)
    return Vts(np.array([relay for relay, _ in own], dtype=np.int64), np.array(count, dtype=np.int64), mode)


def _ramp_invariant(pt: Complex, dt: float) -> tuple[Complex, Complex, Complex]:
    """e^(pT), and the weights of the input a step before and now [s]."""
    series = np.abs(pt) < SMALL
    p = np.asarray(np.where(series, 1.0, pt), dtype=np.complex128)
    now = np.where(series, 1 / 2 + pt / 6 + pt**2 / 24, (np.exp(p) - 1 - p) / p**2)
    before = np.where(series, 1 / 2 + pt / 3 + pt**2 / 8, (np.exp(p) * (p - 1) + 1) / p**2)
    weights = np.stack([np.exp(pt), before * dt, now * dt]).astype(np.complex128)
    return weights[0], weights[1], weights[2]


def settle_vt(vts: Vts, state: Floats, x: Complex, angle: float) -> None:
    """Adds to ``state`` (vts, 3, MODES + 1, 2) what an eternal sinusoid leaves before step 0.

    ``x`` (relays, 6), peak phasors at step 0 that turn by ``angle`` [rad] per step, becomes that behind them.
    """
    turn = np.exp(1j * angle)
    for k, relay in enumerate(vts.relay):
        decay, before, now, residue = vts.mode[k, : vts.modes[k]].T
        u = x[relay, :3].copy()
        x[relay, :3] = 0.0
        for p in range(3):
            # a conjugate pair is one mode, whose input has both signs of frequency
            for sign, phasor in ((1, u[p] / 2), (-1, np.conj(u[p]) / 2)):
                z = turn if sign > 0 else np.conj(turn)
                mode = (before + now * z) / (z - decay) * phasor
                state[k, p, : len(mode)] += np.stack([(mode / z).real, (mode / z).imag], axis=1)
                out = (residue * mode).sum()
                x[relay, p] += out if sign > 0 else np.conj(out)
            state[k, p, MODES, 0] += (u[p] / turn).real


@njit
def vt_step(vts: Vts, state: Floats, x: Floats) -> None:
    """One step of every VT: the voltages of its relay's row in ``x`` (relays, 6), in place."""
    for k in range(vts.relay.shape[0]):
        for p in range(3):
            u, last = x[vts.relay[k], p], state[k, p, MODES, 0]
            total = 0.0
            for m in range(vts.modes[k]):
                mode = vts.mode[k, m]
                y = mode[DECAY] * complex(state[k, p, m, 0], state[k, p, m, 1])
                y += mode[BEFORE] * last + mode[NOW] * u
                state[k, p, m, 0], state[k, p, m, 1] = y.real, y.imag
                total += (mode[RESIDUE] * y).real
            state[k, p, MODES, 0] = u
            x[vts.relay[k], p] = total
