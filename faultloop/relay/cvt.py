"""The voltage in front of a capacitive transformer, from the one behind it: by the inverse of its circuit.

Voltage and current of a line belong together in every waveform; behind the transformer they do not, and for
some cycles nothing that compares them holds.  Where the circuit is known (``[vt] kind = "cvt"``) its inverse
gives the primary voltage back, and everything after it works as behind an ideal transformer.

The circuit is H(s), per unit, with a double zero at s = 0 (the divider's capacitance and the magnetising
branch pass no direct voltage), one more pole than zeros, and all other zeros to the left (it is passive).  So

    1 / H(s) = h s + d + c1 / s + c2 / s^2 + sum r_k / (s - z_k)

is stable but for the two integrators.  Modes and integrators go by the trapezoidal rule, scaled to be exact
at the nominal frequency; the derivative is that of a parabola through three samples: a trapezoidal one rings.

In quiet the integrals of the voltage, a sinusoid, have no mean; after a fault they do, and it counts.  So
their means are drawn to zero slowly in quiet, and left alone for some cycles after a change: then what noise
brings together does not drift away, and what a fault brings is kept.  The converter's offset goes in the same
way.  At the start the integrals' means are taken away at once, after two cycles each.

Source: the inverse is ours; that the states of a transformer do not jump at a fault, so that its circuit
tells everything about the voltage behind it, is used by makers, too (ABB REL650's CVT filter).
"""

from __future__ import annotations

import cmath
import math

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

from faultloop.jit import Address, call_step, njit
from faultloop.relay.estimators.base import STEP, Estimator, is_compiled
from faultloop.relay.recent import LARGEST

Array = NDArray[np.float64]

MODES = 4
"""Zeros of the largest circuit but the two at 0; a conjugate pair is one."""
DRAWN, OFFSET_DRAWN = 0.2, 0.02
"""Part of a mean that is taken away after each two cycles: of the integrals, of the converter's offset."""
BEGINNING = 4.0
"""Cycles until the integrals have lost what they begin with."""
APART, CHANGE = 1 / 12, 0.1
"""Cycles between three samples, and what no sinusoid within a tenth of the nominal frequency leaves of them,
of the peak."""
KEPT_CYCLES, QUIET_CYCLES = 12.0, 2.0
"""So long after a change, and at the start, the means are left alone; and so long nothing must have changed
before it."""

# Constants: how many modes (0: none is to be inverted), then
COUNT = 0
DIRECT = 1  # weights of this sample and the two before it
INTEGRAL = 4  # weights of the first and the second integral
HALF_STEP = 6  # [s]
CYCLE = 7  # samples
KEPT = 8
QUIET = 9
EVERY = 10  # samples in APART
TURN = 11  # 2 cos of the angle between two such samples
FALL = 12  # of the peak, per sample
MODE = 13  # of each: re and im of its decay, of the input's gain, of its weight
CONSTANTS = MODE + 6 * MODES
# State: samples seen, left to keep, of quiet, and the squared peak; then of each phase
SEEN, LEFT, STILL, PEAK = range(4)
PHASE = 4
BEFORE = 0  # two samples
INTEGRALS = 2  # two
OFFSET = 4
SUMS = 5  # three: of the integrals, of the offset
MARKS = 8  # two: the voltage APART ago, and twice as long
MODE_STATE = 10
PER_PHASE = MODE_STATE + 2 * MODES
STATE = PHASE + 3 * PER_PHASE


def no_inverse() -> Array:
    """Constants of a transformer that needs none."""
    return np.zeros(CONSTANTS)


def inverse(circuit: tuple[Polynomial, Polynomial], sampling_hz: float, frequency_hz: float) -> Array:
    """Constants, (CONSTANTS,), of the inverse of H = over / under, polynomials of s over the nominal angular
    frequency: `faultloop.config.cvt_circuit.CvtCircuit.transfer`."""
    under, over = circuit
    omega = 2 * math.pi * frequency_hz
    angle = omega / sampling_hz
    straight, rest = divmod(over, under)
    derivative, direct = (*reversed(straight.coef), 0.0)[:2] if straight.degree() else (0.0, straight.coef[0])
    zeros = Polynomial(under.coef[2:])  # without the two at 0
    first = (rest.deriv()(0.0) * zeros(0.0) - rest(0.0) * zeros.deriv()(0.0)) / zeros(0.0) ** 2
    c = no_inverse()
    c[INTEGRAL : INTEGRAL + 2] = omega * first, omega**2 * rest(0.0) / zeros(0.0)
    # A step of this length makes the trapezoidal rule exact at the nominal frequency.
    step = 2 * math.tan(angle / 2) / omega
    roots = np.asarray(zeros.roots(), dtype=np.complex128)
    roots = roots[roots.imag >= 0]
    weights = rest(roots) / under.deriv()(roots) * np.where(roots.imag > 0, 2.0, 1.0)
    for k, (root, weight) in enumerate(zip(omega * roots, omega * weights, strict=True)):
        decay = (1 + root * step / 2) / (1 - root * step / 2)
        gain = step / 2 / (1 - root * step / 2)
        at = MODE + 6 * k
        c[at : at + 6] = decay.real, decay.imag, gain.real, gain.imag, weight.real, weight.imag
    # (3 y0 - 4 y1 + y2) / 2 is nearly j angle y; what is missing is added.
    turned = cmath.exp(-1j * angle)
    parabola = (3 - 4 * turned + turned**2) / 2
    scale = derivative / parabola.imag
    c[DIRECT : DIRECT + 3] = 1.5 * scale + direct - scale * parabola.real, -2 * scale, 0.5 * scale
    c[COUNT], c[HALF_STEP] = len(roots), step / 2
    cycle = sampling_hz / frequency_hz
    c[CYCLE], c[KEPT], c[QUIET] = round(cycle), KEPT_CYCLES * cycle, QUIET_CYCLES * cycle
    c[EVERY] = max(round(APART * cycle), 1)
    c[TURN], c[FALL] = 2 * math.cos(angle * c[EVERY]), 1 - 0.5 / cycle
    return c


