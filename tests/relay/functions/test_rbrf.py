"""RBRF: the detector by samples, with and without subsidence; timers; the real breaker failure."""

from __future__ import annotations

import numpy as np
import pytest

from faultloop.errors import InputError
from faultloop.relay import RelaySettings
from faultloop.relay.functions.rbrf import RBRF
from tests.measured import Measured
from tests.relay.functions.kernel import GIVEN, Kernel

FS, CYCLE = 4800, 96
TABLE = {"current_a": 200.0}


def run(k: Kernel, currents: np.ndarray, poles: int = 0b001, tripped: int = 0) -> np.ndarray:
    """Bits of operate and pickup, (n, 2), for the current of phase A; tripped from this sample on."""
    recent, bits = k.q["recent"], []
    for n, i in enumerate(currents):
        recent["head"] = (recent["head"] + 1) % len(recent["value"])
        recent["value"][recent["head"]] = 0.0
        recent["value"][recent["head"], 3] = i
        k.step(poles=poles if n >= tripped else 0)
        bits.append(int(k.q["pickup"]))
    return np.array(bits)


def current(
    rms: float, seconds: float, offset: float = 0.0, tau_s: float = 0.05, angle: float = 0.0
) -> np.ndarray:
    t = np.arange(round(seconds * FS)) / FS
    wave = np.cos(2 * np.pi * 50 * t + angle) - offset * np.cos(angle) * np.exp(-t / tau_s)
    return np.sqrt(2) * rms * wave


def opened(
    wave: np.ndarray, left: float = 0.0, tau_s: float = 0.06, tail_s: float = 0.2
) -> tuple[np.ndarray, int]:
    """Cut at the last zero; what the core has taken by then, so much of the crest, it gives back.

    The secondary current does not jump: the exciting current has grown within the last 5 ms.
    """
    zero = int(np.flatnonzero(np.diff(np.sign(wave)))[-1]) + 1
    size = left * np.abs(wave).max()
    t = np.arange(round(tail_s * FS)) / FS
    taken = size * np.exp((np.arange(zero) - zero) / FS / 0.005)
    return np.r_[wave[:zero] + taken, size * np.exp(-t / tau_s)], zero


@pytest.mark.parametrize("rms", [300.0, pytest.param(2000.0, marks=pytest.mark.slow), 20e3])
@pytest.mark.parametrize("offset", [0.0, 1.0])
@pytest.mark.parametrize("left", [0.0, 0.5, -0.5])
@pytest.mark.parametrize("tau_s", [pytest.param(0.03, marks=pytest.mark.slow), 0.1])
@pytest.mark.parametrize("step_deg", [120, pytest.param(30, marks=pytest.mark.slow)])
def test_the_detector_resets_within_15_ms_with_subsidence_too(
    rms: float, offset: float, left: float, tau_s: float, step_deg: int, measured: Measured
) -> None:
    """At every angle of the beginning; and it does not reset while the current flows."""
    for angle in np.radians(range(0, 360, step_deg)):
        wave, zero = opened(current(rms, 0.14, offset, 0.05, angle), left, tau_s)
        on = run(Kernel(RBRF, TABLE | {"backup_ms": 1000.0}), wave) & 1
        assert on[2 * CYCLE : zero - CYCLE // 4].all(), "it flows"
        gone = np.flatnonzero(on)[-1] + 1 - zero
        measured("reset after the last zero", 1000 * gone / FS, "ms")
        assert gone / FS <= 0.015, (angle, 1000 * gone / FS)


def test_retrip_and_backup_are_to_the_sample_and_only_while_current_flows() -> None:
    k = Kernel(RBRF, TABLE | {"retrip_ms": 20.0, "backup_ms": 100.0})
    bits = run(k, current(1000.0, 0.4), tripped=2 * CYCLE)
    assert int(np.flatnonzero(bits & 0b010)[0]) - 2 * CYCLE == CYCLE
    assert int(np.flatnonzero(bits & 0b100)[0]) - 2 * CYCLE == 5 * CYCLE
    assert (k.q["request"]["made"], k.q["request"]["three_pole"]) == (1, 1)
    wave, zero = opened(current(1000.0, 0.13), 0.5)
    bits = run(Kernel(RBRF, TABLE | {"backup_ms": 100.0}), wave, tripped=2 * CYCLE)
    assert (bits[zero:] & 0b010).any(), "a second trip"
    assert not (bits & 0b100).any(), "the breaker has opened in time"


def test_without_a_trip_or_without_current_nothing_starts() -> None:
    assert not run(Kernel(RBRF, TABLE), current(5000.0, 0.3), poles=0).any()
    assert not run(Kernel(RBRF, TABLE), current(150.0, 0.3)).any()


@pytest.mark.parametrize(
    ("table", "key", "words"),
    [
        ({}, "rbrf.current_a", "missing"),
        ({"current_a": 100.0, "retrip_ms": 100.0, "backup_ms": 80.0}, "rbrf", "above retrip_ms"),
    ],
)
def test_what_is_wrong_is_named(table: dict[str, float], key: str, words: str) -> None:
    with pytest.raises(InputError) as error:
        RelaySettings.from_dict(GIVEN | {"rbrf": table})
    assert (error.value.key or "").startswith(key)
    assert words in error.value.what
