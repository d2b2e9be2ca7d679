"""``[[vt]]``: a voltage transformer, ideal or capacitive.

A capacitive one is a linear circuit between the tap's voltage and the secondary's, all seen from the tap: the
capacitance of the divider and the tuned reactor in series, and at their end the burden, the magnetising
branch and the ferroresonance-suppression circuit.  It is stepped by its modes,

    H(s) = sum r_k / (s - p_k)     x_k' = p_k x_k + u

each exactly for an input of straight pieces (ramp-invariant), so it is stable at any step.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

import numpy as np
from numpy.polynomial import Polynomial
from pydantic import Discriminator, Field, Tag, model_validator

from faultloop.config.tables import NonNegative, Positive, Table
from faultloop.jit import njit
from faultloop.plant.component import Component
from faultloop.plant.elements import Complex, Floats, Ints

REACTOR_QUALITY = 100.0
TANK_QUALITY = 50.0
MAGNETIZING_VA = 30.0
IRON_W = 20.0
"""Of the intermediate transformer, both at the tap's nominal voltage."""
MODES = 6
"""Of the largest circuit."""
SMALL = 1e-3
"""Below this |pT| a weight is a series: its formula cancels."""
JW = Polynomial([0.0, 1.0])
"""The complex frequency, over the nominal angular frequency."""

Fraction = tuple[Polynomial, Polynomial]


class CvtCircuit(Table):
    """Everything seen from the tap of the divider."""

    ce_nf: Positive
    """C1 + C2."""
    lc_h: Positive | None = None
    """Reactor; tuned to the capacitance at system frequency where not given."""
    rc_ohm: NonNegative | None = None
    """Of the reactor; a hundredth of its reactance where not given."""
    burden_va: NonNegative = 100.0
    """At the tap's nominal voltage: a resistance and an inductance in series; 0: none."""
    power_factor: Annotated[float, Field(gt=0, le=1)] = 0.8
    rf_ohm: Positive
    """Suppression circuit: this resistance alone (passive), or in series with a tank (active) of ..."""
    lf_h: Positive | None = None
    """... this inductance, of quality 50, beside ..."""
    cf_nf: Positive | None = None
    """... this capacitance; tuned to it at system frequency where not given."""
    tap_kv: Positive = 13.0
    """Nominal voltage of the tap, to ground."""

    @model_validator(mode="after")
    def _tank(self) -> CvtCircuit:
        if self.cf_nf is not None and self.lf_h is None:
            raise ValueError("cf_nf needs lf_h: both make the tank of an active suppression circuit")
        return self

    def transfer(self, omega: float) -> Fraction:
        """Secondary to tap voltage, in per unit; ``omega`` [rad/s] is the nominal angular frequency."""
        over, under = self._at_the_node(omega)
        xce = 1e9 / (omega * self.ce_nf)
        xlc = xce if self.lc_h is None else omega * self.lc_h
        rc = xlc / REACTOR_QUALITY if self.rc_ohm is None else self.rc_ohm
        series = xce + rc * JW + xlc * JW**2  # times s
        return under * JW, under * JW + over * series

    def _at_the_node(self, omega: float) -> Fraction:
        """Admittance of burden, magnetising branch and suppression circuit beside each other."""
        base = (self.tap_kv * 1e3) ** 2
        branches = [_fraction(MAGNETIZING_VA / base, JW), _fraction(IRON_W / base, 1.0)]
        if self.burden_va:
            z = base / self.burden_va
            branches.append(
                _fraction(1.0, z * self.power_factor + z * math.sqrt(1 - self.power_factor**2) * JW)
            )
        branches.append(self._suppression(omega))
        over, under = branches[0]
        for more_over, more_under in branches[1:]:
            over, under = over * more_under + more_over * under, under * more_under
        return over, under

    def _suppression(self, omega: float) -> Fraction:
        """Admittance of the suppression circuit."""
        if self.lf_h is None:
            return _fraction(1.0, self.rf_ohm)
        x = omega * self.lf_h
        coil = x / TANK_QUALITY + x * JW
        susceptance = 1 / x if self.cf_nf is None else omega * self.cf_nf * 1e-9
        tank = 1 + susceptance * JW * coil
        return tank, self.rf_ohm * tank + coil


def _fraction(over: float | Polynomial, under: float | Polynomial) -> Fraction:
    return Polynomial([0.0]) + over, Polynomial([0.0]) + under


Named = Literal["P1", "P2", "A1", "A2"]


def named_circuit(name: Named, frequency_hz: float) -> CvtCircuit:
    """Passive (P) and active (A) circuits with 100 nF (1) and 20 nF (2), as in docs/plant.md.

    At every frequency they have the same capacitances, powers and per-unit values."""
    ce_nf = 100.0 if name.endswith("1") else 20.0
    base = 13e3**2
    if name.startswith("P"):
        return CvtCircuit(ce_nf=ce_nf, rf_ohm=base / (50.0 if name == "P1" else 100.0))
    tank = base / (1000.0 if name == "A1" else 300.0)
    return CvtCircuit(ce_nf=ce_nf, rf_ohm=base / 1000.0, lf_h=tank / (2 * math.pi * frequency_hz))


def _kind(circuit: Any) -> str:
    return "<table>" if isinstance(circuit, (dict, CvtCircuit)) else "<name>"


class Vt(Component):
    """Gives its relay primary volts by the nominal ratio; it has no effect on the network."""

    table: ClassVar[str] = "vt"

    ratio: Annotated[tuple[Positive, Positive], Field(strict=False)]
    """[primary, secondary] volts."""
    model: Literal["ideal", "cvt"] = "ideal"
    circuit: (
        Annotated[
            Annotated[Named, Tag("<name>")] | Annotated[CvtCircuit, Tag("<table>")], Discriminator(_kind)
        ]
        | None
    ) = None
    burden_va: NonNegative | None = None
    """In place of the circuit's."""

    @model_validator(mode="after")
    def _circuit_of_a_cvt(self) -> Vt:
        if self.model == "cvt" and self.circuit is None:
            raise ValueError('model = "cvt" needs circuit = "P1" | "P2" | "A1" | "A2" or a table of its own')
        if self.model == "ideal" and not (self.circuit is None and self.burden_va is None):
            raise ValueError('circuit and burden_va belong to model = "cvt"')
        return self

    def modes(self, frequency_hz: float) -> tuple[Complex, Complex]:
        """Poles and residues [1/s]; of a conjugate pair the upper one, its residue doubled."""
        assert self.circuit is not None
        circuit = named_circuit(self.circuit, frequency_hz) if isinstance(self.circuit, str) else self.circuit
        if self.burden_va is not None:
            circuit = circuit.model_copy(update={"burden_va": self.burden_va})
        omega = 2 * math.pi * frequency_hz
        over, under = circuit.transfer(omega)
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
