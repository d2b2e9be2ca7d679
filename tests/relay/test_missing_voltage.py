"""A voltage transformer that is missing, whole or in part, is no fault; nor is what comes with energising."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from faultloop.relay import Relay
from tests.relay.network import TYPES, Network
from tests.relay.test_not_ready import FS, LINE, PEAK, SOURCE, TURN, run
from tests.relay.test_not_ready import relay as line_relay
from tests.relay.test_records import analog, settings_file
from tests.relay.test_zones import relay as network_relay

METHODS = ("kalman-bank", "fourier")
LOAD_OHM = complex(90, 20)


def waves(seconds: float, impedance: complex, phase: float = 0.0) -> np.ndarray:
    """(n, 6): voltages behind SOURCE with a balanced impedance at the relay's place; none carries nothing."""
    turn = np.exp(1j * (2 * np.pi * 50 * np.arange(round(seconds * FS)) / FS + phase))[:, None] * TURN
    i = PEAK / (SOURCE + impedance)
    return np.hstack([(i * impedance * turn).real, (i * turn).real])


def dead(seconds: float) -> np.ndarray:
    return np.zeros((round(seconds * FS), 6))


def without(x: np.ndarray, phases: str) -> np.ndarray:
    """The same with the voltages of some phases missing."""
    x = x.copy()
    x[:, ["ABC".index(p) for p in phases]] = 0.0
    return x


def no_trip(x: np.ndarray, method: str = "kalman-bank", **tables: Any) -> list[str]:
    trips, texts = run(line_relay(method), x)
    assert not trips, trips
    return texts


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("phases", ["A", "BC", "ABC"])
def test_load_is_picked_up_with_voltages_missing(method: str, phases: str) -> None:
    no_trip(without(np.concatenate([dead(0.3), waves(0.8, LOAD_OHM)]), phases), method)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("phases", ["A", "BC", "ABC"])
def test_voltages_were_lost_under_load_before_the_line_was_dead(method: str, phases: str) -> None:
    load = waves(0.4, LOAD_OHM)
    lost = without(np.concatenate([load, dead(0.3), load, load]), phases)
    no_trip(np.concatenate([load, lost]), method)


@pytest.mark.parametrize("phases", ["A", "BC", "ABC"])
def test_the_relay_starts_in_load_with_voltages_missing(phases: str) -> None:
    texts = no_trip(without(np.concatenate([waves(0.4, LOAD_OHM), waves(0.4, 2 * LOAD_OHM)]), phases))
    assert any("not ready" in text for text in texts)


@pytest.mark.parametrize("phases", ["A", "BC"])
def test_voltages_that_are_missing_stay_out_when_a_load_comes(phases: str) -> None:
    """Without load one phase is missing and nobody knows; then a load comes, in all phases and in one."""
    for unbalanced in (False, True):
        idle, load = waves(0.4, 1e6 + 0j), waves(0.6, LOAD_OHM)
        if unbalanced:
            load[:, 4:] = 0.0
        no_trip(without(np.concatenate([idle, load]), phases))


def test_a_missing_phase_is_told() -> None:
    load, idle = waves(0.4, LOAD_OHM), waves(0.4, 1e6 + 0j)
    texts = no_trip(without(np.concatenate([idle, load]), "B"))
    assert any("phase B" in text for text in texts), texts
    texts = no_trip(np.concatenate([load, without(load, "B"), load]))
    assert any("phase B" in text for text in texts), texts


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("impedance", [complex(0, -500), LOAD_OHM, complex(40, 50)])
def test_charging_load_and_motors_behind_a_line_of_30_ohm(method: str, impedance: complex) -> None:
    no_trip(np.concatenate([dead(0.3), waves(0.8, impedance, 0.7)]), method)


def test_a_heavy_load_behind_a_long_line() -> None:
    """0.9 of the circle, at a load's angle."""
    size = 0.9 * 1.2 * abs(LINE)
    no_trip(np.concatenate([dead(0.3), waves(0.8, size * np.exp(0.2j))]))


