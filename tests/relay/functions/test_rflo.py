"""RFLO by itself: the distance of a fault of a network solved in phase coordinates."""

from __future__ import annotations

import numpy as np
import pytest

from faultloop.relay.functions.rflo import RFLO
from faultloop.relay.quantities import FAULTS
from tests.relay.functions.kernel import Kernel
from tests.relay.functions.test_phs import LOOP, NETWORKS
from tests.relay.network import TYPES


def located(kind: str, at: float, resistance: float = 0.0, network: str = "strong", **table: str) -> Kernel:
    k = Kernel(RFLO, table)
    before = NETWORKS[network].solve()
    k.disturb(before, NETWORKS[network].solve(kind, at, resistance=resistance))
    k.step(count=60, zone_started=1, fault=FAULTS.index(LOOP.get(kind, kind)), direction=1)
    return k


@pytest.mark.parametrize("method", ["takagi", "reactance"])
@pytest.mark.parametrize("kind", TYPES)
def test_a_bolted_fault_is_found(kind: str, method: str) -> None:
    for network in NETWORKS:
        for at in (0.05, 0.5, 0.95):
            k = located(kind, at, network=network, method=method)
            assert float(k.w["value"]) == pytest.approx(at, abs=2e-3)


def test_takagi_stands_a_resistance_that_the_reactance_method_does_not() -> None:
    errors = [
        abs(float(located("AG", 0.5, 20.0, method=m).w["value"]) - 0.5) for m in ("takagi", "reactance")
    ]
    assert errors[0] < 0.03 < errors[1]


def test_it_is_told_once_when_the_zones_have_reset_even_if_a_pole_stays_closed() -> None:
    k = located("AG", 0.5)
    k.step(poles=7)
    assert (k.q["notices"], k.w["told"]) == (1, 1)
    k.step(count=10, poles=0)
    assert k.q["notices"] == 1


def test_it_is_frozen_when_the_current_of_a_faulted_pole_is_gone() -> None:
    k = located("BC", 0.5)
    k.disturb(NETWORKS["strong"].solve(), NETWORKS["strong"].solve("BC", 0.9))
    k.step(count=200, zone_started=1, fault=FAULTS.index("BC"), direction=1, dead=0b010)
    assert float(k.w["value"]) == pytest.approx(0.5, abs=2e-3)


def test_behind_nothing_is_located() -> None:
    k = Kernel(RFLO, {})
    k.disturb(NETWORKS["strong"].solve(), NETWORKS["strong"].solve("AG", -0.5))
    k.step(count=100, zone_started=1, fault=1, direction=-1)
    assert np.isnan(k.w["value"])
