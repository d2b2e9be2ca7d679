"""Kalman filter (Kalman 1960), in steps; the extended filter is the same with the Jacobian for F.

Covariances are kept symmetric by computing the lower triangle and mirroring it: 45 products instead of 81
for nine states, and no drift apart of the two halves.
"""

from __future__ import annotations

import math

from faultloop.jit import njit
from faultloop.relay.estimators.base import Array

# A pivot below this part of its diagonal is rounding: the matrix is singular there.
SINGULAR = 1e-15


@njit
def predict_state(x: Array, F: Array, work: Array) -> None:
    """x <- F x.  ``work`` (n,) is overwritten."""
    n = len(x)
    for i in range(n):
        v = 0.0
        for j in range(n):
            v += F[i, j] * x[j]
        work[i] = v
    for i in range(n):
        x[i] = work[i]


@njit
def predict_covariance(P: Array, F: Array, Q: Array, work: Array) -> None:
    """P <- F P F' + Q.  ``work`` (n, n) is overwritten; Q is (n, n)."""
    n = P.shape[0]
    for i in range(n):
        for j in range(n):
            work[i, j] = 0.0
        for k in range(n):
            f = F[i, k]
            if f != 0.0:  # a transition is mostly zeros: 0.3 us instead of 0.5 for nine harmonic states
                for j in range(n):
                    work[i, j] += f * P[k, j]
    for i in range(n):
        for j in range(i + 1):
            P[i, j] = Q[i, j]
        for k in range(n):
            f = F[i, k]
            if f != 0.0:
                for j in range(i + 1):
                    P[i, j] += f * work[j, k]
        for j in range(i):
            P[j, i] = P[i, j]


@njit
def predicted_variance(P: Array, row: Array) -> float:
    """h P h' of a scalar measurement z = h x."""
    total = 0.0
    for i in range(len(row)):
        if row[i] != 0.0:
            for j in range(len(row)):
                total += row[i] * P[i, j] * row[j]
    return total


@njit
def innovation_of(x: Array, row: Array, z: float) -> float:
    """z - h x."""
    for i in range(len(row)):
        z -= row[i] * x[i]
    return z


@njit
def correct(x: Array, P: Array, row: Array, innovation: float, R: float, gain: Array) -> None:
    """Correct by a scalar measurement z = h x + v of variance R.

    ``gain`` (n,) is overwritten with K.  P <- P - K S K', which for this K is (I - K h) P.  Several
    measurements with independent noise are as many calls, each with its own innovation.
    """
    n = len(x)
    total = R
    for i in range(n):
        v = 0.0
        for j in range(n):
            v += P[i, j] * row[j]
        gain[i] = v
    for i in range(n):
        total += row[i] * gain[i]
    for i in range(n):
        gain[i] /= total
        x[i] += gain[i] * innovation
    for i in range(n):
        for j in range(i + 1):
            v = P[i, j] - gain[i] * total * gain[j]
            P[i, j] = v
            P[j, i] = v


@njit
def cholesky(A: Array, L: Array) -> bool:
    """Lower triangle L with L L' = A; the upper one of L is cleared.

    A may be singular (a state that is known exactly): a pivot that is nothing but rounding, below 1e-15 of
    its diagonal, gives a column of zeros.  A may be ``L`` itself.  Returns False if a column was zeroed.
    """
    n = A.shape[0]
    regular = True
    for j in range(n):
        pivot = A[j, j]
        least = SINGULAR * pivot
        for k in range(j):
            pivot -= L[j, k] * L[j, k]
        # Not `pivot <= least`: a NaN would pass.
        root = math.sqrt(pivot) if pivot > least else 0.0
        regular = regular and root > 0.0
        for i in range(j + 1, n):
            v = A[i, j]
            for k in range(j):
                v -= L[i, k] * L[j, k]
            L[i, j] = v / root if root > 0.0 else 0.0
        L[j, j] = root
    for i in range(n):
        for j in range(i + 1, n):
            L[i, j] = 0.0
    return regular


@njit
def correct_jointly(x: Array, P: Array, innovation: Array, cross: Array, total: Array, gain: Array) -> None:
    """Correct by a vector measurement, from the joint covariance of state and measurement.

    Parameters
    ----------
    x, P : (n,), (n, n) predicted state and covariance, corrected in place.
    innovation : (m,).
    cross : (n, m) covariance of state and measurement, P_xz.
    total : (m, m) covariance of the innovation, P_zz with the noise in it; overwritten by its Cholesky
        factor.
    gain : (n, m) overwritten with K = P_xz P_zz^-1.

    With P_zz = L L' and G = P_xz L^-T this is x + G L^-1 e and P - G G'.
    """
    n, m = cross.shape
    cholesky(total, total)
    for i in range(n):
        for j in range(m):
            v = cross[i, j]
            for k in range(j):
                v -= gain[i, k] * total[j, k]
            gain[i, j] = v / total[j, j]
    for i in range(n):
        for j in range(i + 1):
            v = P[i, j]
            for k in range(m):
                v -= gain[i, k] * gain[j, k]
            P[i, j] = v
            P[j, i] = v
    for i in range(n):
        for j in range(m - 1, -1, -1):
            v = gain[i, j]
            for k in range(j + 1, m):
                v -= gain[i, k] * total[k, j]
            gain[i, j] = v / total[j, j]
        for j in range(m):
            x[i] += gain[i, j] * innovation[j]
