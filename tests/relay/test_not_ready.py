"""A relay that wakes in a fault, a line switched onto one, the own breaker opening: made signals."""

from __future__ import annotations

import numpy as np
import pytest

from faultloop.relay import Relay, RelaySettings
from faultloop.relay.estimators import estimator_methods
from faultloop.relay.estimators.protection import REFUSED
from faultloop.relay.events import Trip

FS = 4800
LINE, SOURCE, PEAK = complex(5, 29.1), complex(1, 15), 127e3 * np.sqrt(2)
TURN = np.exp(-2j * np.pi / 3 * np.arange(3))
FAULT_S, DURATION_S = 0.1, 0.6
ALLOWED = sorted(set(estimator_methods()) - set(REFUSED))


def relay(method: str = "kalman-bank") -> Relay:
    return Relay(
        RelaySettings.from_dict(
            {
                "relay": {"frequency_hz": 50, "nominal_kv": 220},
                "estimator": {"method": method},
                "vt": {"kind": "ideal"},
                "line": {"z1_ohm": [LINE.real, LINE.imag], "z0_ohm": [29.6, 91.7]},
                "pdis": [{"zone": 1, "reach_pu": 0.8}, {"zone": 2, "reach_pu": 1.2, "delay_ms": 300.0}],
            }
        )
    )


def three_phase(depth: float, angle: float = 0.0) -> np.ndarray:
    """(n, 6): load, and from 0.1 s on a bolted three-phase fault at ``depth`` of the line."""
    t = np.arange(int(DURATION_S * FS)) / FS
    turn = np.exp(1j * (2 * np.pi * 50 * t + angle))[:, None] * TURN
    i = PEAK / (SOURCE + depth * LINE)
    before = np.hstack([(PEAK * turn).real, (424.0 * np.exp(-0.2j) * turn).real])
    after = np.hstack([(i * depth * LINE * turn).real, (i * turn).real])
    return np.where((t < FAULT_S)[:, None], before, after)


def run(r: Relay, x: np.ndarray) -> tuple[list[tuple[int, Trip]], list[str]]:
    done, trips, texts = 0, [], []
    while done < len(x):
        done += r.advance(x[done : done + 240])
        trips += [(event.sample_count, event.trip) for event in r.events if event.trip]
        texts += [event.text for event in r.events]
    return trips, texts


@pytest.mark.parametrize("method", ALLOWED)
@pytest.mark.parametrize("before_ms", [0, 5, 10, 20, 30, 40, 50, 60, 80])
def test_a_relay_that_wakes_in_a_fault_trips_or_says_why_not(method: str, before_ms: int) -> None:
    x = three_phase(0.3)[round((FAULT_S - before_ms / 1000) * FS) :]
    trips, texts = run(relay(method), x)
    if trips:
        at, trip = trips[0]
        assert trip.zone == 1
        assert 0 < 1000 * at / FS - before_ms < 50
    else:
        assert any("not ready" in text and "looks like a fault" in text for text in texts), texts


def test_it_is_ready_again_once_the_fault_is_gone() -> None:
    faulted, healthy = three_phase(0.3)[480:1440], three_phase(0.3, 2 * np.pi * 50 * 0.2)[:480]
    r = relay()
    trips, texts = run(r, np.concatenate([faulted, healthy]))
    assert not trips
    assert texts[-1] == "LPHD1 ready"


@pytest.mark.parametrize("alive", [True, False])
@pytest.mark.parametrize("depth", [0.0, 0.3, 0.9])
def test_a_dead_line_is_switched_onto_a_fault(depth: float, alive: bool) -> None:
    """At no voltage at all only if the voltage was ever there."""
    x = three_phase(depth)
    before = x[: round(FAULT_S * FS)].copy() if alive else np.zeros((0, 6))
    x[: round(FAULT_S * FS)] = 0.0
    x = np.concatenate([before, np.zeros((FS // 4, 6)), x])
    trips, texts = run(relay(), x)
    if depth == 0.0 and not alive:
        assert not trips
        assert any("not ready" in text and "no voltage" in text for text in texts)
        return
    assert trips, "no trip"
    at, trip = trips[0]
    assert (trip.function, trip.poles) == ("PSOF1", 7)
    assert 1000 * (at - len(before) - FS // 4) / FS - 100 < 60


@pytest.mark.parametrize("depth", [2.0, 20.0])
def test_a_dead_line_is_switched_onto_what_is_farther(depth: float) -> None:
    x = three_phase(depth)
    x[: round(FAULT_S * FS)] = 0.0
    trips, _ = run(relay(), np.concatenate([np.zeros((FS // 4, 6)), x])[:2400])
    assert not trips


def opening(depth: float, angle: float, ring_hz: float, tau: float) -> np.ndarray:
    """The three-phase fault; at 0.2 s the poles open at their zeros, and the line's voltage dies away."""
    x, t = three_phase(depth, angle), np.arange(int(DURATION_S * FS)) / FS
    for phase in range(3):
        i = x[:, 3 + phase]
        zero = np.flatnonzero((t >= 0.2) & (np.sign(i) != np.sign(np.roll(i, 1))))[0]
        since = t[zero:] - t[zero]
        x[zero:, phase] = x[zero - 1, phase] * np.exp(-since / tau) * np.cos(2 * np.pi * ring_hz * since)
        x[zero:, 3 + phase] = 0.0
    return x


@pytest.mark.parametrize("method", ["kalman-bank", "fourier", "cosine", "least-squares"])
@pytest.mark.parametrize(("ring_hz", "tau"), [(0, 0.0005), (0, 0.01), (40, 0.02), (150, 0.01)])
def test_the_own_breaker_opens_and_the_line_side_voltage_dies(
    method: str, ring_hz: float, tau: float
) -> None:
    """../shared/cases/relay-breaker-opens-line-vt, syn2.py: kalman-bank 72 of 300."""
    for depth in (1.0, 1.5, 3.0):
        for angle in np.radians([0, 45, 105]):
            trips, _ = run(relay(method), opening(depth, angle, ring_hz, tau))
            assert not trips, f"{depth} of the line, {np.degrees(angle):.0f} degrees: {trips}"


@pytest.mark.parametrize("hz", [45.5, 50.0, 54.5])
def test_a_memory_that_becomes_ready_has_one_frequency(hz: float) -> None:
    """Not that of an estimate which had just woken, nor the nominal one: they would pull its own away."""
    t = np.arange(round(0.5 * FS)) / FS
    turn = np.exp(2j * np.pi * hz * t)[:, None] * TURN
    x = np.hstack([np.real(PEAK * turn) * (t >= 0.3)[:, None], np.zeros((len(t), 3))])
    r = relay()
    memory = r._state[0]["shared"]["memory"]
    n = 0
    while not memory["ready"]:
        n += r.advance(x[n : n + 1])
    assert t[n - 1] > 0.3
    assert set(memory["ring_frequency"].tolist()) == {float(memory["frequency"])}
    assert abs(memory["frequency"] - hz) < 1.0
