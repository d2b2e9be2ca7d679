"""A pseudo-continuous ramp: phasors injected into a relay, as by a test set, whose impedance moves slowly."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from faultloop.relay import Relay, RelaySettings
from faultloop.study.suites.distance.closed_form import A
from faultloop.study.suites.distance.network import BASE_KV, REACH, Z0_OVER_Z1_OF_SOURCE, Network

SAMPLING_HZ = 4800
BEFORE_S = 0.2
STEP_S, STEP = 0.025, 0.001
"""The place moves by so much of the reach at a time."""
FROM, TO = 1.2, 0.9
"""Of the reach, and back again."""


class Ramp(NamedTuple):
    """Where the zone started on the way in, and dropped out on the way back, per unit of the line."""

    sir: float
    kind: str
    characteristic: str
    operates: float
    resets: float


def ramp(network: Network, kind: str, characteristic: str) -> Ramp:
    """NaN where the zone did not start, or not drop out."""
    zone = network.mho() if characteristic == "mho" else network.quad()
    zones = [zone, network.mho(2 * REACH, zone=2, delay_ms=1e6)]
    relay = Relay(RelaySettings.from_dict(network.settings(*zones, ptrc={"zones": [2]})))
    count = round((FROM - TO) / STEP)
    way = [FROM - STEP * k for k in range(count)] + [TO + STEP * k for k in range(count + 1)]
    places = np.repeat(REACH * np.array(way), round(STEP_S * SAMPLING_HZ))
    samples = _samples(network, kind, places)
    started = _pickup(relay, samples)[round(BEFORE_S * SAMPLING_HZ) :]
    there = np.flatnonzero(started)
    if not len(there):
        return Ramp(network.sir, kind, characteristic, math.nan, math.nan)
    gone = np.flatnonzero(~started[there[-1] :])
    resets = float(places[there[-1] + gone[0]]) if len(gone) else math.nan
    return Ramp(network.sir, kind, characteristic, float(places[there[0]]), resets)


def _pickup(relay: Relay, samples: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether the first zone is started, at each sample."""
    done, words = 0, []
    while done < len(samples):
        n = relay.advance(samples[done:])
        words.append(relay.pickup[:n].copy())
        done += n
    return (np.concatenate(words) & np.uint64(1)).astype(bool)


def _samples(network: Network, kind: str, places: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 6): without a fault, then faults at these places, each a steady state."""
    before = round(BEFORE_S * SAMPLING_HZ)
    e = BASE_KV * 1e3 / math.sqrt(3)
    x = np.concatenate([np.zeros(before), places])
    zs1 = network.sir * network.z1_ohm
    zs0 = Z0_OVER_Z1_OF_SOURCE * zs1
    z1, z0 = zs1 + x * network.z1_ohm, zs0 + x * network.z0_ohm
    if kind == "AG":
        i1 = e / (2 * z1 + z0)
        i2, i0 = i1, i1
    elif kind == "BC":
        i1 = e / (2 * z1)
        i2, i0 = -i1, 0 * i1
    else:
        i1 = e / z1
        i2, i0 = 0 * i1, 0 * i1
    now = np.arange(len(x)) >= before
    i1, i2, i0 = i1 * now, i2 * now, i0 * now
    phasors = []
    for first, second, zero in ((e - zs1 * i1, -zs1 * i2, -zs0 * i0), (i1, i2, i0)):
        phasors += [first + second + zero, A**2 * first + A * second + zero, A * first + A**2 * second + zero]
    t = np.arange(len(x)) / SAMPLING_HZ
    turn = np.sqrt(2) * np.exp(2j * np.pi * network.frequency_hz * t)
    return np.ascontiguousarray(np.stack([(p * turn).real for p in phasors], axis=1))
