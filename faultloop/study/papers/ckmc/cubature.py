"""Cubature Kalman filter and its two correntropy relatives.

CKF: Arasaratnam, Haykin, "Cubature Kalman filters", IEEE Transactions on Automatic Control 54 (6), 2009.
MCC: Chen, Liu, Zhao, Principe, "Maximum correntropy Kalman filter", Automatica 76, 2017.  CKMC-CKF: Zhao
Zhilei, Huang Jidong, Wang Yi, Yang Zhiwei, "Dynamic state estimation of generators based on CKMC-CKF under
non-Gaussian noise", Guangdong Electric Power, 2024 (3): seed paper 003, whose equations are numbered here.

The cubature filter is the unscented one with alpha = 1, beta = kappa = 0, whose centre has no weight. 2 n
points, each of weight 1 / 2n:

    x +- sqrt(n) a column of the root of P                                  (16-18)

A filter is one ``Cubature``, a prediction and a correction:

    predict(f, transition, u, p)     points drawn, moved, their moments     (19-21)
    redraw(f)                        drawn again, as in the paper           (22-23)
    observe(f, measure, u, p, z)     the innovation and its covariances     (24-26)
    correct_ckf(f) | correct_mcc(f) | correct_ckmc(f)

**MCC-CKF** and **CKMC-CKF** differ in the correction.  The measurement is
linearised statistically, z = zhat + H (x - xhat) with H = Pxz' P^-1 (28); prediction and measurement are one
regression, whose rows the Cholesky factors Bp of P and Br of R make white (29-31).  Instead of the sum of the
squared errors, that of a kernel of each error is maximised (32).  Its derivative at zero (35) weights every
error by -kernel'(e) / e, up to a constant:

    gaussian  exp(-e^2 / 2 s^2)             weight exp(-e^2 / 2 s^2)
    cauchy    1 / (1 + e^2 / s)     (12)    weight 1 / (1 + e^2 / s)^2

and the estimate is a fixed point (36-41).  A Cauchy kernel of bandwidth s begins as a Gaussian one of
sqrt(s) / 2, and falls off slower.  Equations 12 to 42 are missing from the paper's text; these are derived,
and differ from the usual form in this:

- The iteration is for the white deviation w = Bp^-1 (x - xhat), with G = Br^-1 H Bp, y = Br^-1 (z - zhat):

      (Cx + G' Cz G) w = G' Cz y

  the same solution as by K = P~ H' (H P~ H' + R~)^-1 with P~ = Bp Cx^-1 Bp' and R~ = Br Cz^-1 Br', without
  the inverse weights.  Those are what a Gaussian kernel makes infinite (the paper's "singular values in the
  Cholesky factors"); here such an error just counts for nothing.
- It has settled when no component of w moves by more than ``SETTLED`` standard deviations; the usual measure,
  relative to the norm of x, depends on where the angle's zero is.
- Br is of R and the linearisation's own error, Pzz - H P H'.  So the correction is exactly that of the
  cubature filter when all weights are one, which is when the bandwidth goes to infinity.
- The covariance (42) is that of the estimate for the last weights, (I - K H) P (I - K H)' + K R K'.

What neither can do: both kernels' weights fall faster than the error grows, so an innovation that is large
because the *prediction* is wrong is taken for a bad measurement too; the filter stays with its prediction.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numba import typeof, types
from numpy.typing import NDArray

from faultloop.errors import InputError
from faultloop.jit import njit
from faultloop.relay.estimators.filters.kalman import cholesky, correct_jointly

Array = NDArray[np.float64]
Model = Callable[[Array, Array, Array, Array], None]

MOST_ITERATIONS = 50
SETTLED = 1e-6
"""Of a standard deviation."""


class Cubature(NamedTuple):
    """A filter: what a user sets and reads, then what the steps write.

    ``x`` (n,), ``P`` (n, n): estimate and covariance.  ``Q`` (n, n), ``R`` (m, m): noise.  ``bandwidth``
    (1,): of the kernel, in standard deviations (Gaussian) or their squares (Cauchy); the cubature filter has
    none.
    """

    x: Array
    P: Array
    Q: Array
    R: Array
    bandwidth: Array
    points: Array
    images: Array
    innovation: Array
    total: Array
    cross: Array
    gain: Array
    root: Array
    white: Array
    weights: Array


def cubature_filter(x: Array, P: Array, Q: Array, R: Array, bandwidth: float = math.inf) -> Cubature:
    """A filter of n states and m measurements from (n,), (n, n), (n, n), (m, m).

    Raises InputError for a noise or covariance that is not symmetric with positive variances (Q: none
    negative), and for a bandwidth that is not positive.
    """
    n, m = len(x), len(R)
    for name, a, size, least in (("P", P, n, math.ulp(0.0)), ("Q", Q, n, 0.0), ("R", R, m, math.ulp(0.0))):
        if np.shape(a) != (size, size) or not np.allclose(a, np.transpose(a), rtol=1e-9, atol=0):
            raise InputError(f"should be a symmetric {size} x {size} matrix", key=name)
        if not np.linalg.eigvalsh(a).min() >= least:
            raise InputError(f"should have {'positive' if least else 'no negative'} variances", key=name)
    if not bandwidth > 0:
        raise InputError(f"{bandwidth:g} should be positive", key="bandwidth")
    arrays = [np.array(a, dtype=np.float64, order="C") for a in (x, P, Q, R, [bandwidth])]
    shapes = ((2 * n, n), (2 * n, m), (m,), (m, m), (n, m), (n, m), (n, n), (n,), (n + m,))
    return Cubature(*arrays, *(np.zeros(shape) for shape in shapes))


# A model's function (state, inputs, parameters, out) and a correction are passed as values of these types, so
# that `track` compiles once for every model and filter.
_VECTOR = types.float64[::1]
MODEL = types.void(_VECTOR, _VECTOR, _VECTOR, _VECTOR)
CUBATURE = typeof(cubature_filter(np.zeros(1), np.eye(1), np.eye(1), np.eye(1)))
CORRECTION = types.void(CUBATURE)


@njit
def redraw(f: Cubature) -> None:
    """The 2 n points of the present estimate: first those with +, then with -."""
    n = len(f.x)
    cholesky(f.P, f.root)
    scale = math.sqrt(n)
    for i in range(n):
        for j in range(n):
            step = scale * f.root[j, i]
            f.points[i, j] = f.x[j] + step
            f.points[n + i, j] = f.x[j] - step


@njit
def moments(points: Array, noise: Array, mean: Array, covariance: Array) -> None:
    """Mean and covariance of equally weighted points, and the noise's covariance added."""
    count, n = points.shape
    for j in range(n):
        total = 0.0
        for k in range(count):
            total += points[k, j]
        mean[j] = total / count
    for i in range(n):
        for j in range(i + 1):
            total = 0.0
            for k in range(count):
                total += (points[k, i] - mean[i]) * (points[k, j] - mean[j])
            covariance[i, j] = covariance[j, i] = total / count + noise[i, j]


