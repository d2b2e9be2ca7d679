"""Two sources and a line, solved in phase coordinates: an answer that shares nothing with the relay.

Three buses S, F, R of three phases each; every impedance is a 3x3 matrix with (2 z1 + z0) / 3 on the diagonal
and (z0 - z1) / 3 beside it.  The fault is an admittance at F.  All phasors RMS, primary.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass, field

import numpy as np

TYPES = ("AG", "BG", "CG", "AB", "BC", "CA", "ABG", "BCG", "CAG", "ABC", "ABCG")
SOLID = 1e-6


def matrix(z1: complex, z0: complex) -> np.ndarray:
    return np.eye(3) * z1 + np.ones((3, 3)) * (z0 - z1) / 3


def fault_admittance(kind: str, resistance: float, ground: float) -> np.ndarray:
    """Star of one resistance per faulted phase, its point grounded through ``ground`` or floating."""
    phases = ["ABC".index(p) for p in kind if p in "ABC"]
    y = 1 / (resistance + SOLID)
    star = np.zeros((4, 4), complex)
    for p in phases:
        star[p, p] += y
        star[3, 3] += y
        star[p, 3] -= y
        star[3, p] -= y
    if kind.endswith("G"):
        star[3, 3] += 1 / (ground + SOLID)
    return star[:3, :3] - np.outer(star[:3, 3], star[3, :3]) / star[3, 3]


@dataclass(frozen=True)
class Network:
    """Line z1, z0; sources zs1, zs0 behind the relay and zr1, zr0 at the far end; load by angle_deg."""

    z1: complex = complex(3.0, 30.0)
    z0: complex = complex(12.0, 90.0)
    zs1: complex = complex(1.0, 12.0)
    zs0: complex = complex(1.5, 15.0)
    zr1: complex = complex(1.5, 18.0)
    zr0: complex = complex(3.0, 30.0)
    kv: float = 230.0
    angle_deg: float = -15.0  # of the far source: the relay's end exports
    frequency_hz: float = 50.0
    sampling_hz: int = 4800
    tau_s: float = 0.04
    open_pole: int | None = field(default=None)

    def solve(
        self, kind: str = "", at: float = 0.5, resistance: float = 0.0, ground: float = 0.0
    ) -> np.ndarray:
        """va vb vc ia ib ic at the relay (at S, current into the line); ``at`` < 0 is behind the relay."""
        turn = np.exp(-2j * np.pi / 3 * np.arange(3))
        e = self.kv * 1e3 / math.sqrt(3)
        es = e * turn
        er = e * cmath.exp(1j * math.radians(self.angle_deg)) * turn
        near, far = (max(at, 1e-7), 1 - max(at, 1e-7)) if at >= 0 else (0.5, 0.5)
        behind = matrix(self.zs1, self.zs0)
        ys = np.linalg.inv(behind)
        yr = np.linalg.inv(matrix(self.zr1, self.zr0) + far * matrix(self.z1, self.z0))
        z_near = near * matrix(self.z1, self.z0)
        if self.open_pole is not None:
            z_near = z_near + np.diag([1e9 if p == self.open_pole else 0.0 for p in range(3)])
        yl = np.linalg.inv(z_near)
        y = np.zeros((6, 6), complex)
        y[:3, :3] = ys + yl
        y[:3, 3:] = y[3:, :3] = -yl
        y[3:, 3:] = yl + yr
        if kind:
            place = slice(3, 6) if at >= 0 else slice(0, 3)
            y[place, place] += fault_admittance(kind, resistance, ground)
        v = np.linalg.solve(y, np.concatenate([ys @ es, yr @ er]))
        return np.concatenate([v[:3], yl @ (v[:3] - v[3:])])

    def samples(self, stages: list[tuple[float, np.ndarray]], duration_s: float) -> np.ndarray:
        """Sinusoids that change at the stages' times; currents go over with a decaying offset of tau_s."""
        t = np.arange(round(duration_s * self.sampling_hz)) / self.sampling_hz
        w = 2 * math.pi * self.frequency_hz
        x = np.zeros((len(t), 6))
        offset = np.zeros(6)
        begun, before = 0.0, None
        for start, phasors in stages:
            after = t >= start
            wave = math.sqrt(2) * np.real(phasors * np.exp(1j * w * t[after])[:, None])
            if before is not None:
                turn = math.sqrt(2) * cmath.exp(1j * w * start)
                left = offset * math.exp(-(start - begun) / self.tau_s)
                offset = left + np.real((before - phasors) * turn)
                offset[:3] = 0
                offset[phasors == 0] = 0  # a breaker opens at a current zero: nothing is left
            wave += offset * np.exp(-(t[after] - start) / self.tau_s)[:, None]
            x[after] = wave
            begun, before = start, phasors
        return x

    def fault(
        self, kind: str, at: float, start_s: float = 0.1, duration_s: float = 0.25, **rest: float
    ) -> np.ndarray:
        """Load until ``start_s``, then the fault."""
        return self.samples([(0.0, self.solve()), (start_s, self.solve(kind, at, **rest))], duration_s)


def settings_dict(network: Network, zones: list[dict], **tables: dict) -> dict:
    """Settings for a network, primary ohms."""
    base = {
        "relay": {"sampling_hz": network.sampling_hz, "frequency_hz": 50},
        "estimator": {"method": "fourier"},
        "line": {
            "z1_ohm": [network.z1.real, network.z1.imag],
            "z0_ohm": [network.z0.real, network.z0.imag],
        },
        "pdis": zones,
    }
    result = base | {"vt": {"kind": "ideal"}} | tables
    return result | {"estimator": {"unsafe": True} | result["estimator"]}


def play(relay, samples: np.ndarray, block: int = 10**9) -> list:
    """Feed all samples; returns the events."""
    events, done = [], 0
    while done < len(samples):
        done += relay.advance(samples[done : done + block])
        events += relay.events
    return events
