"""The differential rules, swept over the plane against their definitions written otherwise."""

from __future__ import annotations

import cmath
import math
from typing import Any

import numpy as np
import pytest

from faultloop.relay.differential import RULE, operates, ratio_of, restraint


def rule(**keys: Any) -> Any:
    own = np.zeros(1, RULE)
    defaults = {"alpha": 1, "pickup": 200.0, "ratio": 6.0, "slope1": 0.3, "slope2": 1.5, "knee": 2000.0}
    for key, value in (defaults | keys).items():
        own[key] = value
    own["half_angle_cos"] = math.cos(math.radians(195.0 / 2))
    return own[0]


def decided(c: Any, *currents: complex, secure: bool = False) -> bool:
    return bool(operates(c, np.array(currents, np.complex128), len(currents), secure))


def test_the_alpha_plane_swept() -> None:
    """k over magnitude and angle: restrained within 1/6 to 6 and 97.5 degrees of 180; by polar angles."""
    c = rule(pickup=1e-9)
    for size in np.geomspace(0.05, 20, 41):
        for degrees in np.arange(-180.0, 180.0, 2.5):
            k = size * cmath.exp(1j * math.radians(degrees))
            away = abs(180 - abs(degrees))
            inside = 1 / 6 < size < 6 and away < 97.5
            if abs(away - 97.5) > 1e-6 and abs(size - 6) > 1e-6 and abs(size - 1 / 6) > 1e-6:
                assert decided(c, 1000 + 0j, 1000 * k) == (not inside), (size, degrees)


@pytest.mark.parametrize("secure", [False, True])
def test_the_percentage_swept(secure: bool) -> None:
    """P54x: the threshold of |sum| at each bias, by bisection, against the two lines written as numbers;
    where a fault outside is known the ratio must be outside 1 : 7.2, too."""
    c = rule(alpha=0)
    first, pickup = (0.7, 240.0) if secure else (0.3, 200.0)
    for bias in (100.0, 500.0, 1000.0, 1999.0, 2001.0, 5000.0, 20000.0):
        low, high = 0.0, 2 * bias
        for _ in range(60):
            middle = (low + high) / 2
            # two currents of half-sum `bias` and sum `middle`, in one line
            a, b = bias + middle / 2, bias - middle / 2
            low, high = (low, middle) if decided(c, a + 0j, -b + 0j, secure=secure) else (middle, high)
        line = first * bias + 200 if bias <= 2000 else 1.5 * bias - (1.5 - first) * 2000 + 200
        # a and a / 7.2 against each other: their sum is 2 * 6.2 / 8.2 of the half-sum of their sizes
        expected = max(line, pickup, 2 * 6.2 / 8.2 * bias) if secure else line
        if expected < 2 * bias:
            assert low == pytest.approx(expected, rel=1e-9)


def test_single_end_feed_trips_at_its_closed_form() -> None:
    """One end alone: Idiff = I, bias = I / 2; P54x trips at Is1 / (1 - k1 / 2) = 1.176 Is1, alpha at Is1."""
    assert not decided(rule(alpha=0), 235.2 + 0j, 0j)
    assert decided(rule(alpha=0), 235.4 + 0j, 0j)
    assert not decided(rule(), 199.9 + 0j, 0j)
    assert decided(rule(), 200.1 + 0j, 0j) and decided(rule(), 0j, 200.1 + 0j)


@pytest.mark.parametrize(("amperes", "ms"), [(500, 4.55), (1000, 3.22), (1500, 2.78), (2000, 2.56)])
def test_asymmetry_that_the_percentage_bears(amperes: float, ms: float) -> None:
    """Through current, one end turned by 360 f (asymmetry / 2): |sum| = 2 I sin(angle / 2)."""

    def trips(asymmetry_ms: float, c: Any) -> bool:
        turn = cmath.exp(1j * 2 * math.pi * 50 * asymmetry_ms / 2 * 1e-3)
        return decided(c, amperes + 0j, -amperes * turn)

    assert not trips(ms - 0.02, rule(alpha=0)) and trips(ms + 0.02, rule(alpha=0))
    assert not any(trips(a, rule()) for a in np.arange(0, 10.8, 0.1))  # 97.5 degrees are 10.83 ms
    assert trips(10.9, rule())


def test_equivalent_currents_of_three_ends() -> None:
    """The two equivalent ones have the sum and the restraint of the three, whatever these are."""
    draw = np.random.default_rng(3)
    for _ in range(300):
        i = draw.normal(size=3) + 1j * draw.normal(size=3)
        k = ratio_of(i, 3)
        total = i.sum()
        first = total / (1 + k) if abs(1 + k) > 1e-9 else None
        if first is None:
            continue
        assert abs(first) * (1 + abs(k)) == pytest.approx(restraint(i, 3), rel=1e-6)
    assert ratio_of(np.array([3 + 0j, -1 + 0j, -2 + 0j]), 3) == pytest.approx(-1)  # all of it flows through


@pytest.mark.parametrize("alpha", [0, 1])
def test_three_ends_with_outfeed_and_without_a_fault(alpha: int) -> None:
    c = rule(alpha=alpha)
    assert decided(c, 5000 + 0j, 4000 + 100j, -600 + 0j)  # a fault inside, one end takes load out
    assert not decided(c, 5000 + 0j, -4000 + 0j, -1000 + 20j)


def test_secure_is_harder_and_not_blind() -> None:
    c = rule()
    assert decided(c, 1000 + 0j, -155 + 0j) and not decided(c, 1000 + 0j, -155 + 0j, secure=True)
    assert decided(c, 1000 + 0j, 800 + 0j, secure=True)


def test_what_a_saturated_transformer_leaves_is_no_fault_while_one_outside_is_known() -> None:
    """A fifth of the current, 88 degrees late: |sum| is 1.7 of half the sum of sizes, beyond any slope."""
    c = rule(alpha=0)
    currents = 10_000 + 0j, -2_000 * cmath.exp(1j * math.radians(88.0))
    assert decided(c, *currents) and not decided(c, *currents, secure=True)
    assert decided(c, 10_000 + 0j, 2_000 + 0j, secure=True)
