"""RSYN: in step or not, dead sides, slip; against voltages whose magnitude, angle and frequency are known."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from faultloop.errors import InputError
from faultloop.relay import RelaySettings
from faultloop.relay.functions.rsyn import RSYN
from tests.relay.functions.kernel import GIVEN, Kernel

FS = 4800
NOMINAL = 220e3 / np.sqrt(3)
TABLE = {"nominal_v": NOMINAL, "difference_pu": 0.15, "angle_deg": 20.0, "slip_hz": 0.2, "close_ms": 0.0}


def wave(pu: float, hz: float, degrees: float, seconds: float) -> np.ndarray:
    t = np.arange(round(seconds * FS)) / FS
    phase = np.radians(degrees) - 2 * np.pi / 3 * np.arange(3)
    return np.sqrt(2) * pu * NOMINAL * np.cos(2 * np.pi * hz * t[:, None] + phase)


def run(
    own: tuple[float, float, float], other: tuple[float, float, float], seconds: float = 0.6, **table: Any
) -> tuple[Kernel, np.ndarray]:
    """Magnitude, frequency, angle of bus and line; the bits at every sample, (n, 4)."""
    k = Kernel(RSYN, TABLE | table)
    bits = []
    for n, (a, b) in enumerate(zip(wave(*own, seconds), wave(*other, seconds), strict=True)):
        k.q["sample"][:3], k.q["across"] = a, b
        k.q["memory"]["seen"] = n
        k.step()
        bits.append([int(k.q["pickup"]) >> bit & 1 for bit in range(4)])
    return k, np.array(bits)


@pytest.mark.parametrize(("pu", "degrees"), [(1.0, 0.0), (0.9, 19.0), (1.1, -19.0)])
def test_what_is_in_step_is_released_after_the_hold_time(pu: float, degrees: float) -> None:
    bits = run((1.0, 50.0, degrees), (pu, 50.0, 0.0))[1]
    first = int(np.argmax(bits[:, 0])) / FS
    assert bits[-1].tolist() == [1, 0, 0, 0]
    assert 0.1 < first < 0.45, "the filter's beginning, and 100 ms"


@pytest.mark.parametrize(
    ("own", "other", "bit"),
    [
        ((1.0, 50.0, 0.0), (0.84, 50.0, 0.0), 1),
        ((1.0, 50.0, 21.0), (1.0, 50.0, 0.0), 2),
        ((1.0, 50.0, -21.0), (1.0, 50.0, 0.0), 2),
        ((1.0, 50.0, 0.0), (1.0, 50.25, 0.0), 3),
        ((1.0, 49.5, 0.0), (1.0, 49.8, 0.0), 3),
    ],
)
def test_what_differs_is_not_released_and_said(own: Any, other: Any, bit: int) -> None:
    bits = run(own, other)[1]
    assert not bits[:, 0].any()
    assert bits[len(bits) // 2 :, bit].all()


@pytest.mark.parametrize("slip", [0.1, -0.1])
def test_the_slip_is_measured_and_the_angle_is_that_at_the_contacts_making(slip: float) -> None:
    k, bits = run((1.0, 50.0 + slip, 0.0), (1.0, 50.0, 0.0), 0.5, close_ms=500.0, angle_deg=30.0)
    assert float(k.w["slip"]) == pytest.approx(slip, abs=0.002)
    released = np.flatnonzero(bits[:, 0])
    first = released[0] / FS
    assert abs(360 * slip * (first + 0.5)) < 30.0
    late = run((1.0, 50.0 + slip, 160 * slip), (1.0, 50.0, 0.0), 0.5, close_ms=500.0, angle_deg=30.0)[1]
    assert late[-1, 2] == 1, "30 degrees are passed before the contacts make"


@pytest.mark.parametrize(
    ("energise", "bus", "line", "released"),
    [
        ("none", 1.0, 0.0, 0), ("line", 1.0, 0.0, 1), ("line", 0.0, 1.0, 0), ("bus", 0.0, 1.0, 1),
        ("bus", 1.0, 0.0, 0), ("either", 0.0, 1.0, 1), ("either", 0.0, 0.0, 0), ("both", 0.0, 0.0, 1),
        ("both", 1.0, 0.5, 0),
    ],
)  # fmt: skip
@pytest.mark.parametrize("voltage_at", ["bus", "line"])
def test_dead_sides(energise: str, bus: float, line: float, released: int, voltage_at: str) -> None:
    sides = [(bus, 50.0, 0.0), (line, 50.0, 0.0)][:: 1 if voltage_at == "bus" else -1]
    bits = run(sides[0], sides[1], energise=energise, voltage_at=voltage_at)[1]
    assert bits[-1, 0] == released


def test_one_live_phase_is_no_dead_line() -> None:
    k = Kernel(RSYN, TABLE | {"energise": "line"})
    for n, a in enumerate(wave(1.0, 50.0, 0.0, 0.6)):
        k.q["sample"][:3], k.q["across"] = a, a * [0.0, 1.0, 1.0]
        k.q["memory"]["seen"] = n
        k.step()
    assert k.q["release"] == 0


def test_without_a_second_voltage_it_says_so() -> None:
    k = Kernel(RSYN, TABLE)
    k.step(count=1000)
    assert k.q["release"] == -1


@pytest.mark.parametrize(
    ("table", "key", "what"),
    [
        ({}, "rsyn.nominal_v", "missing; give it, or relay.nominal_kv"),
        ({"nominal_v": 1e5, "dead_pu": 0.9}, "rsyn.dead_pu", "must be below live_pu, 0.8"),
    ],
)
def test_what_is_wrong_is_named(table: dict[str, float], key: str, what: str) -> None:
    with pytest.raises(InputError) as error:
        RelaySettings.from_dict(GIVEN | {"rsyn": table})
    assert (error.value.key, error.value.what) == (key, what)
