"""Zone 1 of 80 % behind capacitive voltage transformers of which the relay knows nothing (bench/cvt.py)."""

from __future__ import annotations

from types import ModuleType

import pytest

from faultloop.relay import Relay
from tests.load import load
from tests.measured import Measured


@pytest.fixture(scope="module")
def bench() -> ModuleType:
    return load("bench/cvt.py")


def start(
    bench: ModuleType,
    circuit: str,
    sir: float,
    at: float,
    kind: str,
    angle: float,
    told: str,
    burden: float = 100.0,
) -> float:
    x, begin = bench.samples(circuit, sir, at, kind, angle, burden)
    return bench.start_ms(Relay(bench.settings(told, "mho", "kalman-bank", circuit)), x, begin)


@pytest.mark.parametrize("circuit", ["P1", "P2", "A1", "A2"])
@pytest.mark.parametrize("sir", [3.0, 5.0, 30.0])
def test_no_start_at_the_remote_bus(bench: ModuleType, circuit: str, sir: float) -> None:
    """Before: up to 36 of 36 from a source of 5 times the line on."""
    for kind, angle in (("AG", 45.0), ("BC", 0.0), ("ABC", 90.0)):
        t = start(bench, circuit, sir, 1.0, kind, angle, "none")
        assert t != t, f"{kind} {angle:g}: {t} ms"


@pytest.mark.parametrize("circuit", ["P1", "P2", "A1", "A2"])
def test_it_starts_inside_all_the_same(bench: ModuleType, circuit: str) -> None:
    """Late, and within the limit to 30 % of the line up to SIR 5 (A2 close in had slipped to 61 ms)."""
    for kind in ("AG", "BC"):
        for at in (0.05, 0.1, 0.3):
            assert 0.0 < start(bench, circuit, 5.0, at, kind, 45.0, "none") < 50.0


def test_an_ideal_one_waits_for_nothing(bench: ModuleType) -> None:
    for kind in ("AG", "BC", "ABC"):
        waiting = start(bench, "ideal", 10.0, 0.3, kind, 45.0, "none")
        at_once = start(bench, "ideal", 10.0, 0.3, kind, 45.0, "ideal")
        assert 30.0 <= waiting < 60.0
        assert at_once < 15.0
        assert (
            start(bench, "ideal", 1.0, 0.3, kind, 45.0, "none") < 15.0
        )  # behind a strong source neither waits


@pytest.mark.parametrize("circuit", ["P1", "P2", "A1", "A2"])
@pytest.mark.parametrize("sir", [5.0, 18.0])
def test_a_known_circuit_waits_for_nothing(
    bench: ModuleType, circuit: str, sir: float, measured: Measured
) -> None:
    for kind, angle in (("AG", 45.0), ("ABC", 0.0)):
        for at in (0.85, 1.0):
            t = start(bench, circuit, sir, at, kind, angle, "cvt")
            assert t != t, f"{kind} at {at:g}: {t} ms"
        inside = start(bench, circuit, sir, 0.5, kind, angle, "cvt")
        measured("start at 50 %", inside, "ms")
        assert inside < 25.0


@pytest.mark.parametrize(("circuit", "sir"), [("A1", 18.0), ("A2", 10.0)])
@pytest.mark.parametrize("burden", [50.0, 125.0])
def test_another_burden_than_it_is_told(
    bench: ModuleType, circuit: str, sir: float, burden: float, measured: Measured
) -> None:
    for kind, angle in (("AG", 45.0), ("BC", 0.0)):
        t = start(bench, circuit, sir, 1.0, kind, angle, "cvt", burden)
        assert t != t, f"{kind}: {t} ms"
        inside = start(bench, circuit, sir, 0.5, kind, angle, "cvt", burden)
        measured("start at 50 % with another burden", inside, "ms")
        assert inside < 35.0
