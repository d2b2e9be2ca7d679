"""``[[ct]]``: a current transformer whose core saturates.

One core, seen from the secondary (IEEE PSRC, Theory for CT SAT Calculator, 2003; C37.110): with the ideal
secondary current i1, flux linkage x and exciting current ie,

    ie = x / Lm + A sgn(x) |x|^S     is = i1 - ie     dx/dt = Rt is + Lb dis/dt

A follows from the excitation curve's point of 10 A at Vs, both RMS.  Gaps in the core (TPY, TPZ) give the
finite Lm = Ts Rt - Lb of a secondary time constant Ts.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field, model_validator

from faultloop.config.tables import ComplexOhm, NonNegative, Number, Positive
from faultloop.errors import InputError
from faultloop.jit import njit
from faultloop.plant.elements import Complex, Floats, Ints
from faultloop.plant.instrument import Instrument

SATURATING_A = 10.0
"""RMS exciting current at `vs_v` (IEEE PSRC)."""
MOST_REMANENCE = {"TPX": 1.0, "TPY": 0.1, "TPZ": 0.0}
"""Of a class (IEC 61869-2), per unit of the flux at `vs_v`, beyond which a closed core is saturated."""
TIME_CONSTANT_S = {"TPX": math.inf, "TPY": 1.0, "TPZ": 0.06}
"""Secondary time constant of a class where none is given."""
LEAST_TIME_CONSTANT_S = 0.02
"""A third of TPZ's, the least of all classes: with less a core passes little of the system's frequency."""
OF_A_CORE = ("vs_v", "rw_ohm", "burden_ohm", "remanence_pu", "time_constant_s")
"""Keys that an ideal one has no use for."""
NEGLIGIBLE = 1e-9
"""The curve is left out of a step where it would change the flux by less than this share."""
TOLERANCE = 1e-13
FLUX, CURRENT = range(2)
"""Of a phase's state: flux linkage [V s], secondary current [A]."""


class Ct(Instrument):
    """Gives its relay primary amperes by the nominal ratio; it has no effect on the network."""

    table: ClassVar[str] = "ct"
    first: ClassVar[int] = 3

    model: Literal["ideal", "saturating"] = "ideal"
    """Without a transient of its own, or with saturation; to be given with `vs_v` and the like."""
    core: Literal["TPX", "TPY", "TPZ"] = Field(default="TPX", alias="class")
    """Closed core; small gaps; large ones."""
    vs_v: Positive | None = None
    """Secondary voltage, RMS, at an exciting current of 10 A RMS; needed if saturating."""
    s: Annotated[float, Field(ge=3, le=100)] = 22.0
    """Inverse slope of the saturated part of the excitation curve in a log-log plot."""
    rw_ohm: NonNegative = 0.0
    """Secondary winding."""
    burden_ohm: ComplexOhm | None = None
    """[r, x] at the secondary, leads included; x at system frequency; needed if saturating."""
    remanence_pu: Number = 0.0
    """Of the flux at `vs_v`, in all phases: TPX to 1, TPY to 0.1, TPZ none."""
    time_constant_s: Positive | None = None
    """Secondary, of TPY (1 s where not given) and TPZ (60 ms); 20 ms and more."""

    @model_validator(mode="after")
    def _complete(self) -> Ct:
        if self.model == "ideal":
            given = [key for key in OF_A_CORE if key in self.model_fields_set]
            if given and "model" not in self.model_fields_set:
                what = 'without model = "saturating"; give it, or model = "ideal" where they do not count'
                raise ValueError(f"{', '.join(given)} {what}")
            return self
        if self.vs_v is None or self.burden_ohm is None:
            missing = "vs_v" if self.vs_v is None else "burden_ohm = [r, x]"
            raise ValueError(f'model = "saturating" needs {missing}')
        if min(self.burden_ohm) < 0 or self.rw_ohm + self.burden_ohm[0] == 0:
            raise ValueError(
                "burden_ohm must be [r, x] with r >= 0, x >= 0 and some resistance in it or in rw_ohm, "
                f"not {list(self.burden_ohm)}"
            )
        most = MOST_REMANENCE[self.core]
        if abs(self.remanence_pu) > most:
            must = f"from {-most:g} to {most:g}" if most else "0"
            raise ValueError(f"remanence_pu of class {self.core} must be {must}, not {self.remanence_pu:g}")
        if self.time_constant_s is not None and self.core == "TPX":
            raise ValueError('time_constant_s belongs to class = "TPY" or "TPZ"')
        if self.time_constant_s is not None and self.time_constant_s < LEAST_TIME_CONSTANT_S:
            must = f"must be at least {LEAST_TIME_CONSTANT_S:g} s (TPZ 0.06, TPY 0.1 to 2)"
            raise ValueError(f"time_constant_s {must}, not {self.time_constant_s:g}")
        return self

    @property
    def turns(self) -> float:
        """Nominal ratio."""
        return self.ratio[0] / self.ratio[1]

    def flux_at_vs(self, frequency_hz: float) -> float:
        """Peak flux linkage at `vs_v` [V s]."""
        assert self.vs_v is not None
        return math.sqrt(2) * self.vs_v / (2 * math.pi * frequency_hz)

    def curve(self, frequency_hz: float) -> float:
        """A of ``ie = A x^S``: with it the exciting current is 10 A RMS where the flux is a sine of the peak
        `flux_at_vs`."""
        rms = math.exp((math.lgamma(self.s + 0.5) - math.lgamma(self.s + 1.0)) / 2) / math.pi**0.25
        return SATURATING_A / (rms * self.flux_at_vs(frequency_hz) ** self.s)