@njit
def predict(f: Cubature, transition: Model, u: Array, p: Array) -> None:
    """``x``, ``P`` and the points a step on; ``transition(x, u, p, out)``."""
    redraw(f)
    for k in range(len(f.points)):
        f.white[:] = f.points[k]
        transition(f.white, u, p, f.points[k])
    moments(f.points, f.Q, f.x, f.P)


@njit
def observe(f: Cubature, measure: Model, u: Array, p: Array, z: Array) -> None:
    """Innovation, its covariance and that with the state, of the points; ``measure(x, u, p, out)``."""
    count, n = f.points.shape
    for k in range(count):
        measure(f.points[k], u, p, f.images[k])
    expected = f.innovation
    moments(f.images, f.R, expected, f.total)
    for i in range(n):
        for j in range(len(z)):
            total = 0.0
            for k in range(count):
                total += (f.points[k, i] - f.x[i]) * (f.images[k, j] - expected[j])
            f.cross[i, j] = total / count
    for j in range(len(z)):
        f.innovation[j] = z[j] - expected[j]


@njit(signature_or_function=CORRECTION)
def correct_ckf(f: Cubature) -> None:
    """The cubature filter's own: K = Pxz Pzz^-1."""
    correct_jointly(f.x, f.P, f.innovation, f.cross, f.total, f.gain)


