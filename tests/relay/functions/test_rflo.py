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


@pytest.mark.parametrize("method", ["takagi", "reactance"])
@pytest.mark.parametrize(("at", "beside"), [(0.5, 1 / 3), (0.8, 2 / 3), (0.8, -0.2), (0.5, 0.0)])
def test_the_parallel_lines_residual_current_is_taken_out(at: float, beside: float, method: str) -> None:
    """V = x (Z1 (Ia + 3 k0 I0) + Z0m Ip0) of a bolted A-G; without Ip0 it looks farther."""
    z1, z0, z0m = 3 + 30j, 25 + 100j, 20 + 60j
    current = np.array([1000.0 * np.exp(-1.4j), 0.0, 0.0])
    i0 = current.sum() / 3
    before = np.concatenate([np.exp(-2j * np.pi / 3 * np.arange(3)) * 130e3, np.zeros(3)])
    now = before.copy()
    now[0] = at * (z1 * current[0] + (z0 - z1) * i0 + z0m * beside * i0)
    now[3:] = current
    line = {"z1_ohm": [3.0, 30.0], "z0_ohm": [25.0, 100.0], "z0m_ohm": [20.0, 60.0]}
    found = []
    for compensated in (True, False):
        k = Kernel(RFLO, {"method": method}, line=line)
        k.disturb(before, now)
        mutual = k.g["mutual"] * 3 * beside * i0 if compensated else 0.0
        k.step(count=60, zone_started=1, fault=1, direction=1, mutual=mutual)
        found.append(float(k.w["value"]))
    assert found[0] == pytest.approx(at, abs=1e-6)
    assert (found[1] > at + 0.02) == (beside > 0)
