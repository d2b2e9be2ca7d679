"""A current or a voltage missing at run time: what needs it is blocked, it is told, and nothing trips."""

from __future__ import annotations

import numpy as np
import pytest

from faultloop.relay import Relay, RelayInputs, RelaySettings
from tests.relay.network import Network, settings_dict
from tests.relay.test_not_ready import run

PHASES = ("A", "B", "C", "AB", "BC", "AC", "ABC")
ZONES = [
    {"zone": 1, "reach_pu": 0.8},
    {"zone": 1, "reach_pu": 0.8, "characteristic": "quad", "resistive_reach_ohm": 20.0},
    {"zone": 2, "reach_pu": 1.2, "delay_ms": 300.0},
    {"zone": 3, "reach_pu": 0.5, "direction": "reverse", "delay_ms": 600.0},
]
STAGES = [
    {"quantity": "residual", "pickup_a": 100.0, "delay_ms": 40.0},
    {"quantity": "negative-sequence", "pickup_a": 100.0, "delay_ms": 40.0},
]
LOAD_S, FAULT_S, END_S = 0.3, 0.61, 0.85
"""When a channel is lost, in load, and when a fault begins."""


def relay(network: Network, **tables: object) -> Relay:
    header = {"frequency_hz": 50, "sampling_hz": 4800, "nominal_kv": network.kv}
    data = settings_dict(network, ZONES, estimator={"method": "kalman-bank"}, relay=header, **tables)  # type: ignore[arg-type]
    return Relay(RelaySettings.from_dict(data))


def lost(x: np.ndarray, phases: str, first: int, from_s: float) -> np.ndarray:
    """Without the channels of some phases; ``first`` is 0 for voltages and 3 for currents."""
    x = x.copy()
    x[round(4800 * from_s) :, [first + "ABC".index(p) for p in phases]] = 0.0
    return x


def samples(network: Network, kind: str = "", at: float = 0.0) -> np.ndarray:
    """Load, and from `FAULT_S` on a fault."""
    stages = [(0.0, network.solve()), *([(FAULT_S, network.solve(kind, at))] if kind else [])]
    return network.samples(stages, END_S)


@pytest.mark.parametrize("from_s", [0.0, LOAD_S])
@pytest.mark.parametrize("angle", [-15.0, 15.0])
def test_load_with_a_current_missing(from_s: float, angle: float) -> None:
    """Residual and negative-sequence current are then as large as the load, and mean nothing."""
    network = Network(angle_deg=angle)
    for phases in PHASES:
        trips, texts = run(relay(network, ptoc=STAGES), lost(samples(network), phases, 3, from_s))
        assert not trips, (phases, trips)
        told = [text for text in texts if f"no current of phase {phases} " in text]
        assert len(told) == (phases != "ABC"), (phases, texts)
        vanished = [text for text in texts if "the currents of all phases went at one moment" in text]
        assert len(vanished) == (phases == "ABC" and from_s > 0), (phases, texts)


@pytest.mark.parametrize("method", ["kalman-bank", "fourier", "least-squares", "cosine"])
@pytest.mark.parametrize("sampling_hz", [1000, 2400, 4800, pytest.param(14400, marks=pytest.mark.slow)])
def test_all_currents_that_vanish_at_one_moment_are_told_and_a_load_that_goes_is_not(
    method: str, sampling_hz: int
) -> None:
    """A breaker's poles part one after the other, each at its current's zero."""
    network = Network(sampling_hz=sampling_hz)
    load = network.samples([(0.0, network.solve())], 0.6)
    t = np.arange(len(load)) / sampling_hz
    for moment_s in 0.3 + np.linspace(0.0, 0.02, 7):
        for gone in (False, True):
            x = load.copy()
            for phase, current in enumerate(network.solve()[3:]):
                zero_s = (np.pi / 2 - np.angle(current)) / (100 * np.pi)
                after = moment_s if not gone else zero_s + 0.01 * np.ceil((moment_s - zero_s) / 0.01)
                x[t >= after, 3 + phase] = 0.0
            header = {"frequency_hz": 50, "sampling_hz": sampling_hz, "nominal_kv": network.kv}
            data = settings_dict(network, ZONES, estimator={"method": method}, relay=header)
            trips, texts = run(Relay(RelaySettings.from_dict(data)), x)
            assert not trips
            told = [text for text in texts if "went at one moment" in text]
            assert len(told) == (not gone), (moment_s, gone, texts)


