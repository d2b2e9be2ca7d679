"""The same bits whatever the blocks; save and restore."""

from __future__ import annotations

from functools import cache

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from faultloop.relay import Outputs, Relay, RelaySettings
from tests.relay.network import Network, settings_dict

NETWORK = Network(frequency_hz=49.7)
ZONES = [
    {"zone": 1, "reach_pu": 0.8},
    {"zone": 2, "reach_pu": 1.2, "delay_ms": 60.0, "characteristic": "quad", "resistive_reach_ohm": 30.0},
]
METHODS = ("fourier", "adaptive-kalman")


@cache
def samples() -> np.ndarray:
    """A fault that grows and is cleared: trips, resets and a location are in it."""
    open_line = np.concatenate([NETWORK.solve()[:3], np.zeros(3)])
    stages = [
        (0.0, NETWORK.solve()),
        (0.06, NETWORK.solve("CG", 0.5)),
        (0.09, NETWORK.solve("BCG", 0.5)),
        (0.14, open_line),
    ]
    noise = np.random.default_rng(7).normal(0, 1, (1200, 6)) * [50, 50, 50, 2, 2, 2]
    return NETWORK.samples(stages, 0.25) + noise


def new(method: str) -> Relay:
    data = settings_dict(NETWORK, ZONES, estimator={"method": method}, ptrc={"mode": "single-pole"})
    return Relay(RelaySettings.from_dict(data))


def feed(relay: Relay, x: np.ndarray, cuts: list[int]) -> tuple:
    """Everything the relay says, fed in blocks that end at ``cuts``."""
    rows, events, outputs, done = [], [], [], 0
    for end in [*sorted({c for c in cuts if 0 < c < len(x)}), len(x)]:
        while done < end:
            m = relay.advance(x[done:end])
            done += m
            rows.append(np.hstack([relay.phasors, relay.loops]).copy())
            rows[-1] = np.hstack([rows[-1], relay.pickup[:, None].view(np.float64)])
            rows[-1] = np.hstack([rows[-1], relay.operate[:, None].view(np.float64)])
            events += relay.events
            outputs.append((done, relay.outputs))
    before = [Outputs(), *(o for _, o in outputs[:-1])]
    changes = [now for now, was in zip(outputs, before, strict=True) if now[1] != was]
    return np.vstack(rows).tobytes(), events, changes, repr(relay.fault_location)


@cache
def whole(method: str) -> tuple:
    return feed(new(method), samples(), [])


def test_there_is_something_to_compare() -> None:
    for method in METHODS:
        _, events, changes, location = whole(method)
        assert [o.trip_poles for _, o in changes] == [4, 7, 0]
        assert any(e.text.startswith("RFLO1") for e in events)
        assert abs(float(location) - 0.5) < 0.02


@settings(max_examples=25, deadline=None, derandomize=True)
@given(st.sampled_from(METHODS), st.lists(st.integers(1, 1199), max_size=30))
def test_any_partition_gives_the_same_bits(method: str, cuts: list[int]) -> None:
    assert feed(new(method), samples(), cuts) == whole(method)


def test_single_samples_give_the_same_bits() -> None:
    assert feed(new("fourier"), samples(), list(range(1200))) == whole("fourier")


@settings(max_examples=15, deadline=None, derandomize=True)
@given(st.sampled_from(METHODS), st.integers(1, 1100), st.integers(1, 99))
def test_restore_gives_the_same_bits_again(method: str, at: int, further: int) -> None:
    relay, x = new(method), samples()
    feed(relay, x[:at], [])
    saved = relay.save()
    once = feed(relay, x[at : at + further], [])
    feed(relay, -x[:50], [])
    relay.restore(saved)
    assert feed(relay, x[at : at + further], []) == once


def test_it_stops_at_an_output_change() -> None:
    relay, x = new("fourier"), samples()
    done = relay.advance(x)
    assert relay.outputs.trip_poles == 4
    assert relay.events[-1].sample_count == done - 1
    assert relay.operate[-1] >> np.uint64(relay.bits.index("PTRC1")) == 1
    assert relay.operate[-2] >> np.uint64(relay.bits.index("PTRC1")) == 0


def test_the_frequency_is_derived_where_the_estimator_gives_none() -> None:
    relay = new("fourier")
    relay.advance(NETWORK.samples([(0.0, NETWORK.solve())], 0.1))
    assert abs(relay.phasors[-1, 12] - 49.7) < 0.02
    assert abs(relay.phasors[-1, 13]) < 5
