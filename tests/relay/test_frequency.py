"""The reach off the nominal frequency: a line's reactance goes with it."""

from __future__ import annotations

import numpy as np
import pytest

from tests.relay.network import Network
from tests.relay.test_zones import relay, run, zones_seen

ZONES = [
    {"zone": 1, "reach_pu": 0.8},
    {"zone": 2, "reach_pu": 0.8, "characteristic": "quad", "resistive_reach_ohm": 20.0},
    {"zone": 3, "reach_pu": 0.8, "delay_ms": 30.0},
]
AT_NOMINAL = Network()


def at_frequency(f: float) -> Network:
    def scaled(z: complex) -> complex:
        return complex(z.real, z.imag * f / 50)

    names = ("z1", "z0", "zs1", "zs0", "zr1", "zr0")
    return Network(**{n: scaled(getattr(AT_NOMINAL, n)) for n in names}, frequency_hz=f)


@pytest.mark.parametrize("frequency", [46.5, 48.0, 50.0, 52.0, 53.5])
@pytest.mark.parametrize("kind", ["AG", "BC", "CAG", "ABC"])
def test_the_reach_goes_with_the_frequency(frequency: float, kind: str) -> None:
    network = at_frequency(frequency)
    for at, zones in ((0.77, {1, 2, 3}), (0.84, set())):
        r = relay(AT_NOMINAL, ZONES, "kalman-bank")
        assert zones_seen(r, run(r, network.fault(kind, at, start_s=0.2, duration_s=0.4))) == zones, at
        if zones:
            assert np.isclose(r.fault_location, at, atol=0.01)