@pytest.mark.parametrize("kind", ["AG", "BC", "ABC"])
def test_after_what_took_all_currents_away_a_fault_trips_as_soon(kind: str) -> None:
    """It was a converter that blocked, and the line is fed again with the fault."""
    network = Network()
    x = samples(network, kind, 0.3)
    x[round(4800 * LOAD_S) : round(4800 * FAULT_S), 3:] = 0.0
    trips, texts = run(relay(network), x)
    assert any("went at one moment" in text for text in texts)
    assert 1000 * (trips[0][0] / 4800 - FAULT_S) < 30


def test_a_current_that_comes_back_is_told() -> None:
    network = Network()
    whole = samples(network)
    x = np.concatenate([lost(whole, "B", 3, 0.0)[:2400], whole[2400:]])  # 0.5 s: a whole number of cycles
    _, texts = run(relay(network), x)
    assert [text for text in texts if text.startswith("LPHD1")][-1] == "LPHD1 ready"


@pytest.mark.parametrize("first", [0, 3])
@pytest.mark.parametrize(("angle", "from_s"), [(-15.0, 0.0), (15.0, LOAD_S), (0.0, 0.0), (0.0, LOAD_S)])
def test_a_fault_outside_with_a_phase_missing(first: int, angle: float, from_s: float) -> None:
    """Behind the relay and at the far end; with load before it, and without, when nobody is warned."""
    network = Network(angle_deg=angle)
    for phases in PHASES:
        for kind in ("AG", "BC", "CAG", "ABC"):
            for at in (-1.0, 1.0):
                x = lost(samples(network, kind, at), phases, first, from_s)
                trips, _ = run(relay(network), x)
                assert not trips, (phases, kind, at, trips)


@pytest.mark.parametrize("angle", [-15.0, 0.0])
def test_what_does_not_need_the_missing_current_still_trips(angle: float) -> None:
    """Phase B is missing: C-A on the line does not need it."""
    network = Network(angle_deg=angle)
    trips, _ = run(relay(network), lost(samples(network, "CA", 0.3), "B", 3, 0.0))
    assert trips[0][1].loop == "CA"
    assert 1000 * (trips[0][0] / 4800 - FAULT_S) < 30


@pytest.mark.parametrize("after_ms", [120.0, 200.0])
def test_all_voltages_lost_without_load_then_a_three_phase_fault(after_ms: float) -> None:
    """Voltages that go while no pole carries current and the breaker stays closed are lost ones: after six
    cycles, in which what has changed becomes what is normal, and then is not proven any more."""
    network = Network(angle_deg=0.0)
    for at in (-1.0, 1.0):
        x = lost(samples(network, "ABC", at), "ABC", 0, FAULT_S - after_ms / 1e3)
        trips, _ = run(relay(network), x)
        assert not trips, (at, trips)


@pytest.mark.parametrize("after_ms", [20.0, 60.0])
@pytest.mark.parametrize("angle", [0.0, -15.0])
@pytest.mark.parametrize("phases", ["ABC", "A", "BC"])
def test_voltages_lost_shortly_before_a_fault_outside(phases: str, angle: float, after_ms: float) -> None:
    """A voltage that goes while every current stays as it was, for half a cycle, is its transformer's; what
    comes then is judged without it."""
    network = Network(angle_deg=angle)
    for kind in ("ABC", "BC"):
        for at in (-1.0, 1.0):
            x = lost(samples(network, kind, at), phases, 0, FAULT_S - after_ms / 1e3)
            trips, _ = run(relay(network), x)
            assert not trips, (kind, at, trips)


@pytest.mark.parametrize("load", [True, False])
def test_a_line_that_was_opened_is_switched_onto_a_bolted_fault(load: bool) -> None:
    """With no voltage left: its load went with the voltage, or the breaker said that it opened."""
    network = Network(angle_deg=-15.0 if load else 0.0)
    healthy, fault = network.solve(), network.solve("ABC", 0.0)
    fault[:3] = 0.0
    x = network.samples([(0.0, healthy), (0.3, np.zeros(6, complex)), (FAULT_S, fault)], END_S)
    own = relay(network)
    trips = []
    for begin, end, closed in ((0, 1440, 7), (1440, 2900, 7 if load else 0), (2900, len(x), 7)):
        own.inputs = RelayInputs(breaker_closed=closed)
        trips += run(own, x[begin:end])[0]
    assert [trip.function for _, trip in trips[:1]] == ["PSOF1"]
    assert 25 < 1000 * (trips[0][0] / 4800 - FAULT_S) < 60
