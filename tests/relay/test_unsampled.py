"""Channels whose samples do not come, NaN: the phase counts as one without voltage or current."""

from __future__ import annotations

import numpy as np
import pytest

from tests.relay.network import Network
from tests.relay.test_missing_phase import LOAD_S, STAGES, lost, relay, samples
from tests.relay.test_not_ready import run


def unsampled(x: np.ndarray, phases: str, first: int, from_s: float) -> np.ndarray:
    """NaN where `lost` has zeros."""
    return np.where(lost(np.ones_like(x), phases, first, from_s) == 0.0, np.nan, x)


@pytest.mark.parametrize("first", [0, 3])
@pytest.mark.parametrize("phases", ["A", "C", "AB", "AC", "ABC"])
def test_a_fault_outside(phases: str, first: int) -> None:
    """The estimator would go on at the load from before: zone 1 tripped for C-A-G at either side."""
    network, tables = Network(angle_deg=15.0), {"ptoc": STAGES} if first else {}
    for kind in ("CAG", "BG"):
        for at in (-1.0, 1.0):
            x = unsampled(samples(network, kind, at), phases, first, LOAD_S)
            trips, texts = run(relay(network, **tables), x)
            assert not trips, (kind, at, trips)
            what = ("voltage", "current")[first // 3]
            assert [text for text in texts if f"{what} of phase {phases} " in text], texts


@pytest.mark.parametrize("first", [0, 3])
def test_values_that_come_again(first: int) -> None:
    whole = samples(Network(angle_deg=15.0))
    x = np.concatenate([unsampled(whole, "B", first, 0.0)[2400:3000], whole[3000:]])
    x = np.concatenate([whole[:2400], x])
    _, texts = run(relay(Network()), x)
    told = [text for text in texts if text.startswith("LPHD1")]
    assert "of phase B" in told[-2]
    assert told[-1] == "LPHD1 ready"


@pytest.mark.parametrize("first", [0, 3])
def test_a_few_lost_samples_in_a_fault_block_nothing(first: int) -> None:
    """Five in a row, a millisecond, of all phases."""
    network = Network(angle_deg=15.0)
    x = samples(network, "CA", 0.3)
    whole, _ = run(relay(network), x)
    start = round(4800 * 0.613)
    x[start : start + 5, first : first + 3] = np.nan
    trips, _ = run(relay(network), x)
    assert trips[0][1].loop == "CA"
    assert trips[0][0] - whole[0][0] < 48


@pytest.mark.parametrize("first", [0, 3])
@pytest.mark.parametrize(("lost", "trips_at"), [(15, "inside"), (60, "inside"), (150, "nowhere")])
def test_a_gap_in_a_load_change_and_then_a_fault(first: int, lost: int, trips_at: str) -> None:
    """A voltage is proven in quiet, and the disturbance goes on from the load change to the fault: before, no
    zone started for a gap of more than an eighth of a cycle of the voltages.  After one of more than a cycle
    nothing of before holds."""
    network = Network(angle_deg=-8.0)
    load, moved = network.solve(), Network(angle_deg=-20.0)
    start, begins = round(4800 * 0.35), round(4800 * 0.30)
    for kind, at in (("AG", 0.6), ("BC", 0.3), ("AG", -1.0), ("BCG", 1.0)):
        stages = [(0.0, load), (0.30, moved.solve()), (0.35, moved.solve(kind, at))]
        x = network.samples(stages, 0.6)
        x[begins + 24 : begins + 24 + lost, first : first + 3] = np.nan
        trips, _ = run(relay(network), x)
        if 0.0 < at < 0.8 and (trips_at == "inside" or first):
            assert [trip.zone for _, trip in trips[:1]] == [1], (kind, at)
            assert trips[0][0] - start < 4800 * 0.04
        elif not 0.0 < at < 0.8:
            assert not trips, (kind, at)
