"""The nodal conductance matrix in 3x3 blocks, one per pair of buses, as L D L^T.

Buses are numbered in the order of elimination, so that block (j, i) of L has j > i.  A network that Bergeron
lines cut into parts is a forest of elimination trees: each part costs only itself, and a part of one bus is
one 3x3 product.  With blocks this needs no more multiplications than a dense inverse even for two or three
buses (9 n^2 dense; 9 (n + 2 blocks of L) here), so one method serves all sizes.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from faultloop.jit import njit


class Structure(NamedTuple):
    """Column pattern of L, the same for every switch state."""

    pointer: NDArray[np.int64]
    """(n + 1,) first block of each column."""
    row: NDArray[np.int64]
    """(blocks,) row of each block, ascending in a column."""


class Factor(NamedTuple):
    """Numbers of one switch state."""

    inverse: NDArray[np.float64]
    """(n, 9) inverses of the diagonal blocks D."""
    lower: NDArray[np.float64]
    """(blocks, 9) blocks of L."""
    switch: NDArray[np.float64]
    """(switches, 9) conductance between the two ends of each three-pole switch [S]."""
    response: NDArray[np.float64]
    """(varistors, 3, n, 3) voltages that one ampere through a varistor's phase makes [ohm]."""


def elimination_order(count: int, pairs: Iterable[tuple[int, int]]) -> list[int]:
    """Minimum degree (Tinney and Walker, 1967, scheme 2); ties go to the lower number."""
    neighbours: list[set[int]] = [set() for _ in range(count)]
    for i, j in pairs:
        neighbours[i].add(j)
        neighbours[j].add(i)
    buckets: list[set[int]] = [set() for _ in range(count + 1)]
    for node, around in enumerate(neighbours):
        buckets[len(around)].add(node)
    order: list[int] = []
    degree = 0
    while len(order) < count:
        while not buckets[degree]:
            degree += 1
        node = min(buckets[degree])
        buckets[degree].remove(node)
        order.append(node)
        for other in neighbours[node]:
            buckets[len(neighbours[other])].discard(other)
            neighbours[other] |= neighbours[node] - {other}
            neighbours[other].discard(node)
            buckets[len(neighbours[other])].add(other)
        degree = max(0, degree - 1)
    return order


def symbolic(count: int, pairs: Iterable[tuple[int, int]]) -> Structure:
    """The pattern of L with its fill, for buses already in elimination order."""
    columns: list[set[int]] = [set() for _ in range(count)]
    for i, j in pairs:
        columns[min(i, j)].add(max(i, j))
    for column in columns:
        if column:
            columns[min(column)] |= column - {min(column)}  # the rest of a column fills its parent's
    rows = [sorted(column) for column in columns]
    pointer = np.cumsum([0, *(len(r) for r in rows)]).astype(np.int64)
    return Structure(pointer, np.array([j for r in rows for j in r], dtype=np.int64))


@njit(heap=True)
def factorize(structure: Structure, diagonal: NDArray[np.float64], lower: NDArray[np.float64]) -> None:
    """In place: ``diagonal`` (n, 9) and ``lower`` (blocks, 9) of the matrix become D^-1 and L."""
    product = np.empty(9)
    column = lower.copy()
    for i in range(diagonal.shape[0]):
        invert(diagonal[i])
        first, last = structure.pointer[i], structure.pointer[i + 1]
        for k in range(first, last):
            for c in range(9):
                column[k, c] = lower[k, c]
            multiply(column[k], diagonal[i], lower[k])
        for k in range(first, last):
            for m in range(first, k + 1):
                multiply_transposed(lower[k], column[m], product)
                j, row = structure.row[m], structure.row[k]
                if row == j:
                    subtract(diagonal[j], product)
                    continue
                at = structure.pointer[j]
                while structure.row[at] != row:
                    at += 1
                subtract(lower[at], product)


@njit
def subtract(a: NDArray[np.float64], b: NDArray[np.float64]) -> None:
    """a -= b, 3x3."""
    for c in range(9):
        a[c] -= b[c]


@njit
def multiply(a: NDArray[np.float64], b: NDArray[np.float64], out: NDArray[np.float64]) -> None:
    """out = a b, 3x3."""
    for r in range(3):
        for c in range(3):
            out[3 * r + c] = a[3 * r] * b[c] + a[3 * r + 1] * b[3 + c] + a[3 * r + 2] * b[6 + c]


@njit
def multiply_transposed(a: NDArray[np.float64], b: NDArray[np.float64], out: NDArray[np.float64]) -> None:
    """out = a b^T, 3x3."""
    for r in range(3):
        for c in range(3):
            out[3 * r + c] = a[3 * r] * b[3 * c] + a[3 * r + 1] * b[3 * c + 1] + a[3 * r + 2] * b[3 * c + 2]


@njit
def invert(a: NDArray[np.float64]) -> None:
    """A symmetric positive definite 3x3 matrix in place, by L D L^T: cofactors would cancel where a bolted
    phase-to-phase fault makes it nearly singular."""
    d0 = a[0]
    l1, l2 = a[3] / d0, a[6] / d0
    d1 = a[4] - l1 * a[3]
    l3 = (a[7] - l2 * a[3]) / d1
    d2 = a[8] - l2 * a[6] - l3 * l3 * d1
    m2 = l1 * l3 - l2  # inverse of L: rows (1), (-l1, 1), (m2, -l3, 1)
    a[8] = 1 / d2
    a[7] = a[5] = -l3 / d2
    a[6] = a[2] = m2 / d2
    a[4] = 1 / d1 + l3 * l3 / d2
    a[3] = a[1] = -l1 / d1 - l3 * m2 / d2
    a[0] = 1 / d0 + l1 * l1 / d1 + m2 * m2 / d2


@njit(forceinline=True)
def solve(structure: Structure, factor: Factor, y: NDArray[np.float64]) -> None:
    """Injected currents (n or more rows, 3) become the voltages, in place."""
    inverse, lower, pointer, row = factor.inverse, factor.lower, structure.pointer, structure.row
    count = inverse.shape[0]
    for i in range(count):
        y0, y1, y2 = y[i, 0], y[i, 1], y[i, 2]
        for k in range(pointer[i], pointer[i + 1]):
            j = row[k]
            y[j, 0] -= lower[k, 0] * y0 + lower[k, 1] * y1 + lower[k, 2] * y2
            y[j, 1] -= lower[k, 3] * y0 + lower[k, 4] * y1 + lower[k, 5] * y2
            y[j, 2] -= lower[k, 6] * y0 + lower[k, 7] * y1 + lower[k, 8] * y2
    for i in range(count - 1, -1, -1):
        y0, y1, y2 = y[i, 0], y[i, 1], y[i, 2]
        x0 = inverse[i, 0] * y0 + inverse[i, 1] * y1 + inverse[i, 2] * y2
        x1 = inverse[i, 3] * y0 + inverse[i, 4] * y1 + inverse[i, 5] * y2
        x2 = inverse[i, 6] * y0 + inverse[i, 7] * y1 + inverse[i, 8] * y2
        for k in range(pointer[i], pointer[i + 1]):
            j = row[k]
            x0 -= lower[k, 0] * y[j, 0] + lower[k, 3] * y[j, 1] + lower[k, 6] * y[j, 2]
            x1 -= lower[k, 1] * y[j, 0] + lower[k, 4] * y[j, 1] + lower[k, 7] * y[j, 2]
            x2 -= lower[k, 2] * y[j, 0] + lower[k, 5] * y[j, 1] + lower[k, 8] * y[j, 2]
        y[i, 0], y[i, 1], y[i, 2] = x0, x1, x2
