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
            assert [text for text in texts if f"no {what} of phase {phases} " in text], texts


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
