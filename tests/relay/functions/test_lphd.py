"""LPHD by itself: each cause, when it is told, and that it is told once."""

from __future__ import annotations

import numpy as np
import pytest

from faultloop.relay.functions.lphd import (
    CAUSES,
    FLOWING,
    FREQUENCY,
    LPHD,
    MISSING,
    MOVING,
    OPENED,
    READY,
    SETTLING,
    UNSOUND,
    VOLTAGE,
)
from tests.relay.functions.kernel import TURN, Kernel

HEALTHY = np.concatenate([132e3 * TURN, 400.0 * TURN])


def not_ready(cause: int) -> Kernel:
    """Quantities that have this one cause."""
    k = Kernel(LPHD, {})
    k.q["x"], k.q["ready"], k.q["frequency"], k.q["sound"] = HEALTHY, 0, 50.0, 1
    k.q["memory"]["seen"] = k.g["settling"] + 1
    if cause == SETTLING:
        k.q["memory"]["seen"] = 0
    elif cause == OPENED:
        k.q["memory"]["blind"] = 1
    elif cause == VOLTAGE:
        k.q["x"] = 0.0
    elif cause == FLOWING:
        k.q["x"] = np.concatenate([np.zeros(3), HEALTHY[3:]])
    elif cause == FREQUENCY:
        k.q["frequency"] = np.nan
    elif cause == UNSOUND:
        k.q["sound"] = 0
    return k


@pytest.mark.parametrize("cause", [OPENED, VOLTAGE, FREQUENCY, UNSOUND, MOVING, FLOWING])
def test_a_cause_is_told_after_the_start_once(cause: int) -> None:
    k = not_ready(cause)
    k.step(count=479)  # of 480 in 100 ms
    assert (k.q["pickup"] | k.q["operate"], k.w["cause"], k.q["notices"]) == (1, READY, 0)
    k.step()
    assert (k.w["cause"], k.q["notices"]) == (cause, 1)
    k.step(count=500)
    assert k.q["notices"] == 1
    assert CAUSES[cause]


def test_current_that_comes_to_a_dead_line_and_no_voltage_with_it_is_told_as_well() -> None:
    """Energised onto a three-phase fault at the relay's place, with a transformer that nobody has proven."""
    k = not_ready(VOLTAGE)
    k.step(count=600)
    k.q["x"] = np.concatenate([np.zeros(3), HEALTHY[3:]])
    k.step(count=30)
    assert (k.w["cause"], k.q["notices"]) == (FLOWING, 2)


def test_settling_is_what_every_start_has_and_not_told() -> None:
    k = not_ready(SETTLING)
    k.step(count=2000)
    assert (k.q["pickup"] | k.q["operate"], k.w["cause"], k.q["notices"]) == (1, READY, 0)


def test_readiness_is_told_at_once_and_a_loss_after_a_quarter_cycle() -> None:
    k = not_ready(VOLTAGE)
    k.step(count=600)
    k.q["ready"], k.q["x"] = 1, HEALTHY
    k.step()
    assert (k.w["cause"], k.q["notices"], k.q["operate"] | k.q["pickup"]) == (READY, 2, 0)
    k.q["ready"], k.q["memory"]["blind"] = 0, 1
    k.step(count=23)  # a quarter of 96 samples is 24
    assert k.w["cause"] == READY
    k.step()
    assert (k.w["cause"], k.q["notices"]) == (OPENED, 3)


@pytest.mark.parametrize("proven", [0b110, 0b101, 0b011, 0b000])
def test_a_phase_that_never_had_a_voltage_is_named(proven: int) -> None:
    k = Kernel(LPHD, {})
    k.q["x"], k.q["proven"] = HEALTHY, proven
    k.step()
    assert (k.w["cause"], k.w["missing"], k.q["notices"]) == (MISSING, 7 & ~proven, 1)


def test_a_fault_that_is_there_is_told_though_another_cause_was() -> None:
    k = not_ready(OPENED)
    k.step(count=600)
    assert k.w["cause"] == OPENED
    k.q["memory"]["blind"], k.q["sound"] = 0, 0
    k.step()
    assert (k.w["cause"], k.q["notices"]) == (UNSOUND, 2)
