"""A swing while a pole is open: I2 and I0 are the open pole's, and no fault's."""

from __future__ import annotations

from types import ModuleType

import numpy as np
import pytest

from faultloop.relay import Relay
from tests.load import load
from tests.relay.network import play


@pytest.fixture(scope="module")
def bench() -> ModuleType:
    return load("bench/swing_network.py")


@pytest.mark.parametrize("case", [2, 4, 8, 13])
def test_no_zone_trips(bench: ModuleType, case: int) -> None:
    """Drawn swings on Bergeron lines, pole A of A - B open from 0.2 s on: zone 1 tripped in each of these."""
    data, _ = bench.scenario(np.random.default_rng([81105, case]), "pole", "ideal")
    x = bench.samples(data, True)
    before_s = (len(x) - round(data["scenario"]["duration_s"] * bench.FS)) / bench.FS
    relay, opens = Relay(bench.settings("ideal")), round((before_s + bench.OPENS_S + 0.02) * bench.FS)
    assert not [event for event in play(relay, x[:opens]) if event.trip]
    relay.inputs = relay.inputs._replace(breaker_closed=0b110)
    events = play(relay, x[opens:])
    assert not [event for event in events if event.trip]
    assert [event for event in events if "RPSB1" in event.text]
