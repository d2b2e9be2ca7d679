"""A current that collapses is told from a sinusoid with an offset."""

from argparse import Namespace

import numpy as np
import pytest

from faultloop.relay.quantities import CONSTANTS
from faultloop.relay.recent import LENGTH, RECENT
from faultloop.relay.saturation import has_collapsed, is_saturated
from tests.load import load

VALUES = 96
TURN = 2 * np.pi / VALUES


def records(current):
    """Constants, and the last values, of which phase B carries ``current``."""
    g, r = np.zeros(1, CONSTANTS)[0], np.zeros(1, RECENT)[0]
    g["values"] = VALUES
    r["value"][: len(current), 4] = current
    r["head"] = len(current) - 1
    return g, r


def wave(angle, offset, count=LENGTH):
    n = TURN * np.arange(count)
    return np.cos(n + angle) - offset * np.cos(angle) * np.exp(-n / 15)


@pytest.mark.parametrize("offset", [0.0, 0.5, 1.0])
def test_a_sinusoid_with_an_offset_has_not_collapsed(offset):
    for angle in np.linspace(0, 2 * np.pi, 48, endpoint=False):
        for count in range(VALUES, LENGTH + 1, 5):
            g, r = records(wave(angle, offset, count))
            assert not has_collapsed(g, r, 1, VALUES)


def test_one_that_falls_to_nothing_and_stays_there_has():
    current = wave(np.pi, 1.0)
    at = LENGTH - VALUES // 4
    current[at:] = 0.0
    g, r = records(current)
    assert has_collapsed(g, r, 1, VALUES)
    assert [is_saturated(g, r, loop, VALUES) for loop in range(6)] == [0, 1, 0, 1, 1, 0]
    assert not has_collapsed(g, r, 1, VALUES // 8)  # too long ago for a window so short
    current[at + 4 :] = -1.0  # it does not rest
    assert not has_collapsed(*records(current), 1, VALUES // 3)


def test_eight_values_a_cycle_do_not_tell():
    g, r = records(np.cos(2 * np.pi / 8 * np.arange(16)))
    g["values"] = 8
    for count in range(8, 17):
        r["head"] = count - 1
        assert not has_collapsed(g, r, 1, 8)


@pytest.mark.parametrize(
    ("seed", "number", "end"), [(4, 3636, 1), (4, 516, 0), (4, 1904, 1), (4, 2070, 0), (6, 2629, 1)]
)
def test_a_zone_without_delay_does_not_start_behind_a_full_core(seed, number, end):
    """Cases of bench/ct_saturation.py: at the far bus, where what was left counted twice (3636) or the fit
    with the charging was asked for resistive faults too (the next three); behind, where a fault began anew as
    the current had collapsed (2629)."""
    bench = load("bench/ct_saturation.py")
    given = Namespace(seed=seed, antialias=1500.0, order=4, reach=0.8)
    row = bench.one(number, given)[end]
    assert row["depth"] == -1.0 or row["depth"] >= 0.98
    assert np.isnan(row["ms"][[bench.MHO, bench.QUAD]]).all(), bench.told_of(row)
