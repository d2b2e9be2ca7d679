"""The fourth-order (two-axis) synchronous machine: Zhao Zhilei, Huang Jidong, Wang Yi, Yang Zhiwei, "Dynamic
state estimation of generators based on CKMC-CKF under non-Gaussian noise", Guangdong Electric Power, 2024 (3)
(seed paper 003), eq. 2-9; Sauer, Pai, "Power System Dynamics and Stability", 1998, ch. 6.

State of one machine, ``x = (delta, omega, eq, ed)``: rotor angle against a frame that turns at the nominal
speed [rad], deviation from the nominal speed [rad/s, electrical], transient electromotive forces [pu].
Input ``u = (Tm, Ufd, iR, iI)``: mechanical torque, field voltage, stator current out of the machine in the
network's frame [pu].  Parameters: a row of ``PARAMETERS``.

    delta' = omega                                                                  (2)
    omega' = w0 / 2H (Tm - Te - D omega / w0),  Te = vd id + vq iq                  (3)
    eq'    = (Ufd - eq - (xd - x'd) id) / T'd0                                      (4)
    ed'    = (-ed + (xq - x'q) iq) / T'q0                                           (5)

The text of the paper has lost the dot of eq. 2 and, in eq. 6 and 7, the primes of the reactances; eq. 6 has
``id xq`` where eq. 7 and the stator's equations need ``iq x'q``.  So, with eq. 8 and 9 as printed:

    vd = ed + iq x'q,  vq = eq - id x'd
    eR = vd sin(delta) + vq cos(delta),  eI = vq sin(delta) - vd cos(delta)         (6, 7)
    id = iR sin(delta) - iI cos(delta),  iq = iI sin(delta) + iR cos(delta)         (8, 9)
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from faultloop.jit import njit

Array = NDArray[np.float64]

STATES = ("delta", "omega", "eq", "ed")
DELTA, OMEGA, EQ, ED = range(4)
TM, UFD, IR, II = range(4)

PARAMETERS = ("2H/w0", "D/w0", "xd", "xq", "x'd", "x'q", "T'd0", "T'q0", "step")
INERTIA, DAMPING, XD, XQ, XD1, XQ1, TD0, TQ0, STEP = range(9)
"""Inertia and damping are for a speed in rad/s; ``step`` [s] is that of the discrete model below."""


@njit
def to_rotor(delta: float, re: float, im: float) -> tuple[float, float]:
    """``(d, q)`` of a phasor of the network's frame (eq. 8, 9)."""
    sin, cos = math.sin(delta), math.cos(delta)
    return re * sin - im * cos, im * sin + re * cos


@njit
def terminal_voltage(x: Array, i_re: float, i_im: float, p: Array) -> tuple[float, float]:
    """``(eR, eI)``: eq. 6 and 7."""
    i_d, i_q = to_rotor(x[DELTA], i_re, i_im)
    v_d = x[ED] + i_q * p[XQ1]
    v_q = x[EQ] - i_d * p[XD1]
    sin, cos = math.sin(x[DELTA]), math.cos(x[DELTA])
    return v_d * sin + v_q * cos, v_q * sin - v_d * cos


@njit
def derivative(x: Array, u: Array, p: Array, dx: Array) -> None:
    """Eq. 2-5, into ``dx``."""
    i_d, i_q = to_rotor(x[DELTA], u[IR], u[II])
    torque = (x[ED] + i_q * p[XQ1]) * i_d + (x[EQ] - i_d * p[XD1]) * i_q
    dx[DELTA] = x[OMEGA]
    dx[OMEGA] = (u[TM] - torque - p[DAMPING] * x[OMEGA]) / p[INERTIA]
    dx[EQ] = (u[UFD] - x[EQ] - (p[XD] - p[XD1]) * i_d) / p[TD0]
    dx[ED] = (-x[ED] + (p[XQ] - p[XQ1]) * i_q) / p[TQ0]


@njit
def transition(x: Array, u: Array, p: Array, out: Array) -> None:
    """The discrete model, eq. 1: one step of the modified Euler method over ``p[STEP]``.

    ``u`` (12,): the inputs just after the step's start, just before its end, and just after its end.
    """
    slope, other = np.empty(4), np.empty(4)
    derivative(x, u[:4], p, slope)
    for i in range(4):
        out[i] = x[i] + p[STEP] * slope[i]
    derivative(out, u[4:8], p, other)
    for i in range(4):
        out[i] = x[i] + 0.5 * p[STEP] * (slope[i] + other[i])


@njit
def measurement(x: Array, u: Array, p: Array, out: Array) -> None:
    """delta, omega, eR, eI of a state just after the end of a step; ``u`` as for ``transition``."""
    out[0] = x[DELTA]
    out[1] = x[OMEGA]
    out[2], out[3] = terminal_voltage(x, u[8 + IR], u[8 + II], p)


@njit
def wander(noise: Array, inputs: Array, p: Array, states: Array, measurements: Array) -> None:
    """Eq. 1 with its w_k: the discrete model from ``states[0]`` on, and ``noise`` (t, 4) after every step."""
    for k in range(1, len(inputs)):
        transition(states[k - 1], inputs[k], p, states[k])
        for i in range(4):
            states[k, i] += noise[k, i]
        measurement(states[k], inputs[k], p, measurements[k])