@pytest.mark.parametrize("kind", TYPES)
@pytest.mark.parametrize("at", [0.0, 0.02, 0.5])
def test_energised_onto_a_fault_of_every_type(kind: str, at: float) -> None:
    """Never a voltage before: a three-phase fault at the relay's place cannot be told from a missing VT."""
    network = Network(zr1=3e5 + 3e5j, zr0=3e5 + 3e5j)
    fault = network.samples([(0.0, network.solve(kind, at))], 0.4)
    trips, texts = run(network_relay(network, method="kalman-bank"), np.concatenate([dead(0.3), fault]))
    if kind.startswith("ABC") and at == 0.0:
        assert not trips
        assert any("no voltage" in text for text in texts)
    else:
        assert trips[0][1].function == "PSOF1"
        assert 1000 * (trips[0][0] / FS - 0.3) < 80


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("voltages", ["BCA", "BC", "A", ""])
def test_inrush_when_the_line_is_energised(records: Path, root: Path, method: str, voltages: str) -> None:
    """The real inrush, with a healthy voltage that comes with it in all, some, or none of the phases."""
    x = analog(records / "transformer-inrush", "transformer_inrush", "cp1251")
    currents = 100.0 * x[0:3].T
    begun = int(np.argmax(np.abs(currents).max(axis=1) > 0.1 * np.abs(currents).max()))
    settings = settings_file(root, "transformer-inrush")
    estimator = settings.estimator.model_copy(update={"method": method})
    settings = settings.model_copy(update={"estimator": estimator})
    t = np.arange(len(currents)) / 2400
    for angle in range(0, 360, 90):
        phase = 2 * np.pi * 50 * t[:, None] + np.radians(angle - np.array([0, 120, 240]))
        volts = 110e3 * np.sqrt(2 / 3) * np.cos(phase)
        volts[:begun] = 0.0
        volts[:, [p not in voltages for p in "ABC"]] = 0.0
        lead = np.zeros((720, 6))
        trips, _ = run(Relay(settings), np.concatenate([lead, np.column_stack([volts, currents])]))
        assert not trips, (angle, trips)


# ---------------------------------------------------------------- in a fault


def lost(x: np.ndarray, phases: str, after_ms: float) -> np.ndarray:
    """The same with some phases' voltages gone so long after a fault that begins after 0.1 s."""
    at = round((0.1 + after_ms / 1000) * FS)
    return np.concatenate([x[:at], without(x[at:], phases)])


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("at", [1.0, -1.0])
@pytest.mark.parametrize("kind", ["AG", "BC", "CAG", "ABC"])
def test_voltages_that_are_lost_in_a_fault_elsewhere(method: str, at: float, kind: str) -> None:
    """The current of the fault flows on, and there is no voltage left beside it (before: zone 1)."""
    network = Network()
    x = network.fault(kind, at, duration_s=0.35)
    for phases in ("A", "BC", "ABC"):
        for after_ms in (30, 57):
            trips, texts = run(network_relay(network, method=method), lost(x, phases, after_ms))
            wrong = {1} if at > 0 else {1, 2}  # zone 2 is right ahead, and the reverse zone 3 behind
            assert not [trip for _, trip in trips if trip.zone in wrong], (phases, after_ms, trips)
            if at > 0 or not set(phases) <= set(kind):  # behind, close in, there was none to lose
                assert any("cannot be relied on" in text for text in texts), (phases, after_ms, texts)


@pytest.mark.parametrize("phases", ["A", "BC", "ABC"])
def test_a_fault_that_ends_after_the_voltages_were_lost_in_it(phases: str) -> None:
    network = Network()
    for at in (1.0, -1.0):
        x = network.samples(
            [(0, network.solve()), (0.1, network.solve("BC", at)), (0.2, network.solve())], 0.4
        )
        trips, _ = run(network_relay(network, method="kalman-bank"), lost(x, phases, 40))
        assert not trips, (at, trips)


@pytest.mark.parametrize("kind", ["AG", "BG", "CAG", "ABC"])
@pytest.mark.parametrize("at", [0.0, 0.05])
@pytest.mark.parametrize("after_ms", [25, 33, 41])
def test_a_fault_close_in_while_another_one_goes_on_beyond(kind: str, at: float, after_ms: float) -> None:
    """Its voltage goes as well, and the current of the same phase tells that it is none that was lost."""
    network = Network()
    stages = [
        (0.0, network.solve()),
        (0.1, network.solve("BC", 1.0)),
        (0.1 + after_ms / 1000, network.solve(kind, at)),
    ]
    trips, texts = run(network_relay(network, method="kalman-bank"), network.samples(stages, 0.35))
    assert trips, texts
    assert 1000 * (trips[0][0] / FS - stages[2][0]) < 45


@pytest.mark.parametrize("first", ["voltage", "current"])
@pytest.mark.parametrize("phases", [("C", "A"), ("B", "B"), ("ABC", "A"), ("A", "BC")])
@pytest.mark.parametrize("wait_ms", [0.5, 4.6, 9.0, 30.0])
def test_voltage_and_current_that_are_lost_one_after_the_other(
    first: str, phases: tuple[str, str], wait_ms: float
) -> None:
    x = waves(0.5, LOAD_OHM)
    for angle_ms in (0.0, 3.0, 7.0):
        begin = round((0.2 + angle_ms / 1000) * FS)
        later = begin + round(wait_ms / 1000 * FS)
        y = x.copy()
        voltage, current = (begin, later) if first == "voltage" else (later, begin)
        y[voltage:, ["ABC".index(p) for p in phases[0]]] = 0.0
        y[current:, [3 + "ABC".index(p) for p in phases[1]]] = 0.0
        no_trip(y)
