"""A user's own generator tracked from a record of its terminals.

The filters are those of Zhao Zhilei, Huang Jidong, Wang Yi, Yang Zhiwei, "Dynamic state estimation of
generators based on CKMC-CKF under non-Gaussian noise", Guangdong Electric Power, 2024 (3): seed paper 003.

from faultloop.study.own_data import read_series
from faultloop.study.papers.ckmc.cases import ckmc
from faultloop.study.papers.ckmc.generator import Generator, track_generator

record = read_series("generator.csv")
constants = Generator(h_s=30.3, xd=0.295, xq=0.282, xd1=0.0697, xq1=0.17, td0_s=6.56, tq0_s=1.5)
states = track_generator(record, constants, ckmc(50.0))      # (n, 4): delta, omega, eq, ed
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from faultloop.errors import InputError
from faultloop.study.own_data import Series
from faultloop.study.papers.ckmc import cubature
from faultloop.study.papers.ckmc.cases import CKF, P0, Filter, Q, R
from faultloop.study.papers.ckmc.machines import machine

Array = NDArray[np.float64]

INPUTS = ("tm", "ufd", "ir", "ii")
MEASURED = ("delta", "omega", "er", "ei")
LEAST_TIME_CONSTANTS = 2.0  # frames in the shortest one: the model's step must be shorter


@dataclass(frozen=True)
class Generator:
    """Constants of a two-axis machine, per unit on the base of the record.

    h_s, td0_s, tq0_s : inertia constant and open-circuit transient time constants [s].  damping : torque
    per speed deviation [pu/pu].
    """

    h_s: float
    xd: float
    xq: float
    xd1: float
    xq1: float
    td0_s: float
    tq0_s: float
    damping: float = 0.0
    frequency_hz: float = 60.0

    def parameters(self, step_s: float) -> Array:
        """``machine.PARAMETERS``.  Raises InputError for one that is not positive, or too long a step."""
        for each in fields(self):
            value = getattr(self, each.name)
            if not (value >= 0 if each.name == "damping" else value > 0) or not math.isfinite(value):
                raise InputError(f"{value!r} should be positive", key=each.name)
        if step_s * LEAST_TIME_CONSTANTS > min(self.td0_s, self.tq0_s):
            raise InputError(
                f"{1 / step_s:g} frames a second are too few for a time constant of "
                f"{min(self.td0_s, self.tq0_s):g} s",
                key="tq0_s",
            )
        w0 = 2.0 * math.pi * self.frequency_hz
        constants = (self.xd, self.xq, self.xd1, self.xq1, self.td0_s, self.tq0_s)
        return np.array([2.0 * self.h_s / w0, self.damping / w0, *constants, step_s])


def track_generator(
    series: Series,
    generator: Generator,
    by: Filter = CKF,
    *,
    q: Array = Q,
    r: Array = R,
    start: Array | None = None,
) -> Array:
    """The states delta, omega, eq, ed of a generator, (n, 4); the first row is the start.

    Parameters
    ----------
    series : with the columns tm, ufd, ir, ii (mechanical torque, field voltage, stator current out of the
        machine in the network's frame [pu]) and the measured delta [rad], omega [rad/s off nominal], er
        and ei [pu].
    by : ``CKF``, ``mcc(bandwidth)`` or ``ckmc(bandwidth)`` of `faultloop.study.papers.ckmc.cases`.
    q, r : (4,) variances of the state noise per frame and of the measurements.
    start : (4,) first state; not given, the measured angle and speed, and the electromotive forces that go
        with the first frame's voltage and current.

    Raises InputError for a column that is missing or not a number, for q, r or start of another shape, and as
    `Generator.parameters` and `cubature_filter`.
    """
    u = np.column_stack([series.column(name) for name in INPUTS])
    z = np.ascontiguousarray(np.column_stack([series.column(name) for name in MEASURED]))
    for names, table in ((INPUTS, u), (MEASURED, z)):
        bad = ~np.isfinite(table).all(axis=0)
        if bad.any():
            raise InputError(f"'{names[int(np.argmax(bad))]}' is not a number somewhere", file=series.file)
    q, r = (_four(name, given) for name, given in (("q", q), ("r", r)))
    start = None if start is None else _four("start", start)
    parameters = generator.parameters(1.0 / series.sampling_hz)
    inputs = np.hstack([np.vstack([u[:1], u[:-1]]), u, u])
    first = initial_state(z[0], u[0], parameters) if start is None else start
    state = cubature.cubature_filter(first, P0 * np.eye(4), np.diag(q), np.diag(r), by.bandwidth)
    told = np.broadcast_to(r, z.shape).copy()
    out = np.empty_like(z)
    transition, measure = (cubature.as_model(f) for f in (machine.transition, machine.measurement))
    cubature.track(transition, measure, by.correct, state, cubature.Series(inputs, z, told, parameters), out)
    return out


def _four(name: str, given: object) -> Array:
    values = np.asarray(given, dtype=np.float64)
    if values.shape != (4,) or not np.isfinite(values).all():
        raise InputError("should be four numbers", key=name)
    return values


def initial_state(z: Array, u: Array, parameters: Array) -> Array:
    """eq and ed from the first frame's voltage and current (eq. 6 to 9 solved for them)."""
    delta, omega, v_re, v_im = z
    i_d, i_q = machine.to_rotor(delta, u[machine.IR], u[machine.II])
    v_d, v_q = machine.to_rotor(delta, v_re, v_im)
    e_q = v_q + i_d * parameters[machine.XD1]
    e_d = v_d - i_q * parameters[machine.XQ1]
    return np.array([delta, omega, e_q, e_d])
