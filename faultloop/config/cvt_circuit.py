"""A capacitive voltage transformer's circuit: of the plant's component, and known to a relay.

Everything is seen from the tap of the divider: its capacitance and the tuned reactor in series, and at their
end the burden, the magnetising branch and the ferroresonance-suppression circuit.
"""

from __future__ import annotations

import cmath
import math
from typing import Annotated, Any, Literal

import numpy as np
from numpy.polynomial import Polynomial
from pydantic import Discriminator, Field, Tag, model_validator

from faultloop.config.tables import NonNegative, Positive, Table

REACTOR_QUALITY = 100.0
TANK_QUALITY = 50.0
MISTUNED = 0.1
"""A circuit that passes the nominal frequency by so much more or less, or turned by as much, is none."""
OFF_RESONANCE = 1.5
"""Nor is one whose reactor, or tank, resonates at a frequency so many times higher or lower."""
MAGNETIZING_VA = 30.0
IRON_W = 20.0
"""Of the intermediate transformer, both at the tap's nominal voltage."""
JW = Polynomial([0.0, 1.0])
"""The complex frequency, over the nominal angular frequency."""
JW_OF_ALL = 1j * np.geomspace(0.1, 10.0, 60)
"""Where circuits are compared."""

Fraction = tuple[Polynomial, Polynomial]


class CvtCircuit(Table):
    """Everything seen from the tap of the divider."""

    ce_nf: Annotated[float, Field(gt=0, le=10_000)]
    """C1 + C2."""
    lc_h: Positive | None = None
    """Reactor; tuned to the capacitance at system frequency where not given."""
    rc_ohm: NonNegative | None = None
    """Of the reactor; a hundredth of its reactance where not given."""
    burden_va: NonNegative = 100.0
    """At the tap's nominal voltage: a resistance and an inductance in series; 0: none."""
    power_factor: Annotated[float, Field(gt=0, le=1)] = 0.8
    """Of the burden, lagging."""
    rf_ohm: Positive
    """Suppression circuit: this resistance alone (passive), or in series with a tank (active) of ..."""
    lf_h: Positive | None = None
    """... this inductance, of quality 50, beside ..."""
    cf_nf: Positive | None = None
    """... this capacitance; tuned to it at system frequency where not given."""
    tap_kv: Annotated[float, Field(gt=0, le=100)] = 13.0
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


Circuit = Annotated[
    Annotated[Named, Tag("<name>")] | Annotated[CvtCircuit, Tag("<table>")], Discriminator(_kind)
]
"""As it is given: a name or a table of its own."""


def chosen_circuit(circuit: Named | CvtCircuit, burden_va: float | None, frequency_hz: float) -> CvtCircuit:
    """The circuit that is meant, with another burden where one is given."""
    found = named_circuit(circuit, frequency_hz) if isinstance(circuit, str) else circuit
    return found if burden_va is None else found.model_copy(update={"burden_va": burden_va})


def differ(one: CvtCircuit, other: CvtCircuit, frequency_hz: float) -> float:
    """The most by which their secondary voltages differ, of the tap's, up to ten times the frequency."""
    passed = []
    for circuit in (one, other):
        over, under = circuit.transfer(2 * math.pi * frequency_hz)
        passed.append(over(JW_OF_ALL) / under(JW_OF_ALL))
    return float(np.abs(passed[0] - passed[1]).max())


def what_mistunes(circuit: Named | CvtCircuit, burden_va: float | None, frequency_hz: float) -> str | None:
    """What is wrong with a circuit that does not pass the nominal frequency or is off tune; else None."""
    over, under = chosen_circuit(circuit, burden_va, frequency_hz).transfer(2 * math.pi * frequency_hz)
    passed = over(1j) / under(1j)
    if abs(passed - 1) > MISTUNED:
        return (
            f"passes {abs(passed):.2f} of the voltage at {math.degrees(cmath.phase(passed)):.0f} degrees"
            f" at {frequency_hz:g} Hz; a tuned circuit passes 1.00 at 0: see ce_nf, lc_h and burden_va"
        )
    if isinstance(circuit, CvtCircuit):
        for inductance, capacitance in (("lc_h", "ce_nf"), ("lf_h", "cf_nf")):
            h, nf = getattr(circuit, inductance), getattr(circuit, capacitance)
            if h is not None and nf is not None:
                hz = 1 / (2 * math.pi * math.sqrt(h * nf * 1e-9))
                if not 1 / OFF_RESONANCE < hz / frequency_hz < OFF_RESONANCE:
                    tuned = h * (hz / frequency_hz) ** 2
                    what = f"{inductance} and {capacitance} are tuned to {hz:.4g} Hz, not {frequency_hz:g}"
                    return f"{what}; {inductance} = {tuned:.4g} is in tune"
    return None
