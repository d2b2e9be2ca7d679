"""Scaled sigma points (Julier 2002; van der Merwe 2004) and the moments of what a function makes of them.

A filter draws points, replaces each by its image, and takes the moments back:

    draw(x, P, spread, points, root)
    for i in range(len(points)): f(points[i])
    moments(points, spread, excess, x, P);  P += Q

The usual weights (eq. 22 to 25 of seed paper 001) are W0 = 1 - n / s and W = 1 / (2 s) with
s = alpha^2 (n + kappa), and 1 - alpha^2 + beta more on W0 for the covariance.  With alpha = 1e-3 and nine
states W0 is -1e6, and a covariance summed so can lose its sign.  With e_i the difference from the centre's
image, and d = W sum e_i the mean less the centre's image, the same sums are

    mean = centre + d,    covariance = W sum e_i e_i' + (beta - alpha^2) d d'

which is never negative for beta >= alpha^2.
"""

from __future__ import annotations

from faultloop.jit import njit
from faultloop.relay.estimators.base import Array
from faultloop.relay.estimators.filters.kalman import cholesky
from faultloop.relay.estimators.parameters import number


def sigma_spread(n: int, alpha: float, beta: float, kappa: float) -> tuple[float, float]:
    """``spread`` s = alpha^2 (n + kappa) = n + lambda, and ``excess`` beta - alpha^2.

    Raises
    ------
    InputError : alpha or n + kappa not positive, beta below alpha^2 (the covariance could be negative), or
        one that is too large.
    """
    alpha = number("alpha", alpha, above=0.0, most=10.0)
    kappa = number("kappa", kappa, above=-n, most=1e6)
    beta = number("beta", beta, least=alpha**2, most=1e6)
    return alpha**2 * (n + kappa), beta - alpha**2


@njit
def draw(x: Array, P: Array, spread: float, points: Array, root: Array) -> None:
    """Points x and x +- the columns of the root of s P: (2 n + 1, n), the centre first, then +, then -.

    ``root`` (n, n) is overwritten with the Cholesky factor of P.
    """
    n = len(x)
    cholesky(P, root)
    scale = spread**0.5
    for j in range(n):
        points[0, j] = x[j]
        for i in range(n):
            step = scale * root[j, i]
            points[1 + i, j] = x[j] + step
            points[1 + n + i, j] = x[j] - step


@njit
def mean_of(points: Array, spread: float, mean: Array) -> None:
    """Weighted mean of the points, into ``mean``."""
    count, n = points.shape
    weight = 0.5 / spread
    for j in range(n):
        mean[j] = 0.0
    for i in range(1, count):
        for j in range(n):
            mean[j] += points[i, j] - points[0, j]
    for j in range(n):
        mean[j] = points[0, j] + weight * mean[j]


@njit
def covariance_of(points: Array, spread: float, excess: float, mean: Array, covariance: Array) -> None:
    """Weighted covariance of the points about their ``mean``."""
    count, n = points.shape
    weight = 0.5 / spread
    for i in range(n):
        for j in range(i + 1):
            covariance[i, j] = 0.0
    for p in range(1, count):
        for i in range(n):
            e = points[p, i] - points[0, i]
            for j in range(i + 1):
                covariance[i, j] += e * (points[p, j] - points[0, j])
    for i in range(n):
        d = excess * (mean[i] - points[0, i])
        for j in range(i + 1):
            v = weight * covariance[i, j] + d * (mean[j] - points[0, j])
            covariance[i, j] = v
            covariance[j, i] = v


@njit
def cross_covariance_of(
    points: Array, images: Array, spread: float, excess: float, means: Array, cross: Array
) -> None:
    """Weighted covariance (n, m) of points (2 n + 1, n) and their images (2 n + 1, m).

    ``means`` is the pair of their means.
    """
    count, n = points.shape
    m = images.shape[1]
    weight = 0.5 / spread
    mean, image = means
    for i in range(n):
        for j in range(m):
            v = 0.0
            for p in range(1, count):
                v += (points[p, i] - points[0, i]) * (images[p, j] - images[0, j])
            d = (mean[i] - points[0, i]) * (image[j] - images[0, j])
            cross[i, j] = weight * v + excess * d


@njit
def moments(points: Array, spread: float, excess: float, mean: Array, covariance: Array) -> None:
    """Mean and covariance of the points."""
    mean_of(points, spread, mean)
    covariance_of(points, spread, excess, mean, covariance)
