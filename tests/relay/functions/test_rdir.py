"""RDIR by itself: every type, forward and behind, in the first two cycles and after them."""

from __future__ import annotations

import numpy as np
import pytest

from faultloop.relay.functions.rdir import RDIR
from faultloop.relay.quantities import FAULTS
from tests.relay.functions.kernel import Kernel
from tests.relay.functions.test_phs import LOOP, NETWORKS
from tests.relay.network import TYPES, Network

SIXTEENTH, CYCLE = 6, 96
OLDER = CYCLE + 1  # old enough to be judged by impedance, where the energy says nothing
FORWARD, REVERSE = 0b01, 0b10


def fault(network: Network, kind: str, at: float, age: int = OLDER, **table: float) -> Kernel:
    k = Kernel(RDIR, table)
    k.disturb(network.solve(), network.solve(kind, at), age)
    k.q["fault"] = FAULTS.index(LOOP.get(kind, kind))
    return k


@pytest.mark.parametrize("network", NETWORKS)
@pytest.mark.parametrize("kind", TYPES)
@pytest.mark.parametrize("age", [OLDER, 500])  # 500 samples: five cycles, the memory still polarizes
def test_every_type_has_its_direction(network: str, kind: str, age: int) -> None:
    for at, bit in ((0.02, FORWARD), (0.5, FORWARD), (0.98, FORWARD), (-0.02, REVERSE), (-1.0, REVERSE)):
        k = fault(NETWORKS[network], kind, at, age)
        k.step(count=SIXTEENTH)
        assert int(k.q["pickup"]) == bit, at
        assert int(k.q["direction"]) == (1 if bit == FORWARD else -1)


def test_it_waits_for_the_type_and_a_sixteenth_of_a_cycle() -> None:
    k = fault(NETWORKS["strong"], "AG", 0.5)
    k.step(count=SIXTEENTH - 1)
    assert k.q["direction"] == 0
    k = fault(NETWORKS["strong"], "AG", 0.5)
    k.q["fault"] = 0
    k.step(count=50)
    assert k.q["direction"] == 0


@pytest.mark.parametrize("said", [1, -1])
def test_the_energy_decides_from_the_first_sample(said: int) -> None:
    k = fault(NETWORKS["strong"], "AG", 0.5 * said, 1)
    k.step()
    assert k.q["direction"] == 0
    k.q["energy"]["direction"] = said
    k.step()
    assert k.q["direction"] == said


@pytest.mark.parametrize("given", [1, -1])
def test_the_side_on_which_the_energy_has_not_been_must_stand_still_for_a_cycle(given: int) -> None:
    """A current transformer that saturates gives back what it let through and leaves a current that leads."""
    k = fault(NETWORKS["strong"], "AG", -0.5 * given)
    k.q["energy"]["given"] = given  # and has lost its sign
    k.step(count=CYCLE - 1)
    assert k.q["direction"] == 0
    k.q["memory"]["drift"] = float("inf")
    k.step()
    k.q["memory"]["drift"] = 0.0
    k.step(count=CYCLE - 1)
    assert k.q["direction"] == 0
    k.step()
    assert k.q["direction"] == -given
    k = fault(NETWORKS["strong"], "AG", 0.5 * given)
    k.q["energy"]["given"] = given
    k.step(count=SIXTEENTH)
    assert k.q["direction"] == given


def test_it_is_given_up_after_a_cycle_of_something_else_that_stands_still() -> None:
    k = fault(NETWORKS["strong"], "AG", 0.5, 2 * CYCLE)
    k.q["energy"]["direction"] = -1
    k.step(count=2 * CYCLE)  # the first two cycles are the energy's
    assert k.q["direction"] == -1
    k.q["memory"]["age"] = 2 * CYCLE + 1
    k.q["memory"]["drift"] = float("inf")  # rings
    k.step(count=2 * CYCLE)
    assert k.q["direction"] == -1
    k.q["memory"]["drift"] = 0.0
    power, k.q["d"][:3] = k.q["d"][:3].copy(), -k.q["d"][:3]  # still goes the way it did: a resonance
    k.step(count=3 * CYCLE)
    assert k.q["direction"] == -1
    k.q["memory"]["drift"] = float("inf")
    k.step()
    k.q["memory"]["drift"], k.q["d"][:3] = 0.0, power
    k.q["energy"]["now"][0] = -1.0  # and what it has brought is on its way back
    k.step(count=CYCLE - 1)
    assert k.q["direction"] == -1
    k.step()
    assert k.q["direction"] == 1


def test_what_rings_gives_back_what_it_has_taken_and_no_more() -> None:
    """A network that resonates: power goes the other way for cycles, between bounds that it had before."""
    k = fault(NETWORKS["strong"], "AG", 0.5, 2 * CYCLE)
    k.q["energy"]["direction"] = -1
    k.q["memory"]["drift"] = float("inf")
    for t in range(3 * CYCLE):  # rises while it rings
        k.q["energy"]["now"][0] = 10.0 + 5.0 * np.sin(2 * np.pi * t / CYCLE)
        k.step()
    k.q["memory"]["age"] = 2 * CYCLE + 1
    k.q["memory"]["drift"] = 0.0
    for t in range(5 * CYCLE):
        k.q["energy"]["now"][0] = 10.0 + 4.9 * np.sin(2 * np.pi * t / CYCLE)
        k.step()
        assert k.q["direction"] == -1
    k.q["energy"]["now"][0] = 4.0
    k.step()
    assert k.q["direction"] == 1


def test_what_spoke_against_an_earlier_energy_says_nothing_in_the_next_disturbance() -> None:
    """A fault behind on a network that resonates was ahead after two cycles by the power of before it."""
    k = fault(NETWORKS["strong"], "AG", 0.5, 2 * CYCLE)
    k.q["energy"]["direction"] = -1
    k.q["d"][:3] *= -1  # its power is that of a fault behind
    k.w["power"], k.w["apparent"] = -1e18, 1e18
    k.step(count=2 * CYCLE)
    k.q["memory"]["age"] = 2 * CYCLE + 1
    k.step(count=3 * CYCLE)
    assert k.q["direction"] == -1


def test_the_polarizing_voltage_is_remembered_and_fades() -> None:
    """200 ms of the voltage before, then within 100 ms the present one."""
    before, now = NETWORKS["strong"].solve(), NETWORKS["strong"].solve("ABC", 0.0)
    v1 = (before[0] + before[1] * 1j ** (4 / 3) + before[2] * 1j ** (8 / 3)) / 3
    for age, share in ((1, 1.0), (960, 1.0), (1200, 0.5), (1440, 0.0)):
        k = fault(NETWORKS["strong"], "ABC", 0.0, age)
        k.step()
        rest = (now[0] + now[1] * 1j ** (4 / 3) + now[2] * 1j ** (8 / 3)) / 3
        assert complex(k.q["polarizing"]) == pytest.approx(
            share * v1 + (1 - share) * rest, abs=1e-6 * abs(v1)
        )


def test_an_open_line_and_rest_have_no_direction() -> None:
    k = fault(NETWORKS["strong"], "AG", 0.5)
    k.step(count=SIXTEENTH)
    k.q["dead"] = 7
    k.step()
    assert k.q["direction"] == 0
    k = fault(NETWORKS["strong"], "AG", 0.5)
    k.step(count=SIXTEENTH)
    k.q["disturbed"] = 0
    k.step()
    assert (k.q["direction"], k.q["pickup"]) == (0, 0)
