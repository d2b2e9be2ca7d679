"""PTOC: operating times, resets and sequences against the published equations, worked out independently."""

from __future__ import annotations

import numpy as np
import pytest

from faultloop.errors import InputError
from faultloop.relay import RelaySettings
from faultloop.relay.functions.ptoc import PTOC, operating_time, reset_time
from tests.measured import Measured
from tests.relay.functions.kernel import GIVEN, TURN, Kernel

RATE = 4800
PICKUP = 100.0


def stage(curve: str, **more: object) -> Kernel:
    return Kernel(PTOC, {"pickup_a": PICKUP, "curve": curve, **more})


def currents(multiple: float, phase: int | None = None) -> np.ndarray:
    """Six phasors with a multiple of the pickup, in one phase or balanced in all."""
    x = np.zeros(6, complex)
    x[3:] = multiple * PICKUP * (TURN if phase is None else np.arange(3) == phase)
    return x


def time_to_operate(k: Kernel, multiple: float, phase: int | None = None, limit_s: float = 40.0) -> float:
    """Seconds from the first sample above the pickup."""
    x = currents(multiple, phase)
    for n in range(int(limit_s * RATE)):
        k.step(x if n == 0 else None)
        if k.w["operated"].any():
            return n / RATE
    raise AssertionError("it did not operate")


# Seconds at 2, 5 and 10 times the pickup with a time multiplier of 1, and of the disc's way back at 0, 0.5
# and 0.9: IEC 60255-151, IEEE C37.112, makers' manuals (SEL, ABB, GE); None where there is no disc reset.
GOLDEN = {
    "iec-normal-inverse": ((10.0290, 4.2797, 2.9706), (13.5, 18.0, 71.053)),
    "iec-very-inverse": ((13.5, 3.375, 1.5), (47.3, 63.067, 248.947)),
    "iec-extremely-inverse": ((26.6667, 3.3333, 0.8081), (80, 106.667, 421.053)),
    "iec-long-time-inverse": ((120, 30, 13.3333), (120, 240, 1200)),
    "iec-short-time-inverse": ((1.7785, 0.7519, 0.5183), (4.85, 6.467, 25.526)),
    "ieee-moderately-inverse": ((3.8032, 1.6883, 1.2068), (4.85, 6.467, 25.526)),
    "ieee-very-inverse": ((7.0277, 1.3081, 0.6891), (21.6, 28.8, 113.684)),
    "ieee-extremely-inverse": ((9.5217, 1.2967, 0.4065), (29.1, 38.8, 153.158)),
    "us-moderately-inverse": ((0.7676, 0.3405, 0.2433), (1.08, 1.44, 5.684)),
    "us-inverse": ((2.1633, 0.4279, 0.2401), (5.95, 7.933, 31.316)),
    "us-very-inverse": ((1.3896, 0.2580, 0.1355), (3.88, 5.173, 20.421)),
    "us-extremely-inverse": ((1.9252, 0.2714, 0.0925), (5.67, 7.56, 29.842)),
    "us-short-time-inverse": ((0.2476, 0.1072, 0.0752), (0.323, 0.431, 1.700)),
    "uk-rectifier": ((966.2562, 5.5929, 0.1153), None),
    "ri": ((4.5249, 3.4270, 3.1706), None),
    "rd": ((4.8643, 3.6273, 2.6915), None),
}


@pytest.mark.parametrize("curve", GOLDEN)
def test_the_curves_have_the_published_times(curve: str, measured: Measured) -> None:
    k = stage(curve)
    times, resets = GOLDEN[curve]
    for multiple, seconds in zip((2.0, 5.0, 10.0), times, strict=True):
        found = operating_time(k.c, multiple)
        measured("error of the operating time", 100 * abs(found / seconds - 1), "%")
        assert found == pytest.approx(seconds, rel=1e-3)
    for multiple, seconds in zip((0.0, 0.5, 0.9), resets or (), strict=False):
        assert reset_time(k.c, multiple) == pytest.approx(seconds, rel=2e-3)


@pytest.mark.parametrize(
    ("curve", "multiple", "seconds"),
    [
        ("iec-normal-inverse", 10.0, 2.9706),
        ("iec-extremely-inverse", 10.0, 0.8081),
        ("us-short-time-inverse", 2.0, 0.2476),
        ("ri", 10.0, 3.1706),
    ],
)
def test_a_constant_current_operates_at_that_time(curve: str, multiple: float, seconds: float) -> None:
    for phase in (None, 1):
        assert time_to_operate(stage(curve), multiple, phase) == pytest.approx(seconds, abs=1.5 / RATE)
    assert time_to_operate(stage(curve, time_multiplier=0.1), multiple) == pytest.approx(
        seconds / 10, abs=1.5 / RATE
    )


