"""PTUF, PTOF, PFRC: ramps and jumps through the whole relay; limits by the kernel alone."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from faultloop.errors import InputError
from faultloop.relay import Relay, RelaySettings
from faultloop.relay.functions.pfrc import PFRC
from faultloop.relay.functions.ptof import PTOF
from faultloop.relay.functions.ptuf import PTUF
from tests.relay.functions.kernel import GIVEN, TURN, Kernel
from tests.relay.network import play

FS, VOLTS = 4800, 127e3
HEALTHY = np.r_[VOLTS * TURN, np.zeros(3)]


def waves(frequency: Any, seconds: float, jump_deg: float = 0.0, at_s: float = 0.5) -> np.ndarray:
    """(n, 6): voltages of a frequency that is a function of time, with a jump of the phase; 300 A of load."""
    t = np.arange(round(seconds * FS)) / FS
    hertz = np.broadcast_to(frequency(t), t.shape)
    angle = 2 * math.pi * np.cumsum(hertz) / FS + np.radians(jump_deg) * (t >= at_s)
    turn = np.exp(1j * angle)[:, None] * TURN
    return np.hstack([math.sqrt(2) * VOLTS * turn.real, math.sqrt(2) * 300 * (turn * np.exp(-0.2j)).real])


def trips(tables: dict[str, Any], x: np.ndarray, method: str = "kalman-bank") -> list[float]:
    """Seconds of the trips."""
    given = (
        GIVEN | {"relay": {"frequency_hz": 50, "nominal_kv": 220}, "estimator": {"method": method}} | tables
    )
    relay = Relay(RelaySettings.from_dict(given))
    return [event.sample_count / FS for event in play(relay, x) if event.trip]


@pytest.mark.parametrize("method", ["kalman-bank", "fourier"])
@pytest.mark.parametrize(("table", "start", "rate"), [("ptuf", 49.0, -2.0), ("ptof", 51.0, 2.0)])
def test_a_ramp_trips_at_its_limit_after_its_delay(
    table: str, start: float, rate: float, method: str
) -> None:
    """50 Hz until 0.4 s; the limit is reached at 0.9 s; measuring takes a window and a cycle."""
    x = waves(lambda t: 50 + rate * np.maximum(t - 0.4, 0), 1.5)
    found = trips({table: [{"start_hz": start, "delay_ms": 100.0}]}, x, method)
    assert len(found) == 1 and 1.0 <= found[0] < 1.04


@pytest.mark.parametrize("jump", [-90.0, -30.0, 10.0, 60.0, 180.0])
def test_a_jump_of_the_phase_is_no_frequency(jump: float) -> None:
    tables = {
        "ptuf": [{"start_hz": 49.8, "delay_ms": 0.0}],
        "ptof": [{"start_hz": 50.2, "delay_ms": 0.0}],
        "pfrc": [{"start_hz_per_s": 0.5, "delay_ms": 0.0}],
    }
    assert trips(tables, waves(lambda t: 50.0, 1.2, jump)) == []


@pytest.mark.parametrize(("side", "rate", "operates"), [
    ("falling", -1.0, True), ("falling", 1.0, False), ("rising", 1.0, True), ("both", -1.0, True),
    ("both", -0.4, False),
])  # fmt: skip
def test_a_rate_trips_on_its_side_above_its_limit(side: str, rate: float, operates: bool) -> None:
    x = waves(lambda t: 50 + rate * np.maximum(t - 0.4, 0), 1.4)
    found = trips({"pfrc": [{"start_hz_per_s": 0.5, "side": side}]}, x)
    assert bool(found) == operates
    if found:  # half the window until the rate is 0.5, the delay, the measurement
        assert 0.4 + 0.075 + 0.1 <= found[0] < 0.4 + 0.075 + 0.1 + 0.05


@pytest.mark.parametrize("hertz", [46.0, 48.5, 52.5])
def test_a_relay_that_begins_off_the_nominal_frequency_sees_no_rate(hertz: float) -> None:
    """The default estimator, with empty filters, swings about the right frequency for 0.3 s."""
    x = waves(lambda t: hertz, 1.2)
    assert trips({"pfrc": [{"start_hz_per_s": 0.5, "delay_ms": 0.0}]}, x) == []
    x[: round(0.4 * FS), :3] = 0.0  # and so where the voltage comes later
    assert trips({"pfrc": [{"start_hz_per_s": 0.5, "delay_ms": 0.0}]}, x) == []


@pytest.mark.parametrize("volts", [0.0, 0.05])
def test_below_a_voltage_there_is_no_frequency(volts: float) -> None:
    x = waves(lambda t: 50 - 2 * np.maximum(t - 0.4, 0), 1.5)
    x[round(0.6 * FS) :, :3] *= volts
    assert trips({"ptuf": [{"start_hz": 49.0}], "pfrc": [{"start_hz_per_s": 3.0}]}, x) == []


@pytest.mark.parametrize(("function", "start", "beyond"), [(PTUF, 49.0, -1), (PTOF, 51.0, 1)])
def test_limit_hysteresis_and_least_delay(function: Any, start: float, beyond: int) -> None:
    k = Kernel(function, {"start_hz": start, "delay_ms": 0.0, "minimum_v": 60e3})
    k.step(HEALTHY, frequency=start - 0.01 * beyond)
    assert k.q["pickup"] == 0
    k.step(count=288, frequency=start + 0.01 * beyond)
    assert (k.q["pickup"], k.q["operate"]) == (1, 0)
    k.step(frequency=start + 0.01 * beyond)
    assert k.q["operate"] == 1
    k.step(frequency=start - 0.04 * beyond)
    assert k.q["operate"] == 1
    k.step(frequency=start - 0.06 * beyond)
    assert k.q["pickup"] == 0
    for more in ({"frequency": math.nan}, {"frequency": start + beyond, "fuse_failure": 1}):
        k.step(count=500, **more)
        assert k.q["pickup"] == 0
    for part, starts in ((0.4, 0), (0.5, 1)):
        k.step(part * HEALTHY, count=500, frequency=start + beyond, fuse_failure=0)
        assert k.q["pickup"] == starts


def test_a_rate_needs_a_whole_window() -> None:
    k = Kernel(PFRC, {"start_hz_per_s": 1.0, "window_ms": 100.0, "delay_ms": 0.0})
    k.step(HEALTHY, count=15 * 96 + 60, frequency=51.0)  # settled, then 60
    k.step(count=60, frequency=50.0)
    assert k.w["rate"] == 0.0
    k.step(count=400, frequency=50.0)
    assert k.w["rate"] < -9.0
    k.step(count=600, frequency=50.0)
    assert k.w["rate"] == 0.0


@pytest.mark.parametrize(
    ("tables", "key", "words"),
    [
        ({"ptuf": [{"start_hz": 50.5}]}, "ptuf[1].start_hz", "between 45 and 50 Hz"),
        ({"ptof": [{"start_hz": 49.0}]}, "ptof[1].start_hz", "between 50 and 55 Hz"),
        ({"ptuf": [{"start_hz": 40.0}]}, "ptuf[1].start_hz", "between 45 and 50 Hz"),
        ({"pfrc": [{"start_hz_per_s": -1.0}]}, "pfrc[1].start_hz_per_s", "greater than 0"),
        ({"pfrc": [{"start_hz_per_s": 1.0, "window_ms": 20.0}]}, "pfrc[1].window_ms", "60"),
    ],
)
def test_what_is_wrong_is_named(tables: dict[str, Any], key: str, words: str) -> None:
    with pytest.raises(InputError) as error:
        RelaySettings.from_dict(GIVEN | tables)
    assert error.value.key == key
    assert words in error.value.what