@njit
def gaussian_weight(e: float, bandwidth: float) -> float:
    return math.exp(-0.5 * (e / bandwidth) ** 2)


@njit
def cauchy_weight(e: float, bandwidth: float) -> float:
    return 1.0 / (1.0 + e * e / bandwidth) ** 2


@njit
def solve_lower(L: Array, B: Array, count: int) -> None:
    """B <- L^-1 B, its first ``count`` columns."""
    for i in range(len(L)):
        for c in range(count):
            v = B[i, c]
            for k in range(i):
                v -= L[i, k] * B[k, c]
            B[i, c] = v / L[i, i]


@njit
def whiten(f: Cubature) -> None:
    """The white rows (29-31): ``gain`` <- G', ``innovation`` <- y; ``root`` <- Bp, ``total`` <- Br.

    ``white`` <- 0: the fixed point is sought from the prediction on.
    """
    n, m = f.cross.shape
    cholesky(f.P, f.root)
    f.gain[:] = f.cross
    solve_lower(f.root, f.gain, m)  # Bp' H' = Bp^-1 Pxz
    for i in range(m):
        for j in range(m):
            for k in range(n):
                f.total[i, j] -= f.gain[k, i] * f.gain[k, j]
    cholesky(f.total, f.total)
    for i in range(m):
        for k in range(i):
            f.innovation[i] -= f.total[i, k] * f.innovation[k]
            for c in range(n):
                f.gain[c, i] -= f.total[i, k] * f.gain[c, k]
        f.innovation[i] /= f.total[i, i]
        for c in range(n):
            f.gain[c, i] /= f.total[i, i]
    f.white[:] = 0.0


@njit
def normal_factor(f: Cubature, factor: Array) -> None:
    """Cholesky factor of Cx + G' Cz G; where all weights are zero the prediction stays."""
    n, m = f.gain.shape
    for i in range(n):
        for j in range(i + 1):
            v = f.weights[i] + 1e-12 if i == j else 0.0
            for k in range(m):
                v += f.gain[i, k] * f.weights[n + k] * f.gain[j, k]
            factor[i, j] = factor[j, i] = v
    cholesky(factor, factor)


