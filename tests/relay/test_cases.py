"""../shared/cases/relay-*: right for every estimator that distance zones take."""

from __future__ import annotations

from pathlib import Path

import pytest

import faultloop
from tests.relay.test_not_ready import ALLOWED

pytestmark = pytest.mark.parametrize("method", ALLOWED)


@pytest.mark.parametrize("name", ["ag-095", "ag-100", "abc-100"])
def test_the_local_breaker_opens_with_the_voltage_of_the_lines_side(
    shared: Path, name: str, method: str
) -> None:
    """RX opens the breaker; RA's zone 1 of 85 % has nothing to operate for."""
    path = shared / "cases" / "relay-breaker-opens-line-vt" / f"{name}.toml"
    result = faultloop.run(path, overrides=[f'relay.RA.estimator.method="{method}"'], keep=False)
    assert [t.relay for t in result.trips if t.relay == "RX"], "the breaker did not open"
    assert not [t for t in result.trips if t.relay == "RA" and t.function == "PDIS1"]


@pytest.mark.parametrize(("kind", "angle"), [("AG", 120), ("CAG", 60), ("ABC", 30), ("BC", 120)])
def test_a_fault_behind_a_long_line(shared: Path, kind: str, angle: int, method: str) -> None:
    """Four of the six that tripped zone 1."""
    path = shared / "cases" / "relay-reverse-long-line" / "rev100.toml"
    overrides = [f'fault.F1.type="{kind}"', f"fault.F1.angle_deg={angle}"]
    result = faultloop.run(path, overrides=[*overrides, f'relay.RA.estimator.method="{method}"'], keep=False)
    assert result.fault_start_ns is not None
    assert not [t for t in result.trips if t.relay == "RA" and t.function == "PDIS1"]
