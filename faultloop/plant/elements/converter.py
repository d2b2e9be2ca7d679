"""A grid-following converter: three voltages behind a filter, set anew at every step by its control.

All per unit of the converter's rating and of the peak phase voltage; alpha-beta as a complex number x.

- Sequences by delayed signal cancellation: v+ = (v + j v(t - T/4)) / 2, v- = (v - j v(t - T/4)) / 2.
- Phase-locked loop on v+: err = Im(v+ e^(-j theta)) / |v+|, w = w0 + kp err + ki int err, kp = 2 zeta wn,
  ki = wn^2 (zeta 0.7, wn = 2 pi 20 1/s); it holds its frequency while there is no voltage.
- References, of |V1| and V2 through 5 ms: below 0.9 a lagging current iq = k1 (0.9 - |V1|); what is left of
  the limit for the power, through 5 ms.  ``k2`` above 0: I2 = j k2 V2 out of the converter for |V2| above
  0.05.  Where iq and I2 exceed the limit together both are reduced alike.
- Current loop: a proportional part of bandwidth 2 pi 300, an integrator in the frame that turns with theta,
  and, with ``k2``, one in the frame that turns against it; the voltage fed forward through 1 kHz.

What it sets at the end of a step is applied at the end of the next one.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from faultloop.jit import njit
from faultloop.plant.elements import HALF_ROOT_3, Floats, Ints

ZETA, LOOP_HZ, CURRENT_HZ, FEED_HZ, POWER_S = 0.7, 20.0, 300.0, 1000.0, 5e-3
SUPPORT_BELOW, NEGATIVE_ABOVE = 0.9, 0.05
LOST = 0.05
"""Positive-sequence voltage below which the phase-locked loop holds its frequency."""
CEILING = 1.6
"""Of its voltage."""


@dataclass(frozen=True)
class Converter:
    """``emf`` is the number of the source whose voltage it sets, behind its filter, at ``bus``."""

    emf: int
    bus: str
    rated_va: float
    base_v: float
    """Phase to ground, peak [V]."""
    filter_r: float
    filter_x: float
    """Per unit, at nominal frequency."""
    power: float
    limit: float
    k1: float
    k2: float
    """0: the negative sequence is not controlled."""

    @property
    def base_a(self) -> float:
        """Peak [A]."""
        return 2 / 3 * self.rated_va / self.base_v


class Converters(NamedTuple):
    """Constants of all."""

    row: Ints
    """(converters, 3) rows of v of the voltage that it sets and of its bus; number of its branch"""
    value: Floats
    """(converters, VALUES)"""


(BASE_V, BASE_A, X, KP, KI, POWER, LIMIT, K1, K2, OMEGA, DT, QUARTER, LOOP_P, LOOP_I, FEED, SLOW) = range(16)
"""Of ``value``: bases; filter; current loop; power, limit, droops; nominal angular frequency, step [s], steps
in a quarter of a cycle; phase-locked loop; shares of a step that the two low-passes take."""
VALUES = 16
(THETA, TURN, FED_RE, FED_IM, ACTIVE, PLUS_RE, PLUS_IM, MINUS_RE, MINUS_IM, E_RE, E_IM) = range(11)
SIZE, SECOND_RE, SECOND_IM = range(11, 14)
"""Of the state: angle and integrator of the phase-locked loop; voltage fed forward; active current;
integrators; what it sets at the end of the present step, alpha and beta [V]; |V1|, and V2 in the frame that
turns backwards."""
FIELDS = 14


def ring_length(rate: int, frequency_hz: float) -> int:
    """Steps of the past that it keeps: a power of two above a quarter of a cycle."""
    return 1 << math.ceil(math.log2(rate / (4 * frequency_hz) + 3))


def converter_constants(
    converters: Sequence[Converter], row: Mapping[str, int], sources: Sequence[str], rate: int, hz: float
) -> Converters:
    """Of a circuit's; ``sources`` are the nodes of its voltages in order."""
    omega, dt = 2 * math.pi * hz, 1 / rate
    loop = 2 * math.pi * LOOP_HZ
    current = 2 * math.pi * CURRENT_HZ
    values = [
        [
            c.base_v, c.base_a, c.filter_x, current * c.filter_x / omega, current * c.filter_r,
            c.power, c.limit, c.k1, c.k2, omega, dt, rate / (4 * hz), 2 * ZETA * loop, loop**2,
            1 - math.exp(-2 * math.pi * FEED_HZ * dt), 1 - math.exp(-dt / POWER_S),
        ]
        for c in converters
    ]  # fmt: skip
    rows = [[row[sources[c.emf]], row[c.bus], c.emf] for c in converters]
    return Converters(np.array(rows, dtype=np.int64).reshape(-1, 3), np.array(values).reshape(-1, VALUES))