# An induction disc's progress by hand: first and second current for so long, then the last until it operates.
SEQUENCES = [
    ("iec-normal-inverse", 0.1, (2.0, 0.5), (0.5, 0.3), 2.0, 1.4701),
    ("us-very-inverse", 2.0, (3.0, 0.5), (0.0, 0.5), 3.0, 1.7376),
    ("iec-extremely-inverse", 0.2, (5.0, 0.3), (10.0, 0.0), 10.0, 0.3889),
]


@pytest.mark.parametrize(("curve", "multiplier", "first", "second", "last", "seconds"), SEQUENCES)
def test_a_disc_adds_up_and_turns_back(
    curve: str,
    multiplier: float,
    first: tuple,
    second: tuple,
    last: float,
    seconds: float,
    measured: Measured,
) -> None:
    k = stage(curve, time_multiplier=multiplier, reset="disc")
    spent = 0.0
    for multiple, duration in (first, second):
        k.step(currents(multiple), count=round(duration * RATE))
        spent += duration
        assert not k.w["operated"].any()
    found = spent + time_to_operate(k, last)
    measured("error of a disc's sequence", 100 * abs(found / seconds - 1), "%")
    assert found == pytest.approx(seconds, rel=0.01)


def test_definite_time_is_to_the_sample_and_the_start_at_once() -> None:
    k = stage("definite-time", delay_ms=100.0)
    k.step(currents(1.01))
    assert (int(k.q["pickup"]), int(k.q["operate"]), int(k.q["started"])) == (1, 0, 1)
    k.step(count=479)
    assert not k.q["operate"]
    k.step()
    assert k.q["operate"] == 1
    assert k.q["request"]["made"] == 1
    assert k.q["request"]["three_pole"] == 1
    assert time_to_operate(stage("definite-time"), 1.01) == 0


def test_it_drops_out_below_the_ratio_and_not_above() -> None:
    k = stage("definite-time", delay_ms=1.0)
    k.step(currents(1.2), count=10)
    k.step(currents(0.96), count=10)
    assert (k.q["pickup"], k.q["operate"]) == (1, 1)
    k.step(currents(0.94))
    assert (k.q["pickup"], k.q["operate"]) == (0, 0)


@pytest.mark.parametrize(
    ("reset", "whole"), [({}, 10.0), ({"reset": "definite-time", "reset_ms": 50.0}, 5.0)]
)
def test_what_a_gap_does_to_the_progress(reset: dict, whole: float) -> None:
    """Half way, then a gap of 20 ms: forgotten at once, or kept."""
    k = stage("iec-extremely-inverse", time_multiplier=0.1, **reset)  # 80.8 ms at 10 times
    k.step(currents(10.0), count=round(0.0404 * RATE))
    k.step(currents(0.1), count=round(0.020 * RATE))
    assert time_to_operate(k, 10.0) == pytest.approx(0.0808 * whole / 10, abs=3 / RATE)


def test_beyond_the_flat_part_and_before_the_minimum_time() -> None:
    assert time_to_operate(stage("iec-very-inverse"), 60.0) == pytest.approx(13.5 / 19, abs=1.5 / RATE)
    quick = stage("us-short-time-inverse", time_multiplier=0.1, minimum_time_ms=50.0)
    assert time_to_operate(quick, 10.0) == pytest.approx(0.05, abs=1.5 / RATE)


@pytest.mark.parametrize(
    ("quantity", "balanced", "one_phase"), [("residual", 0.0, 1.0), ("negative-sequence", 0.0, 1 / 3)]
)
def test_residual_and_negative_sequence(quantity: str, balanced: float, one_phase: float) -> None:
    k = stage("definite-time", quantity=quantity)
    k.step(currents(50.0))
    assert k.q["pickup"] == 0
    k.step(currents(0.99 / one_phase, 2))
    assert k.q["pickup"] == 0
    k.step(currents(1.01 / one_phase, 2))
    assert k.q["pickup"] == 1


def test_an_estimator_that_has_not_settled_starts_nothing() -> None:
    k = stage("definite-time")
    k.q["settled"] = 0
    k.step(currents(50.0), count=10)
    assert k.q["pickup"] == 0


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"pickup_a": 100.0, "curve": "iec-normal"}, "iec-normal-inverse"),
        ({"pickup_a": 0.0}, "greater than 0"),
        ({"curve": "ri"}, "missing"),
        ({"pickup_a": 100.0, "curve": "ri", "delay_ms": 5.0}, "definite-time"),
        ({"pickup_a": 100.0, "time_multiplier": 0.1}, "delay_ms"),
        ({"pickup_a": 100.0, "curve": "ri", "reset": "disc"}, "no disc reset"),
        ({"pickup_a": 100.0, "reset": "definite-time"}, "reset_ms"),
    ],
)
def test_what_is_wrong_is_named(table: dict, words: str) -> None:
    with pytest.raises(InputError) as error:
        RelaySettings.from_dict(GIVEN | {"ptoc": [table]})
    assert (error.value.key or "").startswith("ptoc[1]")
    assert words in error.value.what
