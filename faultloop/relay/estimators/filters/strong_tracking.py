"""Strong tracking: a fading factor widens the covariance as far as the residuals ask for.

The factor is sought such that the innovations' covariance h P h' + R is what they show, V (eq. 12, a mean
of hardly two samples), less what the softening factor beta forgives, (beta - 1) R.  It is one unless V
exceeds beta R.

- `step_strong` (STF: Zhou Donghua, Xi Yugeng, Zhang Zhongjun, "A suboptimal multiple fading extended Kalman
  filter", Acta Automatica Sinica 17 (6), 1991; here eq. 4 to 12 of seed paper 001) extends the extended
  filter: lambda F P F' + Q.
- `step_strong_unscented` (STUKF: Wang Xiaoxu, Zhao Lin, Xia Quanxi, Hao Yong, "Strong tracking filter based
  on unscented transformation", Control and Decision 25 (7), 2010; reference 14 there) says the same in sigma
  points, three transforms a step.
- `step_modified` (MSTUKF: Wang Yi, Liu Heng and others, "Transient voltage disturbance detection based on
  modified strong tracking UKF", Power System Protection and Control, 2017, seed paper 001, eq. 20 to 39)
  multiplies Q too, lambda (F P F' + Q), by one transform, as h is linear.

All three give the same h P h' = V - beta R where lambda > 1.  They differ in the share of Q, which after a
step is small, and in how the transition is linearised.

- `step_disturbed` is ours.  The three above take the shape of P from the past, and its size from the first
  residual of a disturbance, which is small wherever the waveform begins to change; P must then be widened
  again and again.  With alpha = 1 they widen the frequency too, which no disturbance of the amplitudes asks
  for, and by it they run away in noise of variance R at beta = 1.8.  Here P <- P + a D with D = diag of what
  a disturbance is expected to change (zero for the frequency), and a = (V - beta R - h P h') / h D h', but
  at least one: the paper's text (section 2, "enlarge the weight of Q") rather than its eq. 26, with a Q of
  its own for disturbances.

Departures.  Eq. 9 has a factor for each state, and without prior knowledge (alpha_j = 1) one for all; here
the frequency's alpha is a setting, and a diagonal factor is taken in halves, so that P stays symmetric.
Eq. 11 traces F P F' H' H, which for one measurement is h F P F' h'.  Eq. 10 and 12 are one sample apart in
their subscripts; V, Q and R are all those of the sample at hand.  Eq. 35 divides matrices; for one
measurement it is eq. 39.  P is computed symmetric: in full products it loses its symmetry to rounding,
lambda multiplies the loss, and STF then ends in NaN within the paper's own sag.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from faultloop.jit import njit
from faultloop.relay.estimators.filters.harmonic_model import (
    EXCESS,
    FADING,
    FORGETTING,
    FREQUENCY_SHARE,
    INNOVATION,
    PREDICTED,
    RESIDUAL_VARIANCE,
    SOFTENING,
    SPREAD,
    Array,
    HarmonicFilter,
    correct_linear,
    predict_extended,
    predict_unscented,
)
from faultloop.relay.estimators.filters.kalman import correct_jointly, innovation_of, predicted_variance
from faultloop.relay.estimators.filters.unscented import cross_covariance_of, draw, moments


class Seen(NamedTuple):
    """What the transform of h overwrites: for n states and one measurement."""

    images: Array  # (2 n + 1, 1)
    mean: Array  # (1,)
    total: Array  # (1, 1)
    innovation: Array  # (1,)
    cross: Array  # (n, 1)
    gain: Array  # (n, 1)


def seen(states: int) -> Seen:
    """Its arrays."""
    one, cross = np.zeros(1), np.zeros((states, 1))
    return Seen(np.zeros((2 * states + 1, 1)), one, np.zeros((1, 1)), one.copy(), cross, cross.copy())


@njit
def follow_residual(f: HarmonicFilter, z: float) -> float:
    """V of eq. 12, with the sample z; to be called on the predicted x."""
    e = innovation_of(f.x, f.row, z)
    rho = f.settings[FORGETTING]
    before = f.memory[RESIDUAL_VARIANCE]
    f.memory[INNOVATION] = e
    f.memory[RESIDUAL_VARIANCE] = e * e if before < 0.0 else (rho * before + e * e) / (1.0 + rho)
    return f.memory[RESIDUAL_VARIANCE]


@njit
def fading_factor(f: HarmonicFilter, wanted: float, predicted: float) -> float:
    """lambda = tr N / tr M where above one (eq. 9, 38, 39)."""
    fades = wanted > predicted > 0.0
    f.memory[FADING] = wanted / predicted if fades else 1.0
    f.memory[PREDICTED] = 0.0 if fades else predicted
    return f.memory[FADING]


@njit
def fade(f: HarmonicFilter, factor: float, Q: Array) -> None:
    """P <- L (P - Q) L + Q with L^2 = diag(factor, ..., factor, that of the frequency), none of them beyond
    what makes the variance ``widest``; Q is None where it fades with P (eq. 26)."""
    if factor > 1.0:
        n = len(f.x)
        root = f.gain
        for i in range(n):
            own = factor if i < n - 1 else f.settings[FREQUENCY_SHARE] * factor
            root[i] = math.sqrt(max(1.0, min(own, f.widest[i] / f.P[i, i])))
        for i in range(n):
            for j in range(n):
                times = root[i] * root[j]
                f.P[i, j] *= times
                if Q is not None:
                    f.P[i, j] -= (times - 1.0) * Q[i, j]


@njit
def step_strong(f: HarmonicFilter, z: float, R: float) -> None:
    """STF: eq. 4 to 12."""
    predict_extended(f)
    noise = predicted_variance(f.Q, f.row)
    wanted = follow_residual(f, z) - noise - f.settings[SOFTENING] * R
    fade(f, fading_factor(f, wanted, predicted_variance(f.P, f.row) - noise), f.Q)
    correct_linear(f, z, R)


@njit
def step_modified(f: HarmonicFilter, z: float, R: float) -> None:
    """MSTUKF: eq. 20 to 39."""
    predict_unscented(f)
    wanted = follow_residual(f, z) - f.settings[SOFTENING] * R
    fade(f, fading_factor(f, wanted, predicted_variance(f.P, f.row)), None)
    correct_linear(f, z, R)


@njit
def step_disturbed(f: HarmonicFilter, z: float, R: float) -> None:
    """MSTUKF that widens P by what a disturbance is expected to change."""
    predict_unscented(f)
    wanted = follow_residual(f, z) - f.settings[SOFTENING] * R
    predicted = predicted_variance(f.P, f.row)
    if fading_factor(f, wanted, predicted) > 1.0:
        share = 0.0
        for i in range(len(f.x)):
            share += f.row[i] * f.disturbance[i]
        times = max(1.0, (wanted - predicted) / share)
        for i in range(len(f.x)):
            f.P[i, i] += max(0.0, min(times * f.disturbance[i], f.widest[i] - f.P[i, i]))
    correct_linear(f, z, R)


@njit
def observe(f: HarmonicFilter, s: Seen, R: float) -> None:
    """Sigma points of x and P and what h makes of them: mean, variance with R, covariance with x."""
    spread, excess = f.settings[SPREAD], f.settings[EXCESS]
    draw(f.x, f.P, spread, f.points, f.root)
    for i in range(f.points.shape[0]):
        s.images[i, 0] = -innovation_of(f.points[i], f.row, 0.0)
    moments(s.images, spread, excess, s.mean, s.total)
    cross_covariance_of(f.points, s.images, spread, excess, (f.x, s.mean), s.cross)
    s.total[0, 0] += R


@njit
def noise_share(f: HarmonicFilter, s: Seen) -> float:
    """P_xz' P^-1 Q P^-1 P_xz, which is h Q h' for a linear h; ``f.root`` is the factor of P."""
    n = len(f.x)
    y = f.gain
    for i in range(n):  # L a = P_xz, then L' y = a
        y[i] = s.cross[i, 0]
        for j in range(i):
            y[i] -= f.root[i, j] * y[j]
        y[i] = y[i] / f.root[i, i] if f.root[i, i] > 0.0 else 0.0
    for i in range(n - 1, -1, -1):
        for j in range(i + 1, n):
            y[i] -= f.root[j, i] * y[j]
        y[i] = y[i] / f.root[i, i] if f.root[i, i] > 0.0 else 0.0
    return predicted_variance(f.Q, y)


@njit
def step_strong_unscented(f: HarmonicFilter, s: Seen, z: float, R: float) -> None:
    """STUKF, as its authors write it: a transform to predict, one for lambda, one to correct.

    With P_zz as before the fading, R in it, N = V - P_xz' P^-1 Q P^-1 P_xz - beta R and M = P_zz - V + N +
    (beta - 1) R, lambda = tr N / tr M.
    """
    predict_unscented(f)
    V = follow_residual(f, z)
    softening = f.settings[SOFTENING]
    observe(f, s, R)
    wanted = V - noise_share(f, s) - softening * R
    factor = fading_factor(f, wanted, s.total[0, 0] - V + wanted + (softening - 1.0) * R)
    fade(f, factor, f.Q)
    observe(f, s, R)
    s.innovation[0] = z - s.mean[0]
    correct_jointly(f.x, f.P, s.innovation, s.cross, s.total, s.gain)
