"""Transposed lines by sequence parameters, and the travelling-wave (Bergeron) section.

Every 3x3 matrix of a transposed line is circulant and symmetric; it is kept as its two eigenvalues,
``[mode 0, mode 1]`` (zero and positive sequence).  Mode 1 is that of both aerial modes of the Clarke
transformation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from faultloop.config.scenario import Line

Pair = NDArray[np.float64]
"""``[mode 0, mode 1]``."""

PI_SECTION_KM = 20.0
"""Longest nominal-pi section where the scenario does not say: within 2e-4 of the exact line at 60 Hz."""
BERGERON_ERROR = 4e-4
"""A Bergeron stretch is cascaded until its two-port is this near the exact long line at system frequency."""
TAPS = 4


@dataclass(frozen=True)
class LineConstants:
    """Per kilometre: series resistance [ohm], inductance [H], capacitance [F], each ``[mode 0, mode 1]``."""

    r: Pair
    l: Pair
    c: Pair
    frequency_hz: float

    @classmethod
    def of(cls, line: Line, frequency_hz: float) -> LineConstants:
        omega = 2 * np.pi * frequency_hz
        return cls(
            r=np.array([line.r0_ohm_per_km, line.r1_ohm_per_km]),
            l=np.array([line.x0_ohm_per_km, line.x1_ohm_per_km]) / omega,
            c=np.array([line.b0_us_per_km, line.b1_us_per_km]) * 1e-6 / omega,
            frequency_hz=frequency_hz,
        )

    def travel_time(self, length_km: float) -> Pair:
        """Of a lossless wave over the length [s]."""
        return length_km * np.sqrt(self.l * self.c)

    def exact_admittances(self, length_km: float) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        """Exact long-line two-port at system frequency, per mode, as its admittance [S] for equal voltages at
        both ends, ``tanh(gl/2)/Zc``, and for opposite ones, ``coth(gl/2)/Zc``."""
        omega = 2 * np.pi * self.frequency_hz
        z = np.asarray(self.r + 1j * omega * self.l, dtype=np.complex128)
        y = np.asarray(1j * omega * self.c, dtype=np.complex128)
        zc = np.sqrt(z / y)
        tanh = np.tanh(np.sqrt(z * y) * (length_km / 2))
        return np.asarray(tanh / zc, np.complex128), np.asarray(1 / (tanh * zc), np.complex128)


@dataclass(frozen=True)
class Wave:
    """One Bergeron section: Dommel's lossless line with R/4 lumped at each end and R/2 in the middle
    (H. W. Dommel, 1969, eq. 9, appendix II).  Arrays ``[mode 0, mode 1]``.

    The end current is ``i = y v + h``, ``h = -(1 + H)/2 u_far(t - tau) - (1 - H)/2 u_near(t - tau)`` with
    ``u = y v + H i``.  ``u(t - tau)`` is a Lagrange polynomial over four steps (three where tau is under two
    steps), used where its gain never exceeds one at any frequency (V. Valimaki, 1995, section 3.3), so that
    the line stays passive.  Linear interpolation, the usual choice, acts as a series resistance of up to
    (w dt)^2 Zc / 4 = 0.02 ohm at 52 us, 0.3 % of a 20 km section; this is below 2e-5 of any.
    """

    y: Pair
    """1 / (Zc + R/4) [S]."""
    h: Pair
    """(Zc - R/4) / (Zc + R/4)."""
    delay: Pair
    """Travel time [steps]."""
    newest: NDArray[np.int64]
    """Delay of the newest tap [steps]."""
    weights: NDArray[np.float64]
    """(2, 4): mode, tap from the newest to the oldest."""

    @classmethod
    def of(cls, constants: LineConstants, length_km: float, dt: float) -> Wave:
        zc = np.sqrt(constants.l / constants.c)
        quarter = constants.r * length_km / 4
        delay = constants.travel_time(length_km) / dt
        newest = np.where(delay < 2, 1, np.floor(delay).astype(np.int64) - 1)
        count = np.where(delay < 2, TAPS - 1, TAPS)
        weights = np.zeros((2, TAPS))
        for mode in range(2):
            weights[mode, : count[mode]] = lagrange(delay[mode] - newest[mode], int(count[mode]))
        return cls(
            1 / (zc + quarter), (zc - quarter) / (zc + quarter), delay, newest.astype(np.int64), weights
        )

    def admittances(self, angle_per_step: float) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        """The discrete two-port at ``angle_per_step`` [rad], as `LineConstants.exact_admittances`.

        With equal (opposite) voltages the two histories add to ``h = -(+)u D c``, c = 1 (c = -H)."""
        taps = self.newest[:, None] + np.arange(TAPS)
        d = (self.weights * np.exp(-1j * angle_per_step * taps)).sum(axis=1)
        return self.y * (1 - d) / (1 + self.h * d), self.y * (1 + self.h * d) / (1 - self.h**2 * d)

    def error(self, constants: LineConstants, length_km: float, dt: float) -> float:
        """Largest relative error of the two-port at system frequency."""
        exact = constants.exact_admittances(length_km)
        ours = self.admittances(2 * np.pi * constants.frequency_hz * dt)
        return max(float(np.abs(a / b - 1).max()) for a, b in zip(ours, exact, strict=True))


def lagrange(position: float, count: int) -> NDArray[np.float64]:
    """Weights of the polynomial through nodes 0 .. count-1 at ``position``."""
    nodes = np.arange(count)
    products = [np.prod([(position - m) / (k - m) for m in nodes if m != k]) for k in nodes]
    return np.array(products, dtype=np.float64)


def bergeron_sections(constants: LineConstants, length_km: float, dt: float) -> int:
    """How many equal sections bring the lumped losses within `BERGERON_ERROR`, as far as each section still
    has a step's travel time; 0 where the whole stretch has not."""
    longest = int(constants.travel_time(length_km).min() / dt)
    for count in range(1, longest + 1):
        wave = Wave.of(constants, length_km / count, dt)
        if count == longest or wave.error(constants, length_km / count, dt) < BERGERON_ERROR:
            return count
    return 0
