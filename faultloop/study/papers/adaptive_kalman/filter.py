"""The filter of seed paper 000 as the paper writes it, for many signals at a time.

Zhang Zhe, Chen Deshu, "Application of the adaptive Kalman filter in computer relaying" (Chinese; its text
names neither journal nor year).

Three rules for the variance:

- ``EQ_10``: R(k) = e(k)^2 - H P H' of this one sample, nothing else.  Many are negative; the paper does not
  say what then, and a variance below zero is taken as zero.
- ``FLOOR``: the same, with a floor under it.
- ``KNOWN``: R is given, the ordinary filter.

Places of the printed text that are corrected, or that do not hold: the likelihood has b^(-j), not b^(2j), in
its exponent, and its sums start at 1.  Eq. 7 is one equation for b, of which "e^2(j) b^-j constant" is a
solution that no set of samples has: eq. 8, the squared innovation, is the maximum-likelihood estimate over
one sample and not over k.  Eq. 9 and 10 stand by themselves: e^2 - H P H' is unbiased, whatever its origin,
if P is the true covariance - and P is that only if R was the true variance before.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

EQ_10, FLOOR, KNOWN = "eq. 10", "floor", "known"
VOLTAGE, DECAYING, INITIAL_VALUE = "voltage", "eq. 3-4", "eq. 11-12"
LEAST = 1e-24  # of a variance, over the squared peak: no 0 / 0


@dataclass(frozen=True)
class Rule:
    """How a filter runs.

    variance : EQ_10, FLOOR or KNOWN.
    renewed : P is P(0) again at the inception; else the filter runs on from the load.
    spread : standard deviation of P(0) over each signal's peak.
    floor : least (KNOWN: the) standard deviation of the noise, over the same peak, up to the inception.
    fading : time constant with which its variance then decays [samples], R0 exp(-k dT / T) of the paper.
    peak : the peak to take; each signal's own where it is not given.
    """

    variance: str
    renewed: bool
    spread: float = 2.0
    floor: float = 0.005
    peak: float | None = None
    fading: float = np.inf


class Run(NamedTuple):
    """Phasors (peak, against cos w k T), e, H P H' and the R that it took, each (n, runs)."""

    phasors: Complex
    innovation: Array
    predicted: Array
    variance: Array


def measurement(form: str, count: int, since: int, per_cycle: float, decay: Array) -> Array:
    """Rows H(k) of eq. 2, 4 or 12, (count, runs, states); ``since`` the sample of the inception."""
    angle = 2.0 * np.pi * np.arange(count) / per_cycle
    columns = [np.cos(angle)[:, None] + 0.0 * decay, -np.sin(angle)[:, None] + 0.0 * decay]
    if form == DECAYING:
        columns.append(np.ones((count, len(decay))))
    elif form == INITIAL_VALUE:
        columns.append(decay ** np.maximum(np.arange(count) - since, 0)[:, None])
    return np.stack(columns, axis=-1)


def run_filter(z: Array, rule: Rule, form: str, since: int, per_cycle: float, decay: Array) -> Run:
    """Filter ``z`` (n, runs), an inception at sample ``since``.

    decay : (runs,), the assumed exp(-T / Td) of each; not used for voltages.
    """
    count, runs = z.shape
    rows = measurement(form, count, since, per_cycle, decay)
    states = rows.shape[2]
    transition = np.ones((runs, states))
    if form == DECAYING:
        transition[:, 2] = decay
    peak = np.abs(z).max(axis=0) ** 2 if rule.peak is None else np.full(runs, rule.peak**2)
    fresh = (rule.spread**2 * peak)[:, None, None] * np.eye(states)
    least = peak * (LEAST if rule.variance == EQ_10 else rule.floor**2)
    x, p = np.zeros((runs, states)), fresh.copy()
    found = Run(np.empty((count, runs), np.complex128), *(np.empty((count, runs)) for _ in range(3)))
    for k in range(count):
        x = x * transition
        p = p * transition[:, :, None] * transition[:, None, :]
        if rule.renewed and k == since:
            p = fresh.copy()
        ph = np.einsum("rij,rj->ri", p, rows[k])
        predicted = np.maximum(np.einsum("ri,ri->r", ph, rows[k]), 0.0)  # rounding, where R was zero
        e = z[k] - np.einsum("ri,ri->r", rows[k], x)
        low = least * np.exp(-max(k - since, 0) / rule.fading)
        variance = low if rule.variance == KNOWN else np.maximum(e * e - predicted, low)
        gain = ph / (predicted + variance)[:, None]
        x = x + gain * e[:, None]
        p = p - ph[:, :, None] * ph[:, None, :] / (predicted + variance)[:, None, None]
        found.phasors[k] = x[:, 0] + 1j * x[:, 1]
        found.innovation[k], found.predicted[k], found.variance[k] = e, predicted, variance
    return found