class Cts(NamedTuple):
    """Constants of the saturating ones."""

    relay: Ints
    """(cts,) the relay behind each"""
    turns: Floats
    """(cts,)"""
    core: Floats
    """(cts, 6) columns ALPHA ... KNEE"""


ALPHA, BACK, LINEAR, CURVE, EXPONENT, KNEE = range(6)
"""Of `Cts.core`: a = h Rt/2 + Lb; h Rt/2 - Lb; 1/Lm; A; S; flux below which the curve is negligible."""


def ct_constants(cts: Sequence[tuple[int, Ct]], frequency_hz: float, rate: float) -> Cts:
    """Of the saturating ones among ``cts`` (relay's number, CT); ``rate`` in steps per second."""
    own = [(relay, ct) for relay, ct in cts if ct.model == "saturating"]
    return Cts(
        relay=np.array([relay for relay, _ in own], dtype=np.int64),
        turns=np.array([ct.turns for _, ct in own]),
        core=np.array([core_constants(ct, frequency_hz, rate) for _, ct in own]).reshape(-1, 6),
    )


def core_constants(ct: Ct, frequency_hz: float, rate: float) -> list[float]:
    """One row of `Cts.core`."""
    assert ct.burden_ohm is not None
    resistance = ct.rw_ohm + ct.burden_ohm[0]
    leakage = ct.burden_ohm[1] / (2 * math.pi * frequency_hz)
    time_constant = ct.time_constant_s or TIME_CONSTANT_S[ct.core]
    magnetizing = time_constant * resistance - leakage
    if magnetizing <= 0:
        raise InputError(
            f"{time_constant:g} s is no more than the burden's own {leakage / resistance:.3g} s",
            key=ct.key("time_constant_s"),
        )
    half, curve = resistance / (2 * rate), ct.curve(frequency_hz)
    knee = (NEGLIGIBLE / (curve * (half + leakage))) ** (1 / (ct.s - 1))
    return [half + leakage, half - leakage, 1 / magnetizing, curve, ct.s, knee]


def settle_ct(cts: Cts, state: Floats, x: Complex, angle: float) -> None:
    """Adds to ``state`` (cts, 3, 2) what an eternal sinusoid leaves in unsaturated cores before step 0.

    ``x`` (relays, 6), peak phasors at step 0 that turn by ``angle`` [rad] per step, becomes that behind them.
    """
    turn = np.exp(1j * angle)
    for k, relay in enumerate(cts.relay):
        alpha, back, linear = cts.core[k, [ALPHA, BACK, LINEAR]]
        per_ampere = (alpha * turn + back) / (turn - 1)  # flux of one ampere of secondary current
        secondary = x[relay, 3:] / cts.turns[k] / (1 + per_ampere * linear)
        state[k, :, FLUX] += (per_ampere * secondary / turn).real
        state[k, :, CURRENT] += (secondary / turn).real
        x[relay, 3:] = secondary * cts.turns[k]


@njit
def ct_step(cts: Cts, state: Floats, x: Floats) -> None:
    """One step of every CT: the currents of its relay's row in ``x`` (relays, 6), primary, in place."""
    for k in range(cts.relay.shape[0]):
        for c in range(3, 6):
            ideal = x[cts.relay[k], c] / cts.turns[k]
            x[cts.relay[k], c] = cts.turns[k] * core_step(cts.core[k], state[k, c - 3], ideal)


@njit
def core_step(core: Floats, state: Floats, ideal: float) -> float:
    """The secondary current one step on, ``ideal`` being i1 then.

    The trapezoidal rule, implicit in the flux x: ``x (1 + a/Lm) + a A x^S = |r|``, r being all that is known.
    Its left side is increasing and convex, so Newton's method falls onto the root from any bound above it.
    """
    a, curve, s = core[ALPHA], core[CURVE], core[EXPONENT]
    r = state[FLUX] + a * ideal + core[BACK] * state[CURRENT]
    size, slope = abs(r), 1.0 + a * core[LINEAR]
    x = size / slope
    exciting = 0.0
    if x > core[KNEE]:
        x = min(x, (size / (a * curve)) ** (1.0 / s))
        excess = size
        while excess > TOLERANCE * size:
            exciting = curve * x ** (s - 1.0)
            excess = x * (slope + a * exciting) - size
            x -= excess / (slope + s * a * exciting)
        exciting = curve * x**s
    exciting += x * core[LINEAR]
    if r < 0.0:
        x, exciting = -x, -exciting
    state[FLUX] = x
    state[CURRENT] = ideal - exciting
    return state[CURRENT]
