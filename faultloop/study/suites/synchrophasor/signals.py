"""Test signals of IEC/IEEE 60255-118-1 with their phasor, frequency and ROCOF in closed form.

Six channels: balanced voltages of 1 pu (RMS) and currents of 0.2 pu, 30 degrees behind.  The phasor is phase
a's voltage, X(t) = magnitude exp(j angle) against cos(2 pi f0 t); frequency = f0 + angle' / (2 pi), ROCOF its
derivative.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Function = Callable[[Array], NDArray[Any]]

LAGS = 2.0 * np.pi / 3.0 * np.array([0.0, 1.0, -1.0])
CURRENT = 0.2
CURRENT_LAG = np.pi / 6.0
TURNS = np.exp(-1j * np.concatenate([LAGS, LAGS + CURRENT_LAG])) * np.repeat([1.0, CURRENT], 3)


def constant(value: float) -> Function:
    """The function that is ``value`` at all times."""
    return lambda t: np.full_like(t, value)


@dataclass(frozen=True)
class Tone:
    """A sinusoid that is added to each phase: ``part`` of 1 pu at ``hz``, of the phase sequence of ``order``:
    phase k lags by ``order`` times 120 degrees."""

    hz: float
    part: float
    order: int = 1
    angle: float = 0.0


@dataclass(frozen=True)
class Wave:
    """A test signal: functions of the time [s].

    Attributes
    ----------
    magnitude : RMS [pu].
    angle : [rad] against cos(2 pi f0 t).
    frequency : [Hz].
    rocof : [Hz/s].
    """

    magnitude: Function
    angle: Function
    frequency: Function
    rocof: Function
    tone: Tone | None = None

    def phasor(self, t: Array) -> NDArray[np.complex128]:
        """X(t), phase a's voltage, (n,)."""
        return self.magnitude(t) * np.exp(1j * self.angle(t))

    def samples(self, t: Array, frequency_hz: float) -> Array:
        """The six channels at the times t, (n, 6)."""
        carrier = np.sqrt(2.0) * self.phasor(t) * np.exp(2j * np.pi * frequency_hz * t)
        wave = np.real(carrier[:, None] * TURNS)
        if self.tone is not None:
            turn = 2.0 * np.pi * self.tone.hz * t + self.tone.angle
            lags = self.tone.order * np.concatenate([LAGS, LAGS + CURRENT_LAG])
            size = np.sqrt(2.0) * self.tone.part * np.repeat([1.0, CURRENT], 3)
            wave = wave + size * np.cos(turn[:, None] - lags)
        return np.ascontiguousarray(wave)


def steady(
    frequency_hz: float, offset_hz: float = 0.0, magnitude: float = 1.0, tone: Tone | None = None
) -> Wave:
    """Constant magnitude and frequency f0 + offset."""
    return Wave(
        constant(magnitude),
        lambda t: 2.0 * np.pi * offset_hz * t,
        constant(frequency_hz + offset_hz),
        constant(0.0),
        tone,
    )


def modulated(frequency_hz: float, rate_hz: float, *, magnitude: float = 0.0, angle: float = 0.0) -> Wave:
    """Magnitude 1 + kx cos(w t) and angle ka cos(w t - pi), kx = ``magnitude``, ka = ``angle`` [rad]."""
    w = 2.0 * np.pi * rate_hz
    return Wave(
        lambda t: 1.0 + magnitude * np.cos(w * t),
        lambda t: -angle * np.cos(w * t),
        lambda t: frequency_hz + angle * rate_hz * np.sin(w * t),
        lambda t: angle * rate_hz * w * np.cos(w * t),
    )


def ramp(frequency_hz: float, span_hz: float, rate_hz_per_s: float, start_s: float) -> Wave:
    """Frequency f0 - span until the start, then up at the rate to f0 + span, and constant again; a negative
    rate runs from f0 + span down."""
    length = 2.0 * span_hz / abs(rate_hz_per_s)
    first = -np.sign(rate_hz_per_s) * span_hz

    def along(t: Array) -> Array:
        return np.clip(t - start_s, 0.0, length)

    def angle(t: Array) -> Array:
        s = along(t)
        after = np.maximum(t - start_s - length, 0.0)
        turns = first * (np.minimum(t, start_s) + s) + 0.5 * rate_hz_per_s * s**2 - first * after
        return 2.0 * np.pi * turns

    return Wave(
        constant(1.0),
        angle,
        lambda t: frequency_hz + first + rate_hz_per_s * along(t),
        lambda t: np.where((t >= start_s) & (t <= start_s + length), rate_hz_per_s, 0.0),
    )


def step(
    frequency_hz: float, at_s: float, *, magnitude: float = 0.0, angle: float = 0.0, phase: float = 0.0
) -> Wave:
    """Magnitude 1 to 1 + ``magnitude`` or angle ``phase`` to ``phase + angle`` [rad] at ``at_s``."""
    return Wave(
        lambda t: 1.0 + magnitude * (t >= at_s),
        lambda t: phase + angle * (t >= at_s),
        constant(frequency_hz),
        constant(0.0),
    )