def settle(net: Converters, k: int, e: complex, v: complex, i: complex, state: Floats, past: Floats) -> None:
    """The state of one that has always run so: peak phasors at step 0 of its voltage and the bus' [V], of its
    current [A].  ``past`` (steps, 2) is filled up to step 0."""
    c = net.value[k]
    size, theta = abs(v) / c[BASE_V], cmath.phase(v)
    turn = cmath.rect(1, -theta)
    current = i / c[BASE_A] * turn
    left = e / c[BASE_V] * turn - size - 1j * c[X] * current
    state[k] = 0.0
    state[k, THETA], state[k, FED_RE], state[k, ACTIVE], state[k, SIZE] = theta, size, current.real, size
    state[k, PLUS_RE], state[k, PLUS_IM] = left.real, left.imag
    state[k, E_RE], state[k, E_IM] = e.real, e.imag
    length = past.shape[1]
    for step in range(1 - length, 1):
        wave = v / c[BASE_V] * cmath.rect(1, c[OMEGA] * c[DT] * step)
        past[k, step % length] = wave.real, wave.imag


@njit
def set_voltages(net: Converters, state: Floats, v: Floats, late: float) -> None:
    """What the converters have set for the end of the present step into their rows of v; ``late`` is the time
    against that [steps]."""
    for k in range(net.row.shape[0]):
        row = net.row[k, 0]
        turn = cmath.rect(1.0, net.value[k, OMEGA] * net.value[k, DT] * late)
        e = complex(state[k, E_RE], state[k, E_IM]) * turn
        v[row, 0] = e.real
        v[row, 1] = -0.5 * e.real + HALF_ROOT_3 * e.imag
        v[row, 2] = -0.5 * e.real - HALF_ROOT_3 * e.imag


@njit
def alpha_beta(x: Floats) -> complex:
    """Of three phases."""
    return complex((2 * x[0] - x[1] - x[2]) / 3, (x[1] - x[2]) / (2 * HALF_ROOT_3))


@njit
def references(c: Floats, s: Floats, positive: float, negative: complex) -> tuple[float, float, complex]:
    """Active and lagging current, and the negative sequence's as alpha-beta; the active one is renewed."""
    lagging = min(c[K1] * max(SUPPORT_BELOW - positive, 0.0), c[LIMIT])
    size = abs(negative)
    second = c[K2] * size if size > NEGATIVE_ABOVE else 0.0
    share = min(1.0, c[LIMIT] / max(lagging + second, 1e-9))
    lagging, second = share * lagging, share * second
    left = math.sqrt(max((c[LIMIT] - second) ** 2 - lagging**2, 0.0))
    s[ACTIVE] += c[SLOW] * (min(c[POWER] / max(positive, 1e-3), left) - s[ACTIVE])
    active = min(s[ACTIVE], left)
    # a phasor V2 is conj(V2) e^(-j w t) in alpha-beta, so j k2 V2 is -j k2 of it
    unit = complex(0.0, -1.0) * negative / max(size, 1e-9)
    return active, lagging, second * unit


@njit
def control(net: Converters, state: Floats, past: Floats, v: Floats, current: Floats, step: int) -> None:
    """At the end of step number ``step``: what is set at the end of the next one."""
    length = past.shape[1]
    for k in range(net.row.shape[0]):
        c, s = net.value[k], state[k]
        x = alpha_beta(v[net.row[k, 1]]) / c[BASE_V]
        i = alpha_beta(current[net.row[k, 2]]) / c[BASE_A]
        past[k, step % length, 0], past[k, step % length, 1] = x.real, x.imag
        whole = int(c[QUARTER])
        part = c[QUARTER] - whole
        one, two = past[k, (step - whole) % length], past[k, (step - whole - 1) % length]
        quarter = complex(one[0] + part * (two[0] - one[0]), one[1] + part * (two[1] - one[1]))
        plus, minus = (x + 1j * quarter) / 2, (x - 1j * quarter) / 2
        frame = cmath.rect(1.0, s[THETA])
        back = frame.conjugate()
        positive = abs(plus)
        error = (plus * back).imag / positive if positive > LOST else 0.0
        s[TURN] += c[LOOP_I] * error * c[DT]
        turned = (c[OMEGA] + c[LOOP_P] * error + s[TURN]) * c[DT]
        s[SIZE] += c[SLOW] * (positive - s[SIZE])
        slow = complex(s[SECOND_RE], s[SECOND_IM])
        slow += c[SLOW] * (minus * frame - slow)
        s[SECOND_RE], s[SECOND_IM] = slow.real, slow.imag
        active, lagging, second = references(c, s, s[SIZE], slow * back)
        first = complex(active, -lagging) * frame
        fed = complex(s[FED_RE], s[FED_IM])
        fed += c[FEED] * (x * back - fed)
        s[FED_RE], s[FED_IM] = fed.real, fed.imag
        wanted = first + second
        cross = 1j * c[X] * (first - second if c[K2] > 0.0 else i)
        off = wanted - i
        integral = complex(s[PLUS_RE], s[PLUS_IM])
        against = complex(s[MINUS_RE], s[MINUS_IM])
        e = fed * frame + cross + c[KP] * off + integral * frame + against * back
        size = abs(e)
        if size > CEILING:
            e = e * (CEILING / size)
        else:
            integral += c[KI] * c[DT] * off * back
            s[PLUS_RE], s[PLUS_IM] = integral.real, integral.imag
            if c[K2] > 0.0:
                against += c[KI] * c[DT] * off * frame
                s[MINUS_RE], s[MINUS_IM] = against.real, against.imag
        e = e * cmath.rect(c[BASE_V], turned)
        s[E_RE], s[E_IM] = e.real, e.imag
        s[THETA] = (s[THETA] + turned) % (2 * math.pi)
