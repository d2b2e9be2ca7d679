"""Three poles that conduct or do not: breakers, and faults; and the search for their current zeros.

A conducting pole is a conductance in the network's matrix, which is factored anew for each state.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from faultloop.jit import njit
from faultloop.plant.elements import GROUND, Floats, Ints

CONTACT_OHM = 1e-4
"""Of a closed pole, and the least of a fault from phase to common point and from there to ground."""
NO_CURRENT = 1e-6
"""A pole with less than this carries nothing but rounding, and opens at once [A]."""
POLE_BITS = np.array([1, 2, 4])
Kind = Literal["pole", "fault"]


class Switch(Protocol):
    """Three poles between two nodes."""

    kind: ClassVar[Kind]
    """What a change of it is called."""

    @property
    def start(self) -> str: ...
    @property
    def end(self) -> str: ...
    @property
    def closed(self) -> bool:
        """Whether its poles conduct when the run begins."""
        ...

    def conductances(self) -> Floats:
        """(8, 9) between its ends, by the mask of the poles that conduct (A = 1, B = 2, C = 4): 3x3 [S]."""
        ...


EVERY_MASK = (np.arange(8)[:, None] & POLE_BITS) != 0
"""(8, 3) which poles conduct."""


def _diagonal(values: Floats) -> Floats:
    """(8, 3, 3) of (8, 3)."""
    return values[:, :, None] * np.eye(3)


_CONTACTS = _diagonal(EVERY_MASK / CONTACT_OHM).reshape(8, 9)


@dataclass(frozen=True)
class Poles:
    """A breaker's: three contacts beside each other."""

    start: str
    end: str
    closed: bool = True
    kind: ClassVar[Kind] = "pole"

    def conductances(self) -> Floats:
        return _CONTACTS


@dataclass(frozen=True)
class Star:
    """A fault's, from a node: each phase by a resistance to a common point, that to ground; the point is
    eliminated."""

    start: str
    phase_ohm: float
    ground_ohm: float
    """Infinite: the common point floats."""
    end: str = GROUND
    closed: bool = False
    kind: ClassVar[Kind] = "fault"

    def conductances(self) -> Floats:
        return _of_star(self.phase_ohm, self.ground_ohm)


_PLACE = np.where(
    EVERY_MASK[:, :, None] & EVERY_MASK[:, None, :],
    2 * EVERY_MASK.sum(axis=1)[:, None, None] - np.eye(3, dtype=np.int64),
    0,
).reshape(8, 9)
"""Of each entry in `_of_star`'s numbers: with n poles that conduct 2 n - 1 on the diagonal, 2 n beside it."""


def _of_star(phase_ohm: float, ground_ohm: float) -> Floats:
    """With n poles of conductance y on, and the point's y0 to ground: y - y^2 / (n y + y0) on the diagonal,
    -y^2 / (n y + y0) beside it."""
    y, ground = 1 / max(phase_ohm, CONTACT_OHM), 1 / max(ground_ohm, CONTACT_OHM)
    coupling = [y * y / (total + ground) for total in (y, y + y, y + y + y)]
    return np.array([0.0, *(number for c in coupling for number in (y - c, -c))])[_PLACE]


class Action(NamedTuple):
    """Something due at a step.  ``make``: the poles begin to conduct; ``part``: they part, and conduct on to
    their current zero."""

    step: int
    kind: Literal["make", "part"]
    switch: int
    mask: int
    planned: bool = False
    """By the scenario; no command takes it back."""


def poles(mask: int) -> NDArray[np.bool_]:
    """(3,) of a bit mask."""
    return (mask & POLE_BITS) != 0


@njit(forceinline=True)
def switch_currents(bus: Ints, conductance: Floats, v: Floats, current: Floats) -> None:
    """Through every switch; ``bus`` (switches, 2) rows of v, ``conductance`` (switches, 9) [S]."""
    for s in range(bus.shape[0]):
        u, w, y = v[bus[s, 0]], v[bus[s, 1]], conductance[s]
        d0, d1, d2 = u[0] - w[0], u[1] - w[1], u[2] - w[2]
        for p in range(3):
            current[s, p] = y[3 * p] * d0 + y[3 * p + 1] * d1 + y[3 * p + 2] * d2


@njit
def waiting(armed: NDArray[np.bool_]) -> bool:
    """Whether any pole waits for its current zero; ``armed`` (switches, 3)."""
    for s in range(armed.shape[0]):
        for p in range(3):
            if armed[s, p]:
                return True
    return False


@njit
def crossings(armed: NDArray[np.bool_], old: Floats, current: Floats, zero: Floats) -> bool:
    """Looks for a zero of each armed pole's current between the one kept and the present one (switches, 3);
    ``zero`` becomes where (0 .. 1; -1: nowhere)."""
    found = False
    for s in range(armed.shape[0]):
        for p in range(3):
            zero[s, p] = -1.0
            if armed[s, p]:
                i, j = old[s, p], current[s, p]
                if abs(i) <= NO_CURRENT:
                    zero[s, p] = 0.0
                elif i * j < 0.0:
                    zero[s, p] = i / (i - j)
                found = found or zero[s, p] >= 0.0
    return found