@njit
def restore(c: Array, s: Array, sample: Array, out: Array) -> None:
    """One sample of six channels: the voltages (three) in front of the transformer into ``out``, the currents
    as they are.  Of a voltage that is missing the last one is taken, and it stays missing."""
    watch(c, s, sample)
    half = c[HALF_STEP]
    if s[SEEN] < BEGINNING * c[CYCLE]:
        s[LEFT] = c[KEPT]
    for phase in range(3):
        p = s[PHASE + phase * PER_PHASE : PHASE + (phase + 1) * PER_PHASE]
        missing = not abs(sample[phase]) < LARGEST
        y1, y2 = p[BEFORE], p[BEFORE + 1]
        y = y1
        if not missing:
            y = sample[phase] - p[OFFSET]
            p[OFFSET] += drawn(c, s, 2, y, p)
        v = c[DIRECT] * y + c[DIRECT + 1] * y1 + c[DIRECT + 2] * y2
        p[BEFORE], p[BEFORE + 1] = y, y1
        rate = y + y1
        for k in range(2):
            own = p[INTEGRALS + k]
            more = own + half * rate
            rate = more + own
            v += c[INTEGRAL + k] * more
            p[INTEGRALS + k] = more - drawn(c, s, k, more, p)
        for k in range(int(c[COUNT])):
            m, x = MODE + 6 * k, MODE_STATE + 2 * k
            re = c[m] * p[x] - c[m + 1] * p[x + 1] + c[m + 2] * (y + y1)
            im = c[m] * p[x + 1] + c[m + 1] * p[x] + c[m + 3] * (y + y1)
            p[x], p[x + 1] = re, im
            v += c[m + 4] * re - c[m + 5] * im
        out[phase] = np.nan if missing else v
        out[3 + phase] = sample[3 + phase]
    s[SEEN] += 1.0


@njit
def drawn(c: Array, s: Array, k: int, value: float, phase: Array) -> float:
    """What is to be taken away from an integral (k = 0, 1) or from the offset (2) at this sample.

    A part of its mean over each two cycles, with the weights of a triangle, which has nothing of a sinusoid
    and little off the nominal frequency; of an integral all of it the first time, and until it may begin."""
    pair = 2.0 * c[CYCLE]
    n = s[SEEN] % pair
    number = s[SEEN] // pair
    if number < k < 2:
        return value
    phase[SUMS + k] += min(n + 1.0, pair - 1.0 - n) / c[CYCLE] ** 2 * value
    if n < pair - 1.0:
        return 0.0
    mean = phase[SUMS + k]
    phase[SUMS + k] = 0.0
    if number == k < 2:
        return mean
    if s[LEFT] > 0.0:
        return 0.0
    return (DRAWN if k < 2 else OFFSET_DRAWN) * mean


@njit
def watch(c: Array, s: Array, sample: Array) -> None:
    """How long the means are to be left alone: a change is what three samples of a sinusoid cannot be."""
    s[PEAK] *= c[FALL]
    s[LEFT] -= 1.0
    s[STILL] += 1.0
    at_mark = s[SEEN] % c[EVERY] == 0.0
    left = 0.0
    for phase in range(3):
        p = s[PHASE + phase * PER_PHASE : PHASE + (phase + 1) * PER_PHASE]
        y = sample[phase] if abs(sample[phase]) < LARGEST else p[BEFORE]
        s[PEAK] = max(s[PEAK], y * y)
        if at_mark:
            left = max(left, abs(y - c[TURN] * p[MARKS] + p[MARKS + 1]))
            p[MARKS], p[MARKS + 1] = y, p[MARKS]
    if left * left <= CHANGE**2 * s[PEAK]:
        return
    if s[STILL] >= c[QUIET]:
        s[LEFT] = c[KEPT]
    s[STILL] = 0.0


# State of an estimator in front: the address of the one that it calls, the constants, the state, a sample.
ADDRESS = 0
_C, _S, _X = ADDRESS + 1, ADDRESS + 1 + CONSTANTS, ADDRESS + 1 + CONSTANTS + STATE
_REST = _X + 6
_called: dict[int, Address] = {}
"""Kept, as an address owns its machine code."""


def estimator_in_front(estimator: Estimator, constants: Array) -> Estimator:
    """The same estimator, of the voltages in front of the transformer."""
    own = np.concatenate([np.zeros(1), constants, np.zeros(STATE + 6), estimator.state])
    settling = estimator.settling_samples + round(BEGINNING * constants[CYCLE])
    inner = estimator.step
    if is_compiled(inner):
        called = Address(inner, *STEP.args)
        _called[called.address] = called
        own[: ADDRESS + 1].view(np.int64)[ADDRESS] = called.address
        return Estimator(estimator.name, step_in_front, own, settling, estimator.delay_samples)

    def step(state: Array, x: Array, out: Array) -> None:
        restore(state[_C:_S], state[_S:_X], x, state[_X:_REST])
        inner(state[_REST:], state[_X:_REST], out)

    return Estimator(estimator.name, step, own, settling, estimator.delay_samples)


@njit
def step_in_front(state: Array, x: Array, out: Array) -> None:
    """Step of an `estimator_in_front`, one machine code for all of them."""
    restore(state[_C:_S], state[_S:_X], x, state[_X:_REST])
    call_step(state[ADDRESS:_C].view(np.int64)[0], state[_REST:], state[_X:_REST], out)