@njit
def solve_normal(factor: Array, b: Array) -> None:
    """b <- (L L')^-1 b."""
    n = len(b)
    for i in range(n):
        for k in range(i):
            b[i] -= factor[i, k] * b[k]
        b[i] /= factor[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            b[i] -= factor[k, i] * b[k]
        b[i] /= factor[i, i]


@njit
def white_errors(f: Cubature) -> None:
    """The rows' errors at the present ``white``, into ``weights`` (33, 34)."""
    n, m = f.gain.shape
    for i in range(n):
        f.weights[i] = f.white[i]
    for k in range(m):
        e = f.innovation[k]
        for i in range(n):
            e -= f.gain[i, k] * f.white[i]
        f.weights[n + k] = e


@njit
def settle(f: Cubature) -> bool:
    """The next ``white`` for the present weights (36-41); True if it is that of before."""
    n, m = f.gain.shape
    factor, solution = f.points[:n], f.points[n]  # the points have done their work
    normal_factor(f, factor)
    for i in range(n):
        solution[i] = 0.0
        for k in range(m):
            solution[i] += f.gain[i, k] * f.weights[n + k] * f.innovation[k]
    solve_normal(factor, solution)
    moved = 0.0
    for i in range(n):
        moved = max(moved, abs(solution[i] - f.white[i]))
        f.white[i] = solution[i]
    return moved <= SETTLED


@njit
def conclude(f: Cubature) -> None:
    """``x`` and ``P`` from the white deviation and the last weights.

    With A = (Cx + G' Cz G)^-1 G' Cz, P <- Bp ((I - A G)(I - A G)' + A A') Bp'.
    """
    n, m = f.gain.shape
    factor = f.points[:n]
    spread = np.zeros((n, n + m))  # Bp [I - A G, A]
    for k in range(m):
        column = f.points[n]
        for i in range(n):
            column[i] = f.gain[i, k] * f.weights[n + k]
        solve_normal(factor, column)
        for i in range(n):
            spread[i, n + k] = column[i]
    for i in range(n):
        for j in range(n):
            spread[i, j] = 1.0 if i == j else 0.0
            for k in range(m):
                spread[i, j] -= spread[i, n + k] * f.gain[j, k]
    for i in range(n - 1, -1, -1):  # a row of Bp reaches up to itself, so from the last
        step = 0.0
        for k in range(i + 1):
            step += f.root[i, k] * f.white[k]
        f.x[i] += step
        for c in range(n + m):
            v = 0.0
            for k in range(i + 1):
                v += f.root[i, k] * spread[k, c]
            spread[i, c] = v
    for i in range(n):
        for j in range(i + 1):
            v = 0.0
            for c in range(n + m):
                v += spread[i, c] * spread[j, c]
            f.P[i, j] = f.P[j, i] = v


@njit(signature_or_function=CORRECTION)
def correct_mcc(f: Cubature) -> None:
    """Maximum correntropy with the Gaussian kernel."""
    whiten(f)
    for _ in range(MOST_ITERATIONS):
        white_errors(f)
        for i in range(len(f.weights)):
            f.weights[i] = gaussian_weight(f.weights[i], f.bandwidth[0])
        if settle(f):
            break
    conclude(f)


@njit(signature_or_function=CORRECTION)
def correct_ckmc(f: Cubature) -> None:
    """Maximum correntropy with the Cauchy kernel."""
    whiten(f)
    for _ in range(MOST_ITERATIONS):
        white_errors(f)
        for i in range(len(f.weights)):
            f.weights[i] = cauchy_weight(f.weights[i], f.bandwidth[0])
        if settle(f):
            break
    conclude(f)


class Series(NamedTuple):
    """What is tracked: (t, k) inputs, (t, m) measurements and their variances, the model's parameters."""

    inputs: Array
    measurements: Array
    variances: Array
    parameters: Array


SERIES = typeof(Series(np.zeros((1, 1)), np.zeros((1, 1)), np.zeros((1, 1)), np.zeros(1)))


@njit(
    signature_or_function=types.void(
        types.FunctionType(MODEL),
        types.FunctionType(MODEL),
        types.FunctionType(CORRECTION),
        CUBATURE,
        SERIES,
        types.float64[:, ::1],
    )
)
def track(
    transition: Model,
    measure: Model,
    correct: Callable[[Cubature], None],
    f: Cubature,
    series: Series,
    states: Array,
) -> None:
    """Filter a series with ``correct``, the estimates into ``states`` (t, n); row 0 is the initial one.

    The diagonal of ``f.R`` is that of each sample.
    """
    states[0] = f.x
    for k in range(1, len(series.inputs)):
        u = series.inputs[k]
        predict(f, transition, u, series.parameters)
        redraw(f)
        for j in range(len(f.R)):
            f.R[j, j] = series.variances[k, j]
        observe(f, measure, u, series.parameters, series.measurements[k])
        correct(f)
        states[k] = f.x


def as_model(function: Any) -> Any:
    """A compiled ``function(x, u, p, out)``, ready for ``track``."""
    if MODEL.args not in function.overloads:
        function.compile(MODEL.args)
    return function
