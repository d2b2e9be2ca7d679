"""What a relay at A measures of a fault on an R-L line that is fed from A alone and carries no load.

Symmetrical components (Fortescue, 1918): E is the source's phase voltage, x the place per unit of the line,
R the resistance of each faulted phase.  From that the depth m of each characteristic, as docs/relay.md
defines it, and so the resistance at which m is 1: an oracle that shares no code with the relay.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable
from typing import NamedTuple

from faultloop.study.suites.distance.network import (
    BASE_KV,
    Z0_OVER_Z1_OF_SOURCE,
    Network,
)

A = cmath.exp(2j * math.pi / 3)
TILT = math.radians(3.0)
"""Of the quadrilateral, by default."""


class Measured(NamedTuple):
    """The faulted loop.

    Attributes
    ----------
    voltage, current : of the loop; a ground loop's current is the compensated one.
    polarizing_voltage : the memory's, of the loop: that of before the fault.
    fault_current : of the resistance; the polarizing current of the reactance line has its angle.
    """

    voltage: complex
    current: complex
    polarizing_voltage: complex
    fault_current: complex


def measured(network: Network, kind: str, x: float, r: float) -> Measured:
    """Of AG, BC or ABC."""
    e = BASE_KV * 1e3 / math.sqrt(3)
    zs1 = network.sir * network.z1_ohm
    zs0 = Z0_OVER_Z1_OF_SOURCE * zs1
    z1, z0 = zs1 + x * network.z1_ohm, zs0 + x * network.z0_ohm
    if kind == "AG":
        i = e / (2 * z1 + z0 + 3 * r)
        v = (e - zs1 * i) - zs1 * i - zs0 * i
        k0 = (network.z0_ohm - network.z1_ohm) / (3 * network.z1_ohm)
        return Measured(v, 3 * i + k0 * 3 * i, e, 3 * i)
    i1 = e / (2 * z1 + 2 * r) if kind == "BC" else e / (z1 + r)
    i2 = -i1 if kind == "BC" else 0.0
    v1, v2 = e - zs1 * i1, -zs1 * i2
    turn1, turn2 = A**2 - A, A - A**2  # of the loop B - C, from phase A's sequence values
    return Measured(turn1 * v1 + turn2 * v2, turn1 * i1 + turn2 * i2, turn1 * e, turn1 * i1 + turn2 * i2)


def depth(network: Network, characteristic: str, reach_pu: float, loop: Measured) -> float:
    """m, a part of the reach; inside where it is below 1."""
    drop = reach_pu * network.z1_ohm * loop.current
    if characteristic == "mho":
        p = loop.polarizing_voltage.conjugate()
        return (loop.voltage * p).real / (drop * p).real
    p = (loop.fault_current * cmath.exp(-1j * TILT)).conjugate()
    return (loop.voltage * p).imag / (drop * p).imag


def boundary(inside: Callable[[float], bool], low: float, high: float) -> float:
    """Where `inside` turns from true at ``low`` to false at ``high``, by bisection."""
    for _ in range(60):
        middle = (low + high) / 2
        if inside(middle):
            low = middle
        else:
            high = middle
    return (low + high) / 2


def resistance_at(network: Network, characteristic: str, kind: str, reach_pu: float, x: float) -> float:
    """The resistance at which a fault at x leaves a mho, or the reactance line of a quadrilateral [ohm]."""
    return boundary(
        lambda r: depth(network, characteristic, reach_pu, measured(network, kind, x, r)) < 1,
        0.0,
        100 * abs(network.z1_ohm) * (1 + network.sir),
    )
