"""PTUV and PTOV: limits, timers, and what is no undervoltage."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from faultloop.errors import InputError
from faultloop.relay import Relay, RelaySettings
from faultloop.relay.functions.ptov import PTOV
from faultloop.relay.functions.ptuv import PTUV
from tests.relay.functions.kernel import GIVEN, TURN, Kernel
from tests.relay.network import Network, play, settings_dict

NOMINAL = 127e3
LOW = {"start_v": 100e3, "delay_ms": 100.0, "minimum_v": 12e3}


def volts(*parts: float) -> np.ndarray:
    """Six phasors, so much of the nominal voltage in each phase."""
    return np.r_[NOMINAL * np.array(parts) * TURN, np.zeros(3)]


@pytest.mark.parametrize(
    ("table", "parts", "starts"),
    [
        ({}, (0.79, 0.79, 0.79), 0),
        ({}, (0.78, 1.0, 1.0), 1),
        ({"phases": "all"}, (0.78, 0.78, 1.0), 0),
        ({"phases": "all"}, (0.78, 0.78, 0.78), 1),
        ({"quantity": "positive-sequence"}, (0.0, 1.0, 1.0), 1),  # V1 is two thirds
        ({"quantity": "positive-sequence"}, (0.4, 1.0, 1.0), 0),
        ({"quantity": "phase-phase", "start_v": 173e3}, (0.5, 1.0, 1.0), 1),
        ({"quantity": "phase-phase", "start_v": 160e3}, (0.5, 1.0, 1.0), 0),  # sqrt(1.75) of 127 kV is 168
    ],
)
def test_what_is_low(table: dict[str, Any], parts: tuple[float, ...], starts: int) -> None:
    k = Kernel(PTUV, LOW | table)
    k.step(volts(*parts))
    assert k.q["pickup"] == starts


def test_undervoltage_waits_for_its_delay_and_drops_out_above_the_ratio() -> None:
    k = Kernel(PTUV, LOW)
    k.step(volts(0.7, 1, 1), count=480)
    assert (k.q["pickup"], k.q["operate"]) == (1, 0)
    k.step()
    assert (k.q["operate"], k.q["request"]["made"]) == (1, 1)
    k.step(volts(0.80, 1, 1))  # 101.6 kV, below 1.03 of the start
    assert k.q["operate"] == 1
    k.step(volts(0.82, 1, 1))
    assert (k.q["pickup"], k.q["operate"]) == (0, 0)


def test_no_voltage_is_no_undervoltage_unless_it_is_set_so() -> None:
    for more, operates in (({}, 0), ({"trip_without_voltage": True}, 1)):
        k = Kernel(PTUV, LOW | more)
        k.step(volts(0, 0, 0), count=1000)
        assert k.q["operate"] == operates
        k.step(volts(1, 1, 1))
        k.step(volts(0.5, 0.5, 0.5), count=1000, fuse_failure=1)
        assert k.q["operate"] == 0


@pytest.mark.parametrize(
    ("table", "parts", "starts"),
    [
        ({"start_v": 140e3}, (1.1, 1.0, 1.0), 0),
        ({"start_v": 139e3}, (1.1, 1.0, 1.0), 1),
        ({"start_v": 139e3, "phases": "all"}, (1.1, 1.0, 1.0), 0),
        ({"start_v": 126e3, "quantity": "residual"}, (0.0, 1.0, 1.0), 1),  # 3V0 is the lost phase's voltage
        ({"start_v": 128e3, "quantity": "residual"}, (0.0, 1.0, 1.0), 0),
        ({"start_v": 42e3, "quantity": "negative-sequence"}, (0.0, 1.0, 1.0), 1),
        ({"start_v": 43e3, "quantity": "negative-sequence"}, (0.0, 1.0, 1.0), 0),
    ],
)
def test_what_is_high(table: dict[str, Any], parts: tuple[float, ...], starts: int) -> None:
    k = Kernel(PTOV, table)
    k.step(volts(*parts))
    assert k.q["pickup"] == starts


def test_overvoltage_waits_and_a_blown_fuse_is_no_residual_voltage() -> None:
    k = Kernel(PTOV, {"start_v": 139e3, "delay_ms": 20.0})
    k.step(volts(1.2, 1, 1), count=96)
    assert k.q["operate"] == 0
    k.step()
    assert k.q["operate"] == 1
    k = Kernel(PTOV, {"start_v": 50e3, "quantity": "residual"})
    k.step(volts(0, 1, 1), count=10_000, fuse_failure=1)
    assert k.q["pickup"] == 0


def test_a_line_that_is_switched_off_and_a_blown_fuse_trip_no_undervoltage() -> None:
    """With the shortest delay there is, through the relay's own estimator."""
    network = Network()
    stage = {"start_v": 110e3, "delay_ms": 40.0}
    settings = settings_dict(network, [], tvtr={}, estimator={"method": "kalman-bank"})
    settings["ptuv"] = [stage]
    settings["relay"]["nominal_kv"] = 220
    load = network.solve()
    lost = load.copy()
    lost[:2] = 0.0
    for after in (np.zeros(6), lost):
        relay = Relay(RelaySettings.from_dict(settings))
        events = play(relay, network.samples([(0.0, load), (0.3, after)], 1.0))
        assert not [event for event in events if event.trip]
    relay = Relay(RelaySettings.from_dict(settings))
    sag = np.r_[0.6 * load[:3], load[3:]]
    trips = [e for e in play(relay, network.samples([(0.0, load), (0.3, sag)], 1.0)) if e.trip]
    assert trips and 0.04 <= trips[0].sample_count / 4800 - 0.3 < 0.065


@pytest.mark.parametrize(
    ("tables", "key", "words"),
    [
        ({"ptuv": [{"start_v": 1e5, "delay_ms": 30.0}]}, "ptuv[1].delay_ms", "40 ms"),
        ({"ptuv": [{"start_v": 1e5, "minimum_v": 2e5}]}, "ptuv[1]", "minimum_v"),
        ({"ptuv": [{"start_v": 1e5, "quantity": "residual"}]}, "ptuv[1].quantity", "phase"),
        ({"ptov": [{"start_v": -1.0}]}, "ptov[1].start_v", "greater than 0"),
        ({"ptov": [{"start_v": 1e5, "dropout_ratio": 1.2}]}, "ptov[1].dropout_ratio", "1"),
    ],
)
def test_what_is_wrong_is_named(tables: dict[str, Any], key: str, words: str) -> None:
    with pytest.raises(InputError) as error:
        RelaySettings.from_dict(GIVEN | tables)
    assert (error.value.key or "").startswith(key)
    assert words in error.value.what


def test_secondary_volts_are_volts_of_the_secondary() -> None:
    given = {
        "relay": {"frequency_hz": 50, "ohms": "secondary", "ct_ratio": 240, "vt_ratio": 2000},
        "line": GIVEN["line"],
        "ptuv": [{"start_v": 50.0}],
    }
    settings = RelaySettings.from_dict(given)
    assert PTUV.values(settings, settings.ptuv[0])["start"] == 100e3
