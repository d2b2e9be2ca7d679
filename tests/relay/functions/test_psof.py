"""PSOF by itself: a dead line that carries current at a short impedance, and what is none."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from faultloop.relay.functions.psof import PSOF
from faultloop.relay.recent import LENGTH
from tests.relay.functions.kernel import TURN, Kernel

DEAD = np.zeros(6, np.complex128)
Z1 = 3 + 30j
DELAY = 120  # samples of 25 ms


def energised(
    k: Kernel, z: complex, current_a: float = 2000.0, *, voltages: bool = True, harmonic: float = 0.0
) -> None:
    """Phasors, loops and samples of a balanced impedance; second ``harmonic`` as a part of the current."""
    i = current_a * TURN
    k.q["x"] = np.concatenate([z * i if voltages else np.zeros(3), i])
    loops = np.full(12, np.nan)
    loops[0::2], loops[1::2] = (z.real, z.imag) if voltages else (0.0, 0.0)
    k.q["loops"] = loops
    turn = np.exp(2j * np.pi * np.arange(1 - LENGTH, 1) / 96)[:, None]
    samples = np.real(
        turn * k.q["x"] + harmonic * turn**2 * np.concatenate([np.zeros(3), current_a * TURN.conj()])
    )
    k.q["recent"]["value"][:, :6], k.q["recent"]["head"] = np.sqrt(2) * samples, LENGTH - 1


def dead_line(samples: int = 960, **table: Any) -> Kernel:
    """A line that was dead for so long, with the voltages proven before."""
    k = Kernel(PSOF, table)
    k.q["ready"] = 0
    k.q["loops"] = np.nan
    k.step(DEAD, samples)
    return k


def operated_after(k: Kernel, most: int = 3000) -> int | None:
    """Samples until it operates."""
    for n in range(most):
        k.step()
        if k.q["operate"]:
            return n
    return None


def test_what_has_operated_does_not_come_again_with_phasors_that_decay() -> None:
    """The poles open, and the phasors are not yet nothing (before: again after the delay)."""
    k = dead_line()
    energised(k, 0.5 * Z1)
    assert operated_after(k) == DELAY
    k.q["dead"] = 7
    words = []
    for _ in range(3 * DELAY):
        k.step()
        words.append(int(k.q["operate"]) | int(k.q["pickup"]))
    assert not any(words)


def test_phasors_that_decay_without_a_current_are_no_fault() -> None:
    """Another function has tripped before the delay is over."""
    k = dead_line()
    energised(k, 0.5 * Z1)
    k.step(None, DELAY // 2)
    assert k.q["pickup"]
    k.q["recent"]["value"][:, 3:6] = 0.0
    assert operated_after(k) is None
    assert not k.q["pickup"]


@pytest.mark.parametrize("z", [0.02 * Z1, 0.5 * Z1, 1.1 * Z1, -0.3 * Z1, 12.0 + 0j])
def test_a_short_impedance_trips_three_poles_after_the_delay(z: complex) -> None:
    k = dead_line()
    energised(k, z)
    assert operated_after(k) == DELAY
    request = k.q["request"]
    assert (request["made"], request["fault"], request["three_pole"]) == (1, 7, 1)


@pytest.mark.parametrize(
    ("samples", "z", "harmonic"),
    [
        (960, 1.3 * Z1, 0.0),  # beyond the reach of 1.2
        (960, 30.0 + 0j, 0.0),  # a load: inside the reach, but not at the line's angle
        (900, 0.5 * Z1, 0.0),  # dead for less than 200 ms
        (960, 0.5 * Z1, 0.3),  # inrush
    ],
)
def test_what_is_no_fault(samples: int, z: complex, harmonic: float) -> None:
    k = dead_line(samples)
    energised(k, z, harmonic=harmonic)
    assert operated_after(k) is None


def test_it_is_armed_for_its_time_only() -> None:
    """500 ms from the first current on: a fault after that is the zones' affair."""
    for late, trips in ((2280, True), (2400, False)):
        k = dead_line()
        energised(k, 5 * Z1)
        k.step(count=late - DELAY)
        energised(k, 0.5 * Z1)
        assert (operated_after(k) is not None) is trips


def test_a_memory_that_is_ready_ends_it() -> None:
    k = dead_line()
    energised(k, 0.5 * Z1)
    k.step(count=60)
    k.q["ready"] = 1
    assert operated_after(k) is None


def test_a_memory_that_is_ready_without_one_phase_does_not_end_it() -> None:
    """Beside a fault close in the other two make it ready; the loops of the third measure nothing."""
    k = dead_line()
    energised(k, 0.5 * Z1)
    k.step(count=10)
    k.q["ready"], k.q["proven"] = 1, 0b110
    assert operated_after(k) == DELAY - 10


@pytest.mark.parametrize("current_a", [None, 1500.0])
def test_without_a_voltage_ever_only_the_current_trips(current_a: float | None) -> None:
    table = {} if current_a is None else {"current_a": current_a}
    k = Kernel(PSOF, table)
    k.q["ready"], k.q["proven"] = 0, 0
    k.q["loops"] = np.nan
    k.step(DEAD, 960)
    energised(k, 0j, voltages=False)
    assert operated_after(k) == (None if current_a is None else DELAY)


def test_it_stays_until_the_current_has_gone() -> None:
    k = dead_line()
    energised(k, 0.5 * Z1)
    assert operated_after(k) == DELAY
    k.q["loops"] = np.nan
    k.step(count=500)
    assert k.q["operate"] == 1
    k.step(DEAD)
    assert k.q["operate"] == 0


def test_without_trip_it_only_operates() -> None:
    k = dead_line(trip=False)
    energised(k, 0.5 * Z1)
    assert operated_after(k) == DELAY
    assert k.q["request"]["made"] == 0
