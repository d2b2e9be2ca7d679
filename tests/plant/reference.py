"""A two-ended network as a scenario, and its faulted steady state from textbook equations alone.

Nothing here comes from the plant: phase-domain nodal analysis with 3x3 matrices from sequence parameters,
lines by the exact hyperbolic equations (or plain series impedance for ``rl``), the fault as its admittance.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from faultloop.study.suites.functions.two_ended import (
    BASE_KV,
    FORTESCUE,
    KM,
    LINE,
    SOURCES,
    A,
    build,
    network,
    phasors,
)

Complex = NDArray[np.complex128]

__all__ = [
    "BASE_KV",
    "FORTESCUE",
    "KM",
    "LINE",
    "SOURCES",
    "A",
    "build",
    "fault_admittance",
    "network",
    "phase_matrix",
    "phasors",
    "solve",
]


def phase_matrix(zero: complex, positive: complex) -> Complex:
    """Of a balanced element from its sequence values (Fortescue)."""
    return FORTESCUE @ np.diag([zero, positive, positive]) @ np.linalg.inv(FORTESCUE)


def line_admittance(model: str, km: float) -> tuple[Complex, Complex]:
    """Own and mutual 3x3 admittance of a stretch: i_k = own v_k - mutual v_m."""
    own, mutual = [], []
    for s in "01":
        z = complex(LINE["r" + s], LINE["x" + s]) * km
        if model == "rl":
            own.append(1 / z)
            mutual.append(1 / z)
            continue
        y = 1e-6j * LINE["b" + s] * km
        gamma, zc = np.sqrt(z * y), np.sqrt(z / y)
        own.append(1 / (zc * np.tanh(gamma)))
        mutual.append(1 / (zc * np.sinh(gamma)))
    return phase_matrix(*own), phase_matrix(*mutual)


def fault_admittance(kind: str, resistance: float, ground: float) -> Complex:
    """Each faulted phase through ``resistance`` to a point, that through ``ground`` to earth; the point is
    eliminated by Kron's reduction of the 4x4 matrix."""
    floor = 1e-9
    y = np.zeros((4, 4), dtype=complex)
    for phase in kind.rstrip("G"):
        p, g = "ABC".index(phase), 1 / max(resistance, floor)
        y[p, p] += g
        y[3, 3] += g
        y[p, 3] -= g
        y[3, p] -= g
    if kind.endswith("G"):
        y[3, 3] += 1 / max(ground, floor)
    return y[:3, :3] - np.outer(y[:3, 3], y[3, :3]) / y[3, 3]


def solve(
    model: str, position: float, kind: str | None, resistance: float = 0.0, ground: float = 0.0
) -> Complex:
    """(2, 6) peak phasors va vb vc ia ib ic at both ends; the current includes that of a fault at the end.

    The bolted fault (resistance 1e-9 ohm in the reference) is solved as a port: the network's impedance seen
    from the fault point, so that no huge admittance spoils the answer."""
    nodes = ["A", "F", "B"]
    y = np.zeros((3, 3, 3, 3), dtype=complex)  # node, phase, node, phase
    injected = np.zeros((3, 3), dtype=complex)
    for i, bus in ((0, "A"), (2, "B")):
        angle, z1, z0 = SOURCES[bus]
        ys = phase_matrix(1 / z0, 1 / z1)
        y[i, :, i] += ys
        emf = BASE_KV * 1e3 * np.sqrt(2 / 3) * np.exp(1j * np.radians(angle)) * np.array([1, A**2, A])
        injected[i] = ys @ emf
    tiny = 1e-6  # km: stands for no length where the fault is at an end
    lengths = (max(position * KM, tiny), max((1 - position) * KM, tiny))
    parts = [
        (i, j, *line_admittance(model, km)) for (i, j), km in zip(((0, 1), (1, 2)), lengths, strict=True)
    ]
    for i, j, own, mutual in parts:
        y[i, :, i] += own
        y[j, :, j] += own
        y[i, :, j] -= mutual
        y[j, :, i] -= mutual
    z = np.linalg.inv(y.reshape(9, 9))
    v = z @ injected.ravel()
    if kind is not None:
        yf = fault_admittance(kind, max(resistance, 1e-9), ground)
        at = slice(3 * nodes.index("F"), 3 * nodes.index("F") + 3)
        current = np.linalg.solve(np.eye(3) + yf @ z[at, at], yf @ v[at])
        v = v - z[:, at] @ current
    v = v.reshape(3, 3)
    out = np.zeros((2, 6), dtype=complex)
    for end, node in ((0, 0), (1, 2)):
        _, _, own, mutual = parts[end]
        out[end, :3] = v[node]
        out[end, 3:] = own @ v[node] - mutual @ v[1]
    return out
