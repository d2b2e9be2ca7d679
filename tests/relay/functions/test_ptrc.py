"""PTRC by itself: which poles, for how long, and whose wish it was."""

from __future__ import annotations

import numpy as np
import pytest

from faultloop.relay.functions.ptrc import PTRC
from faultloop.relay.quantities import FAULTS, request_trip
from tests.relay.functions.kernel import TURN, Kernel

LOAD = np.concatenate([132e3 * TURN, 400.0 * TURN])
OPEN = np.concatenate([132e3 * TURN, np.zeros(3)])


def wish(k: Kernel, fault: str, bit: int = 3, three_pole: int = 0, closed: int = 7) -> None:
    """One sample at which a function wishes to trip."""
    k.q["closed"] = closed
    k.step(request=np.array((1, bit, FAULTS.index(fault), three_pole), k.q["request"].dtype))


@pytest.mark.parametrize("mode", ["three-pole", "single-pole"])
@pytest.mark.parametrize("fault", FAULTS)
def test_the_poles_of_every_type(mode: str, fault: str) -> None:
    k = Kernel(PTRC, {"mode": mode})
    wish(k, fault)
    one = mode == "single-pole" and fault in ("AG", "BG", "CG")
    assert int(k.q["poles"]) == (1 << "ABC".index(fault[0]) if one else 7)
    assert (k.q["operate"], k.q["notices"], k.w["bit"]) == (1, 1, 3)


def test_what_makes_a_single_pole_trip_one_of_three() -> None:
    k = Kernel(PTRC, {"mode": "single-pole"})
    wish(k, "AG", three_pole=1)
    assert k.q["poles"] == 7
    k = Kernel(PTRC, {"mode": "single-pole"})
    wish(k, "AG", closed=0b110)  # a pole is open already
    assert k.q["poles"] == 7
    k = Kernel(PTRC, {"mode": "single-pole"})
    wish(k, "AG")
    wish(k, "AG")
    assert (k.q["poles"], k.q["notices"]) == (1, 1)
    wish(k, "AB")  # it has grown
    assert (k.q["poles"], k.q["notices"], k.w["fault"]) == (7, 2, FAULTS.index("AB"))


def test_a_trip_lasts_its_minimum_and_until_the_current_is_gone() -> None:
    k = Kernel(PTRC, {"minimum_trip_ms": 80.0})
    k.q["x"] = OPEN
    wish(k, "AG")
    k.step(count=383)
    assert k.q["poles"] == 7
    k.step()
    assert (k.q["poles"], k.q["operate"]) == (0, 0)
    k = Kernel(PTRC, {"minimum_trip_ms": 0.0})
    k.q["x"] = LOAD
    wish(k, "AG")
    k.step(count=1000)
    assert k.q["poles"] == 7
    k.q["closed"] = 0b001  # two report that they are open, the third's current is gone
    k.step(np.where(np.arange(6) == 3, 0.0, LOAD))
    assert k.q["poles"] == 0


def test_any_start_is_its_start() -> None:
    k = Kernel(PTRC, {})
    k.step(started=1)
    assert (k.q["pickup"], k.q["operate"]) == (1, 0)


def test_the_first_wish_is_the_one_told_and_three_poles_win() -> None:
    k = Kernel(PTRC, {"mode": "single-pole"})
    request_trip(k.q, 0, 1, 0)
    request_trip(k.q, 9, 5, 1)
    said = k.q["request"]
    assert (said["made"], said["bit"], said["fault"], said["three_pole"]) == (1, 0, 1, 1)
